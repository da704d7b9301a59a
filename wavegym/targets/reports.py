"""Filters of one target's reports: recorders repeat positions, set late time stamps and lose altitudes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wavegym.core.arrays import FloatArray

Mask = NDArray[np.bool_]
POSITION_TOLERANCE = 25.0  # m: quantisation and noise of position reports


def last_of_each_time(times: FloatArray) -> Mask:
    """Mask (report,) of the last report of each time; times ascend."""
    return np.append(times[1:] != times[:-1], True)


def fresh(horizontal: FloatArray, height: FloatArray) -> Mask:
    """Mask (report,) of the reports that do not repeat the position before.

    A recorder without new data repeats the last position with a new time: the target would seem to stop and then jump.
    A height (report,) may be missing (NaN); horizontal is (report, 2).
    """
    same_height = (height[1:] == height[:-1]) | np.isnan(height[1:]) | np.isnan(height[:-1])
    return np.append(True, ~((horizontal[1:] == horizontal[:-1]).all(axis=1) & same_height))


def fill_heights(times: FloatArray, height: FloatArray) -> tuple[FloatArray, bool]:
    """Heights (report,) with missing heights (NaN) interpolated in time, held at the ends; whether any was known."""
    known = ~np.isnan(height)
    if not known.any():
        return np.zeros_like(height), False
    return np.interp(times, times[known], height[known]), True


def flyable(times: FloatArray, positions: FloatArray, max_acceleration: float) -> Mask:
    """Mask (report,) of the reports that a target can reach with at most ``max_acceleration`` [m/s²].

    A position with a time stamp s seconds late lies s times the speed behind the path. The suspicion of a report is its
    distance to the chord between its neighbours relative to the greatest distance under an acceleration a,
    a h₁ h₂ / 2 (h: the times to the neighbours). Reports are removed until no suspicion exceeds 1. Each removal
    takes the worst report or a neighbour: the one that leaves the fewest suspects, then the least total suspicion.

    Args:
        times: ascending [s], (report,).
        positions: metres, (report, 3).
        max_acceleration: limit [m/s²], beyond ``POSITION_TOLERANCE``; inf keeps all reports.
    """
    kept = np.arange(len(times))
    suspicion = _suspicion(times, positions, max_acceleration)
    while len(suspicion) and suspicion.max() > 1:
        worst = int(suspicion.argmax()) + 1
        low, high = max(0, worst - 3), worst + 4  # a removal changes the suspicion of neighbours only
        remaining = {}
        for suspect in (worst, worst - 1, worst + 1):  # the worst first: it wins a tie
            near = np.delete(kept[low:high], suspect - low)
            left = _suspicion(times[near], positions[near], max_acceleration)
            remaining[suspect] = (int((left > 1).sum()), float(left.sum()))
        kept = np.delete(kept, min(remaining, key=remaining.__getitem__))
        suspicion = _suspicion(times[kept], positions[kept], max_acceleration)
    mask = np.zeros(len(times), np.bool_)
    mask[kept] = True
    return mask


def _suspicion(times: FloatArray, positions: FloatArray, max_acceleration: float) -> FloatArray:
    """Distance of each inner report to its neighbours' chord relative to the allowed distance, (report - 2,)."""
    if len(times) < 3:
        return np.zeros(0)
    before, after = times[1:-1] - times[:-2], times[2:] - times[1:-1]
    weight = (before / (before + after))[:, None]
    chord = (1 - weight) * positions[:-2] + weight * positions[2:]
    allowed = POSITION_TOLERANCE + max_acceleration * before * after / 2
    return np.linalg.norm(positions[1:-1] - chord, axis=1) / allowed
