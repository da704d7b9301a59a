"""The numbers of Kershaw and Evans's figures, with intervals, as ``summary.json`` has them."""

from __future__ import annotations

from typing import Any

import numpy as np

from research.papers.estimates import mean_estimate, plain, ratio_estimates
from research.papers.kershaw_evans.closed_forms import closed_forms
from research.papers.kershaw_evans.study import (
    CLOSING,
    DRAWN,
    GRID_GATE,
    GRID_TRACE,
    MOVING,
    POLICIES,
    RECEDING,
    SCENES,
    TRACE,
    Case,
    Runs,
    Study,
    system,
)
from wavegym.core.arrays import Array
from wavegym.evaluation.statistics import Estimate
from wavegym.evaluation.summary import versions


def summarise(study: Study) -> dict[str, Any]:
    """All numbers, as plain types.

    Keys:
        command, seed, runs, versions, and scenes. Each scene has: ``q``, ``weights``, ``start_range`` and
        ``reference_range`` as played; ``best``, the label of the best fixed waveform; ``closed_forms`` (see
        ``closed_forms.py``); ``policies`` and ``moving``.

        ``policies``, with drawn targets: ``cost``, ``gate``, ``squared_error`` and ``nees`` {mean, ci}, means over the
        steps of a run; ``cost_ratio`` and ``error_ratio`` to the library's trace, ``gate_ratio`` to the library's gate,
        {ratio, ci, geometric, geometric_ci, runs}; ``waveforms``, the number of different pulses of a run, {mean, ci}.

        ``moving``, for closing and receding targets and each policy: ``duration`` and ``sweep`` of the first and the
        last fifth of the steps, {first, last}, each {mean, ci}, in s and Hz; the sweep has no sign.
    """
    seed, runs = study.seed, len(next(iter(study.runs.values())).cost)
    return {
        "command": f"python -m research.papers kershaw_evans --runs {runs} --seed {seed}",
        "seed": seed,
        "runs": runs,
        "versions": versions(),
        "scenes": {scene: _scene(study, scene) for scene in SCENES},
    }


def curve(study: Study, case: Case, field: str) -> list[Estimate]:
    """The mean of a field of ``Runs`` over runs, at each step."""
    return [mean_estimate(column, study.seed) for column in getattr(study.runs[case], field).T]


def _scene(study: Study, scene: str) -> dict[str, Any]:
    loop = system(Case(scene, DRAWN, TRACE))
    return {
        "q": loop.q,
        "weights": list(loop.weights),
        "start_range": list(loop.start_range),
        "reference_range": loop.reference_range,
        "best": study.best[scene],
        "closed_forms": closed_forms(study, scene),
        "policies": {policy: _policy(study, scene, policy) for policy in POLICIES},
        "moving": {
            targets: {policy: _moving(study.of(scene, policy, targets), study.seed) for policy in MOVING}
            for targets in (CLOSING, RECEDING)
        },
    }


def _policy(study: Study, scene: str, policy: str) -> dict[str, Any]:
    runs, seed = study.of(scene, policy), study.seed
    cost, gate = (study.of(scene, name) for name in (GRID_TRACE, GRID_GATE))
    fields = ("cost", "gate", "squared_error", "nees")
    found: dict[str, Any] = {name: plain(mean_estimate(getattr(runs, name).mean(axis=1), seed)) for name in fields}
    found["cost_ratio"] = _ratio(runs.cost, cost.cost, seed)
    found["gate_ratio"] = _ratio(runs.gate, gate.gate, seed)
    found["error_ratio"] = _ratio(runs.squared_error, cost.squared_error, seed)
    found["waveforms"] = plain(mean_estimate(_different(runs), seed))
    return found


def _ratio(values: Array, reference: Array, seed: int) -> dict[str, Any]:
    return ratio_estimates(values.mean(axis=1), reference.mean(axis=1), seed)


def _different(runs: Runs) -> Array:
    """The number of different pulses of each run."""
    pulses = np.stack([runs.duration, runs.sweep], axis=-1)
    return np.array([len(np.unique(run, axis=0)) for run in pulses], np.float64)


def _moving(runs: Runs, seed: int) -> dict[str, Any]:
    fifth = max(1, runs.cost.shape[1] // 5)
    ends = {"first": slice(None, fifth), "last": slice(-fifth, None)}
    return {
        name: {end: plain(mean_estimate(np.abs(values[:, steps]).mean(axis=1), seed)) for end, steps in ends.items()}
        for name, values in (("duration", runs.duration), ("sweep", runs.sweep))
    }
