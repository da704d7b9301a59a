"""The numbers of the RF/EO figures, with intervals, as ``summary.json`` has them."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from research.papers.estimates import mean_estimate, plain, ratio_estimates, share_estimate
from research.papers.rf_eo.adaptation import adaptation, agreement, jumps
from research.papers.rf_eo.study import (
    ADAPTIVE,
    CONSTANT,
    DEPTHS,
    INFORMATION,
    PENALTIES,
    POLICIES,
    SCENES,
    Case,
    Runs,
    Study,
    system,
)
from wavegym.core.arrays import Array
from wavegym.evaluation.consistency import nees_bounds
from wavegym.evaluation.statistics import Estimate
from wavegym.evaluation.summary import versions

PARTS = (0.0, 0.01, 0.1, 0.5, 1.0)  # the edges of the windows of a run; the last window is "late"
SETTLED = 10  # steps after which the transient is over
STATES = 4  # the mean NEES of a consistent filter, for one target


def summarise(study: Study) -> dict[str, Any]:
    """All numbers, as plain types; None if there is no estimate.

    Keys:
        command, seed, runs, versions, and scenes. Each scene, "published" and "far", has:

        ``horizon``, ``margin`` and ``threshold``; ``tuned``: by policy, the settings of each slot and platform [PRF Hz,
        bandwidth Hz, pixel angle rad]; ``policies``; ``lookahead``: by depth, ``percent`` (the gain over the one-step
        scheduler), its ci, and us_per_decision; ``penalties``: by penalty in prediction, ``cost`` and
        ``over_logistic`` of the one-step scheduler; ``adaptation`` (of both objectives) and ``agreement``.

        Each policy has:

        ``cost`` {mean, ci, median}: trace(W P) per step, m^2; ``over_tuned`` and ``over_myopic`` {ratio, ci, geometric,
        geometric_ci, runs}: the cost divided by that of the tuned constant and of the one-step scheduler on the same
        worlds.

        ``rmse`` {mean, ci, median}: root mean square position error of a run in m; ``rmse_late``, the same over the
        last half, and ``late_over_myopic``, its ratio; ``windows``, a list of {first, last, mean, ci, fall,
        over_myopic}: rmse of a part of the run, its ratio to the part before and to that of the one-step scheduler.

        ``nees`` {mean, ci, first, band, inside, inside_settled}: the mean over all steps and at the first step; the
        95 % band of the mean over runs and targets at one step; the share of steps whose mean is inside the band, from
        the first step and after ``SETTLED``. The shares have no interval, because resampled runs are not independent.

        ``below_threshold``: share of steps, predicted with the scene's margin for every policy; ``missed_first``: share
        of runs whose first step lost a measurement that was predicted in view; ``missed``: share of steps that lost
        one.

        ``jumps`` and ``jumps_late`` {mean, ci, platforms}: share of the platforms' steps at which the PRF changes by
        more than a factor of two, together and for each platform, over the run and its last half; us_per_decision: the
        only figure that depends on a clock.

        Intervals are [low, high], 95 %: of a BCa bootstrap over runs; of a share that is 0 or 1 in each run, or the
        same in all, from the binomial distribution (Clopper and Pearson).
    """
    count = len(next(iter(study.runs.values())).cost)
    return {
        "command": f"python -m research.papers rf_eo --runs {count} --seed {study.seed}",
        "seed": study.seed,
        "runs": count,
        "versions": versions(),
        "scenes": {scene: _scene(study, scene) for scene in SCENES},
    }


def curve(study: Study, scene: str, policy: str, target: int, steps: Array) -> list[Estimate]:
    """RMS position error of one target over runs, m, at ``steps`` (from 1): an estimate for each."""
    square = np.square(study.of(scene, policy).error[:, :, target])
    found = [mean_estimate(square[:, k - 1], study.seed) for k in steps]
    root = [(e.value, e.ci) for e in found]
    return [
        Estimate(None if v is None else float(np.sqrt(v)), ci and (float(np.sqrt(ci[0])), float(np.sqrt(ci[1]))))
        for v, ci in root
    ]


def shown(horizon: int) -> Array:
    """The steps in curves and files: all up to 20, then, in long runs, every fifth."""
    k = np.arange(1, horizon + 1)
    return k if horizon <= 300 else k[(k <= 20) | (k % 5 == 0)]


def _scene(study: Study, scene: str) -> dict[str, Any]:
    adaptive, loop = study.of(scene, ADAPTIVE), system(Case(scene, ADAPTIVE))
    policies = {name: _policy(study, scene, name) for name in POLICIES[scene]}
    return {
        "horizon": study.horizon(scene),
        "margin": loop.margin,
        "threshold": loop.threshold,
        "tuned": {case.policy: slots.tolist() for case, slots in study.tuned.items() if case.scene == scene},
        "policies": policies,
        "lookahead": {str(H): _ahead(policies[f"lookahead:{H}"]) for H in DEPTHS},
        "penalties": {penalty: _penalty(study, scene, penalty) for penalty in PENALTIES},
        "adaptation": {
            name: adaptation(study.of(scene, name), loop, marks(study.horizon(scene)), study.seed)
            for name in (ADAPTIVE, INFORMATION)
        },
        "agreement": agreement(adaptive, study.seed),
    }


def marks(horizon: int) -> list[int]:
    """The first step of the run, and the last step of each window."""
    return sorted({1, *(max(1, round(part * horizon)) for part in PARTS[1:])})


def _policy(study: Study, scene: str, name: str) -> dict[str, Any]:
    seed, runs = study.seed, study.of(scene, name)
    adaptive, constant = study.of(scene, ADAPTIVE), study.of(scene, CONSTANT)
    half = runs.cost.shape[1] // 2
    decisions = max(1, runs.cost.shape[1] - 1)
    return {
        "cost": _with_median(runs.mean_cost, seed),
        "over_tuned": ratio_estimates(runs.mean_cost, constant.mean_cost, seed),
        "over_myopic": ratio_estimates(runs.mean_cost, adaptive.mean_cost, seed),
        "rmse": _with_median(_rmse(runs.error), seed),
        "rmse_late": _with_median(_rmse(runs.error[:, half:]), seed),
        "late_over_myopic": ratio_estimates(_rmse(runs.error[:, half:]), _rmse(adaptive.error[:, half:]), seed),
        "windows": _windows(runs, adaptive, seed),
        "nees": _nees(runs, seed),
        "below_threshold": plain(share_estimate(runs.below.mean(axis=1), seed)),
        "missed_first": plain(share_estimate((runs.missed[:, 0] > 0).astype(float), seed)),
        "missed": plain(share_estimate((runs.missed > 0).mean(axis=1), seed)),
        "jumps": jumps(runs, 0, seed),
        "jumps_late": jumps(runs, half, seed),
        "us_per_decision": float(1e6 * runs.seconds.mean() / decisions),
    }


def _rmse(error: Array) -> Array:
    """Over steps and targets, (run,)."""
    return np.asarray(np.sqrt(np.square(error).mean(axis=(1, 2))))


def _with_median(values: Array, seed: int) -> dict[str, Any]:
    return {**plain(mean_estimate(values, seed)), "median": float(np.median(values))}


def _windows(runs: Runs, adaptive: Runs, seed: int) -> list[dict[str, Any]]:
    """RMS error by part of the run; empty parts of a short one are left out."""
    edges = [round(part * runs.error.shape[1]) for part in PARTS]
    spans = [(a, b) for a, b in pairwise(edges) if a < b]
    found, before = [], None
    for a, b in spans:
        own, other = _rmse(runs.error[:, a:b]), _rmse(adaptive.error[:, a:b])
        found.append(
            {
                "first": a + 1,
                "last": b,
                **plain(mean_estimate(own, seed)),
                "fall": None if before is None else ratio_estimates(own, before, seed),
                "over_myopic": ratio_estimates(own, other, seed),
            }
        )
        before = own
    return found


def _nees(runs: Runs, seed: int) -> dict[str, Any]:
    band = nees_bounds(runs.nees.shape[0] * runs.nees.shape[2], STATES)
    by_step = runs.nees.mean(axis=(0, 2))
    inside = (band[0] <= by_step) & (by_step <= band[1])
    return {
        **plain(mean_estimate(runs.nees.mean(axis=(1, 2)), seed)),
        "first": float(by_step[0]),
        "band": [float(end) for end in band],
        "inside": float(inside.mean()),
        "inside_settled": float(inside[SETTLED:].mean()) if inside[SETTLED:].size else None,
    }


def _ahead(policy: dict[str, Any]) -> dict[str, Any]:
    """Gain over the one-step scheduler, percent of its cost."""
    ratio, ci = policy["over_myopic"]["ratio"], policy["over_myopic"]["ci"]
    return {
        "percent": None if ratio is None else 100.0 * (1.0 - ratio),
        "ci": None if ci is None else [100.0 * (1.0 - end) for end in reversed(ci)],
        "us_per_decision": policy["us_per_decision"],
    }


def _penalty(study: Study, scene: str, penalty: str) -> dict[str, Any]:
    own, logistic = study.of(scene, ADAPTIVE, penalty), study.of(scene, ADAPTIVE)
    return {
        "cost": _with_median(own.mean_cost, study.seed),
        "over_logistic": ratio_estimates(own.mean_cost, logistic.mean_cost, study.seed),
        "missed": plain(share_estimate((own.missed > 0).mean(axis=1), study.seed)),
    }
