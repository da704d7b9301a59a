"""Figures by truth of the multifunction radar: GOSPA distance, errors, tracks lost, false tracks."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from wavegym.core.arrays import Array
from wavegym.core.traits import CONFIRMED
from wavegym.systems.multifunction_radar.dwell_kernels import Area, weight_at
from wavegym.systems.multifunction_radar.state import Belief, Truth
from wavegym.systems.multifunction_radar.step_kernels import estimate_slots
from wavegym.systems.multifunction_radar.target_kernels import Flight
from wavegym.systems.multifunction_radar.track_kernels import Modes


class Estimates(NamedTuple):
    """Tracks at the time of the belief."""

    mean: Array  # (env, k, 4)
    covariance: Array  # (env, k, 4, 4)


def estimates(belief: Belief, modes: Modes) -> Estimates:
    """Mean and covariance of every slot, of all modes together; 0 where it is free."""
    count, slots = belief.existence.shape
    made = Estimates(np.zeros((count, slots, 4)), np.zeros((count, slots, 4, 4)))
    estimate_slots(belief, modes, *made)
    return made


def take_figures(truth: Truth, belief: Belief, rows: Array, flight: Flight, laws: tuple[Any, ...]) -> None:
    """Write the figures of the environments ``rows`` into ``truth``.

    Args:
        truth: changed in place.
        belief: at the same time.
        rows: indices (row,).
        flight: of the true targets.
        laws: the tracker's modes, beam, area and c0. The GOSPA distance of order 2 has the cutoff sqrt(2 c0), so a
            target that no track reports, and a track without target, cost c0.
    """
    modes, _, area, most = laws
    part = Belief(*(leaf[rows] for leaf in belief))
    made = estimates(part, modes)
    for i, e in enumerate(rows.tolist()):
        late = belief.time[e] - truth.cell[e] * flight.cell
        x = truth.state[e].copy()
        x[:, [0, 2]] += late * x[:, [1, 3]]
        mean, covariance, existence = made.mean[i], made.covariance[i], part.existence[i]
        trace = covariance[:, 0, 0] + covariance[:, 2, 2]
        reported = (existence > 0.0) & (existence * (2.0 * most - trace) > most)
        truth.gospa[e] = _gospa(x[truth.here[e]], mean[reported], most, area)
        confirmed = existence >= CONFIRMED
        _follow(truth, e, confirmed, belief.time[e])
        _errors(truth, e, confirmed, x, mean, covariance)


def _gospa(x: Array, mean: Array, most: float, area: Area) -> float:
    """GOSPA distance of order 2 of targets (g, 4) and reported tracks (k, 4), each weighted by its range."""
    counts, false = (weight_at(np.hypot(states[:, 0], states[:, 2]), area) for states in (x, mean))
    apart = counts[:, None] * np.square(x[:, None, [0, 2]] - mean[None, :, [0, 2]]).sum(axis=2)
    apart = np.minimum(apart, (counts[:, None] + false) * most)
    pairs = linear_sum_assignment(apart)
    alone = np.delete(counts, pairs[0]).sum() + np.delete(false, pairs[1]).sum()
    return float(np.sqrt(apart[pairs].sum() + most * alone))


def _follow(truth: Truth, e: int, confirmed: Array, time: float) -> None:
    """Which targets have a confirmed track, when they first had one, and which have lost it."""
    held = np.zeros_like(truth.held[e])
    held[truth.origin[e][confirmed & (truth.origin[e] >= 0)]] = True
    held &= truth.here[e]
    truth.lost[e] += (truth.held[e] & ~held & truth.here[e]).sum()
    first = held & np.isnan(truth.confirmed[e])
    truth.confirmed[e][first] = time
    truth.held[e] = held


def _errors(truth: Truth, e: int, confirmed: Array, x: Array, mean: Array, covariance: Array) -> None:
    """Errors of confirmed tracks against the target whose echo each has used last, and the number of false tracks."""
    origin = truth.origin[e]
    present = confirmed & (origin >= 0) & truth.here[e][origin]
    truth.false[e] = (confirmed & ~present).sum()
    truth.present[e] = present
    error = mean[present] - x[origin[present]]
    spread = covariance[present]
    for figure, values in (
        (truth.squared_error, error[:, 0] ** 2 + error[:, 2] ** 2),
        (truth.variance, spread[:, 0, 0] + spread[:, 2, 2]),
        (truth.nees, (error * np.linalg.solve(spread, error[..., None])[..., 0]).sum(axis=1)),
    ):
        figure[e] = 0.0
        figure[e, present] = values
