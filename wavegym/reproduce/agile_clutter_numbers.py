"""The numbers behind the agile chirps' figures, with intervals: what their ``summary.json`` holds."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wavegym.evaluation import statistics
from wavegym.evaluation.statistics import Estimate
from wavegym.evaluation.summary import versions
from wavegym.evaluation.worlds import word
from wavegym.reproduce.agile_clutter import CLUTTER, FULL, LAWS, PARTICLES, Runs, Study

Array = NDArray[Any]

JUMP, DROP = 8, 26  # steps at which the second target is first measured, and the first one no longer
# Steps, from 1, over which the shares of the phase functions are told.
WINDOWS = {"1-3": (1, 3), "7": (7, 7), "8": (8, 8), "8-10": (8, 10), "20-25": (20, 25), "26-32": (26, 32)}


def summarise(study: Study) -> dict[str, Any]:
    """All numbers, made of plain types; None where there is no estimate, as of runs of which none was kept.

    Keys:
        command, seed, runs, particles, versions, and trackers: for each tracker and each clutter ("clutter", "no
        clutter") ``best_fixed`` {index, waveforms}, ``policies``, and of the fully agile scheduler's kept runs
        ``jump`` and ``drop`` (its error at k = 8 over that at 7, at 26 over 25) and ``laws`` (share of each phase
        function's transmissions, sensors together, by window of steps). Of each policy: ``kept``, the share of runs in
        which no target was lost; ``mse_kept`` and ``mse_all`` {mean, ci, median, runs}, m^2, the squared error summed
        over targets and steps; ``predicted``, the tracker's own variance summed likewise, of kept runs; ``clutter``,
        points inside gates per step, and ``clutter_1``, at the first step, all runs; ``ratio_kept`` and ``ratio_all``
        {ratio, ci, geometric, geometric_ci, runs}: mse over that of the fully agile scheduler in the same runs, kept
        under both policies or all of them. Intervals are [low, high], 95 %, of a bootstrap over runs.
    """
    trackers: dict[str, Any] = {}
    for tracker, clutter in study.settings:
        trackers.setdefault(tracker, {})[clutter] = _setting(study, tracker, clutter)
    runs = len(next(iter(study.runs.values())).lost)
    asked = "both" if len(trackers) > 1 else next(iter(trackers))
    return {
        "command": f"python -m wavegym.reproduce agile_clutter --runs {runs} --tracker {asked} --seed {study.root}",
        "seed": study.root,
        "runs": runs,
        "particles": PARTICLES,
        "clutter_density": dict(CLUTTER),
        "versions": versions(),
        "trackers": trackers,
    }


def curve(study: Study, runs: Runs) -> list[Estimate]:
    """The squared error summed over targets, mean over kept runs: an estimate for each step."""
    summed = runs.summed[runs.kept]
    return [_mean(summed[:, k], study.root) for k in range(summed.shape[1])]


def shares(runs: Runs) -> Array:
    """Of kept runs, the share of each phase function, (k, sensor, law); NaN where none was kept."""
    chosen = runs.law[runs.kept][..., None] == np.arange(len(LAWS))
    return chosen.sum(axis=0) / (len(chosen) or np.nan)


def typical(runs: Runs) -> Array:
    """Phase functions (k, sensor) of the kept run whose choices most other kept runs share; the first of equals."""
    law = runs.law[runs.kept]
    agreement = np.zeros(len(law))
    for index in range(len(LAWS)):
        chosen = law == index
        agreement += (chosen * chosen.sum(axis=0)).sum(axis=(1, 2))
    return law[int(agreement.argmax())] if len(law) else np.full(law.shape[1:], -1)


def _setting(study: Study, tracker: str, clutter: str) -> dict[str, Any]:
    played, root = study.of(tracker, clutter), study.root
    index, waveforms = study.fixed[tracker, clutter]
    full = played[FULL]
    summed = full.summed[full.kept]
    return {
        "best_fixed": {"index": index, "waveforms": list(waveforms)},
        "policies": {name: _policy(runs, full, root) for name, runs in played.items()},
        "jump": _ratio(summed[:, JUMP - 1], summed[:, JUMP - 2], root),
        "drop": _ratio(summed[:, DROP - 1], summed[:, DROP - 2], root),
        "laws": _laws(full, root),
    }


def _policy(runs: Runs, full: Runs, root: int) -> dict[str, Any]:
    total, reference, both = runs.summed.sum(axis=1), full.summed.sum(axis=1), runs.kept & full.kept
    return {
        "kept": _plain(_mean(runs.kept.astype(float), root)),
        "mse_kept": _error(total[runs.kept], root),
        "mse_all": _error(total, root),
        "predicted": _plain(_mean(runs.cost[runs.kept].sum(axis=1), root)),
        "clutter": _plain(_mean(runs.clutter.mean(axis=1), root)),
        "clutter_1": _plain(_mean(runs.clutter[:, 0], root)),
        "ratio_kept": _ratio(total[both], reference[both], root),
        "ratio_all": _ratio(total, reference, root),
    }


def _laws(runs: Runs, root: int) -> dict[str, dict[str, Any]]:
    """Shares by window and law, all steps first."""
    law = runs.law[runs.kept]
    windows = {"all": (1, law.shape[1]), **WINDOWS}
    return {
        name: {
            text: _plain(_mean((law[:, first - 1 : last] == index).mean(axis=(1, 2)), root))
            for index, text in enumerate(LAWS)
        }
        for name, (first, last) in windows.items()
    }


def _error(values: Array, root: int) -> dict[str, Any]:
    median = statistics.median(values) if len(values) else None
    return {**_plain(_mean(values, root)), "median": median, "runs": len(values)}


def _mean(values: Array, root: int) -> Estimate:
    """Of (run,) values, each time with the same resamples: an interval does not depend on what else is estimated."""
    return statistics.mean(values[None], _generator(root)) if len(values) else Estimate(None, None)


def _ratio(values: Array, reference: Array, root: int) -> dict[str, Any]:
    """Of the means, and the geometric mean of the runs' ratios, with paired intervals; both arguments (run,)."""
    if not len(values):
        return {"ratio": None, "ci": None, "geometric": None, "geometric_ci": None, "runs": 0}
    found = statistics.difference(values[None], reference[None], _generator(root))
    (ratio, ci), (geometric, geometric_ci) = (_from_percent(estimate) for estimate in found)
    return {"ratio": ratio, "ci": ci, "geometric": geometric, "geometric_ci": geometric_ci, "runs": len(values)}


def _from_percent(estimate: Estimate) -> tuple[float | None, list[float] | None]:
    value, ci = estimate
    return None if value is None else 1.0 + value / 100.0, None if ci is None else [1.0 + end / 100.0 for end in ci]


def _generator(root: int) -> np.random.Generator:
    return np.random.default_rng([root, word("bootstrap")])


def _plain(estimate: Estimate) -> dict[str, Any]:
    return {"mean": estimate.value, "ci": None if estimate.ci is None else list(estimate.ci)}
