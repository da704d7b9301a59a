"""The numbers of the agile chirps' figures, with intervals, as ``summary.json`` has them."""

from __future__ import annotations

from typing import Any

import numpy as np

from research.papers.agile_clutter.study import BEST_FREE, CLUTTER, FREE, FULL, Runs, Study, names, scene
from research.papers.estimates import mean_estimate, plain, ratio_estimates, share_estimate
from wavegym.core.arrays import Array
from wavegym.evaluation import statistics
from wavegym.evaluation.statistics import Estimate
from wavegym.evaluation.summary import versions
from wavegym.systems.agile_clutter.system import AgileClutter

JUMP = AgileClutter.births[1] + 1  # steps at which the second target is first measured,
DROP = AgileClutter.births[0] + AgileClutter.lifetime + 1  # and the first one no longer
# Steps, from 1, over which the shares of the phase functions are taken.
WINDOWS = {"early": (1, 3), "jump": (JUMP, JUMP), "late": (20, DROP - 1), "all": (1, AgileClutter.horizon)}


def summarise(study: Study) -> dict[str, Any]:
    """All numbers, as plain types; None if there is no estimate, for example if no run was kept.

    Keys:
        command, seed, runs, particles, clutter_density, versions; ``convergence``: for each number of particles the
        ``runs`` and the ``kept``, ``mse_kept`` and ``mse_all`` of the library's one-step scheduler (as for a policy,
        below); and trackers: for each tracker and each clutter ("clutter", "no clutter") ``best_fixed`` ({index,
        waveforms} by policy), ``policies``, ``best_free`` (ratios as below: the best fixed to the agile scheduler, both
        with free shapes), ``jump`` and ``drop`` (in the kept runs of the fully agile scheduler: the error at k = JUMP,
        or DROP, divided by the error one step earlier), and ``choices`` of the fully agile scheduler with one shape and
        with free shapes.

        Each policy has: ``kept``, the share of runs in which no target was lost; ``mse_kept`` and ``mse_all`` {mean,
        ci, median, runs}, m^2, the squared error summed over targets and steps; ``nees``, the mean over targets and
        steps of kept runs; ``predicted``, the tracker's own variance, summed over targets and steps; ``clutter``,
        points inside gates per step, and ``clutter_1``, the same at the first step, all runs; ``ratio_kept`` and
        ``ratio_all`` {ratio, ci, geometric, geometric_ci, runs}: the mse divided by that of the fully agile scheduler,
        in the runs that both policies keep or in all runs; None for this scheduler.

        ``choices`` has, for kept runs: ``share`` of each phase function, for each window of steps (``WINDOWS``: early,
        jump, late, all), all sensors together; ``kind``, the same by kind of phase function; ``linear`` {choices, of,
        runs, kept, ci}: how often LFM was chosen and in how many runs, with the interval of the share of these runs;
        ``typical``, the choices of the run that is most similar to the others, a list for each sensor.

        Intervals are [low, high], 95 %: of a BCa bootstrap over runs; of a share that is 0 or 1 in each run, or the
        same in all, from the binomial distribution (Clopper and Pearson).
    """
    trackers: dict[str, Any] = {}
    for tracker, clutter in study.settings:
        trackers.setdefault(tracker, {})[clutter] = _setting(study, tracker, clutter)
    first = next(iter(study.runs))
    runs = len(study.runs[first].lost)
    asked = "both" if len(trackers) > 1 else next(iter(trackers))
    return {
        "command": f"python -m research.papers agile_clutter --runs {runs} --tracker {asked} --seed {study.seed}",
        "seed": study.seed,
        "runs": runs,
        "particles": scene(first).particles,
        "clutter_density": dict(CLUTTER),
        "versions": versions(),
        "convergence": {
            str(count): {"runs": len(played.lost), **_errors(played, study.seed)}
            for count, played in study.converged.items()
        },
        "trackers": trackers,
    }


def curve(study: Study, runs: Runs) -> list[Estimate]:
    """The squared error summed over targets, mean over kept runs: an estimate for each step."""
    summed = runs.summed[runs.kept]
    return [mean_estimate(summed[:, k], study.seed) for k in range(summed.shape[1])]


def shares(runs: Runs, count: int) -> Array:
    """The share of each of ``count`` phase functions in kept runs, (k, sensor, law); NaN if no run was kept."""
    chosen = runs.law[runs.kept][..., None] == np.arange(count)
    return chosen.sum(axis=0) / (len(chosen) or np.nan)


