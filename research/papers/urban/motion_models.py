"""Model probabilities of the closed loop, in each phase of the targets' motion."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from research.papers.estimates import mean_estimate, plain
from wavegym.core.arrays import Array
from wavegym.evaluation.statistics import Estimate
from wavegym.systems.urban.system import Urban
from wavegym.systems.urban.tracker import MODELS

LIMIT = 0.8  # a model with a larger probability counts as known
GRACE = 5  # scans allowed for the change of models
BRAKING, TURN, SPEEDING, ON = "braking", "left turn", "speeding up", "driving on"
EXPECTED = {BRAKING: "NCA", TURN: "CT left", SPEEDING: "NCA", ON: "NCV"}
PHASES = ("driving in", *EXPECTED)  # the segments of the path


class Phase(NamedTuple):
    """A phase of a target's motion, after scan ``first`` up to scan ``last``."""

    name: str
    first: int
    last: int


def phases(loop: Urban, target: int) -> list[Phase]:
    """The phases of a target that begin before the end."""
    ends = np.cumsum([seconds for seconds, _, _ in loop.path]) + loop.arrivals[target]
    edges = np.rint(np.array([loop.arrivals[target], *ends, loop.horizon * loop.dt]) / loop.dt).astype(int)
    edges = np.minimum(edges, loop.horizon).tolist()
    found = [Phase(*of) for of in zip(PHASES, edges[:-1], edges[1:], strict=True)]
    return [phase for phase in found if phase.first < phase.last]


def probability(mu: Array, target: int, model: int, seed: int) -> list[Estimate]:
    """Mean over the runs in which the target is held, at each scan; mu as in ``Runs``."""
    return [mean_estimate(of[np.isfinite(of)], seed) for of in mu[:, :, target, model].T]


def models(mu: Array, loop: Urban, seed: int) -> list[list[dict[str, Any]]]:
    """The model probabilities of each target in each phase, from braking on.

    Keys:
        phase, first, last: scans from ``GRACE`` after the change. expected: the model of the true motion.
        mean: by model {mean, ci}, over these scans and the runs that hold the target.
        least: {mean, ci, scan}, where the expected model's mean over runs is least.
        known_from: the first scan after which the mean stays above ``LIMIT`` until the phase ends; None if there is
        none.
    """
    return [
        [_phase(mu[:, :, target], phase, seed) for phase in phases(loop, target) if phase.name in EXPECTED]
        for target in range(mu.shape[2])
    ]


def _phase(mu: Array, phase: Phase, seed: int) -> dict[str, Any]:
    own = MODELS.index(EXPECTED[phase.name])
    start = min(phase.first + GRACE, phase.last)
    window = mu[:, start - 1 : phase.last]  # index k - 1 holds scan k
    count = np.isfinite(window[..., own]).sum(axis=1)
    total = np.nansum(window, axis=1)[count > 0] / count[count > 0, None]
    each = [_mean(column) for column in mu[:, phase.first : phase.last, own].T]
    above = [value is not None and value > LIMIT for value in each]
    until = next((back for back, known in enumerate(reversed(above)) if not known), len(above))
    held = [k for k in range(start, phase.last + 1) if np.isfinite(mu[:, k - 1, own]).any()]
    worst = min(held, key=lambda k: _mean(mu[:, k - 1, own]) or 0.0, default=None)
    least = None if worst is None else mu[:, worst - 1, own]
    return {
        "phase": phase.name,
        "first": start,
        "last": phase.last,
        "expected": MODELS[own],
        "mean": {name: plain(mean_estimate(of, seed)) for name, of in zip(MODELS, total.T, strict=True)},
        "least": {
            **plain(Estimate(None, None) if least is None else mean_estimate(least[np.isfinite(least)], seed)),
            "scan": worst,
        },
        "known_from": phase.last - until + 1 if until else None,
    }


def _mean(column: Array) -> float | None:
    """Over the runs that hold the target."""
    column = column[np.isfinite(column)]
    return float(column.mean()) if len(column) else None
