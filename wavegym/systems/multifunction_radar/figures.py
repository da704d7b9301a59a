"""Figures by truth of the multifunction radar: GOSPA distance, errors, tracks lost, false tracks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from wavegym.core.arrays import Array
from wavegym.core.capabilities import CONFIRMED
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


def take_figures(truth: Truth, belief: Belief, rows: Array, modes: Modes, flight: Flight, most: float) -> None:
    """Write the figures of the environments ``rows`` into ``truth``.

    Args:
        truth: changed in place.
        belief: at the same time.
        rows: indices (row,).
        modes: the tracker's.
        flight: of the true targets.
        most: c0 in m^2; the GOSPA distance of order 2 has the cutoff sqrt(2 c0), so a target that no track reports,
            and a track without target, cost c0.
    """
    part = Belief(*(leaf[rows] for leaf in belief))
    made = estimates(part, modes)
    for i, e in enumerate(rows.tolist()):
        late = belief.time[e] - truth.cell[e] * flight.cell
        x = truth.state[e].copy()
        x[:, [0, 2]] += late * x[:, [1, 3]]
        mean, covariance, existence = made.mean[i], made.covariance[i], part.existence[i]
        trace = covariance[:, 0, 0] + covariance[:, 2, 2]
        reported = (existence > 0.0) & (existence * (2.0 * most - trace) > most)
        truth.gospa[e] = _gospa(x[truth.here[e]], mean[reported], most)
        confirmed = existence >= CONFIRMED
        _follow(truth, e, confirmed, belief.time[e])
        _errors(truth, e, confirmed, x, mean, covariance)


def _gospa(x: Array, mean: Array, most: float) -> float:
    """GOSPA distance of order 2 of targets (g, 4) and reported tracks (k, 4)."""
    apart = np.square(x[:, None, [0, 2]] - mean[None, :, [0, 2]]).sum(axis=2)
    pairs = linear_sum_assignment(np.minimum(apart, 2.0 * most))
    near = np.minimum(apart[pairs], 2.0 * most).sum()
    return float(np.sqrt(near + most * abs(len(x) - len(mean))))


def _follow(truth: Truth, e: int, confirmed: Array, time: float) -> None:
    """Which targets have a confirmed track, when they first had one, and which have lost theirs."""
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
    error = np.where(present[:, None], mean - x[origin], 0.0)
    spread = np.where(present[:, None, None], covariance, np.eye(4))
    truth.squared_error[e] = error[:, 0] ** 2 + error[:, 2] ** 2
    truth.variance[e] = np.where(present, covariance[:, 0, 0] + covariance[:, 2, 2], 0.0)
    truth.nees[e] = (error * np.linalg.solve(spread, error[..., None])[..., 0]).sum(axis=1)