def typical(runs: Runs) -> Array:
    """Phase functions (k, sensor) of the kept run that agrees most with the others; the first if several are equal."""
    law = runs.law[runs.kept]
    agreement = np.zeros(len(law))
    for index in range(law.max(initial=-1) + 1):
        chosen = law == index
        agreement += (chosen * chosen.sum(axis=0)).sum(axis=(1, 2))
    return law[int(agreement.argmax())] if len(law) else np.full(law.shape[1:], -1)


def kind(name: str) -> str:
    """The kind of a phase function by its name: HFM of HFM0.1."""
    return name[:3]


def _setting(study: Study, tracker: str, clutter: str) -> dict[str, Any]:
    played, seed = study.of(tracker, clutter), study.seed
    full = played[FULL]
    summed = full.summed[full.kept]
    return {
        "best_fixed": {
            case.policy: {"index": index, "waveforms": list(waveforms)}
            for case, (index, waveforms) in study.fixed.items()
            if case[:2] == (tracker, clutter)
        },
        "policies": {name: _policy(runs, None if name == FULL else full, seed) for name, runs in played.items()},
        "best_free": _ratios(played[BEST_FREE], played[FREE], seed),
        "jump": ratio_estimates(summed[:, JUMP - 1], summed[:, JUMP - 2], seed),
        "drop": ratio_estimates(summed[:, DROP - 1], summed[:, DROP - 2], seed),
        "choices": {name: _choices(played[name], names(name), seed) for name in (FULL, FREE)},
    }


def _policy(runs: Runs, full: Runs | None, seed: int) -> dict[str, Any]:
    own = runs.kept
    return {
        **_errors(runs, seed),
        "nees": plain(mean_estimate(np.nanmean(runs.nees[own], axis=(1, 2)), seed)),
        "predicted": plain(mean_estimate(runs.cost[own].sum(axis=1), seed)),
        "clutter": plain(mean_estimate(runs.clutter.mean(axis=1), seed)),
        "clutter_1": plain(mean_estimate(runs.clutter[:, 0], seed)),
        **({"ratio_kept": None, "ratio_all": None} if full is None else _ratios(runs, full, seed)),
    }


def _ratios(runs: Runs, others: Runs, seed: int) -> dict[str, Any]:
    total, reference, both = runs.summed.sum(axis=1), others.summed.sum(axis=1), runs.kept & others.kept
    return {
        "ratio_kept": ratio_estimates(total[both], reference[both], seed),
        "ratio_all": ratio_estimates(total, reference, seed),
    }


def _errors(runs: Runs, seed: int) -> dict[str, Any]:
    total = runs.summed.sum(axis=1)
    return {
        "kept": plain(share_estimate(runs.kept.astype(float), seed)),
        "mse_kept": _error(total[runs.kept], seed),
        "mse_all": _error(total, seed),
    }


def _choices(runs: Runs, offered: tuple[str, ...], seed: int) -> dict[str, Any]:
    law = runs.law[runs.kept]
    kinds = tuple(dict.fromkeys(map(kind, offered)))
    of_kind = np.array([kinds.index(kind(name)) for name in offered])
    linear = law == offered.index("LFM")
    some = linear.any(axis=(1, 2))
    return {
        "share": _windows(law, offered, seed),
        "kind": _windows(of_kind[law], kinds, seed),
        "linear": {
            "choices": int(linear.sum()),
            "of": linear.size,
            "runs": int(some.sum()),
            "kept": len(some),
            "ci": plain(share_estimate(some.astype(float), seed))["ci"],
        },
        "typical": [[offered[j] if j >= 0 else "" for j in sensor] for sensor in typical(runs).T],
    }


def _windows(law: Array, labels: tuple[str, ...], seed: int) -> dict[str, dict[str, Any]]:
    """Share of each label by window of steps, from indices (run, k, sensor)."""
    return {
        window: {
            label: plain(share_estimate((law[:, first - 1 : last] == index).mean(axis=(1, 2)), seed))
            for index, label in enumerate(labels)
        }
        for window, (first, last) in WINDOWS.items()
    }


def _error(values: Array, seed: int) -> dict[str, Any]:
    median = statistics.finite(np.median(values)) if len(values) else None
    return {**plain(mean_estimate(values, seed)), "median": median, "runs": len(values)}
