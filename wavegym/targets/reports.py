"""Which reports of one target can be trusted: recorders repeat positions, stamp them late and lose altitudes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wavegym.core.arrays import FloatArray

Mask = NDArray[np.bool_]
POSITION_TOLERANCE = (
    25.0  # m: quantisation and noise of position reports, which closely spaced ones turn into "accelerations"
)


def last_of_each_time(times: FloatArray) -> Mask:
    """Mask (report,) of the last among reports that carry the same time; times ascend."""
    return np.append(times[1:] != times[:-1], True)


def fresh(horizontal: FloatArray, height: FloatArray) -> Mask:
    """Mask (report,) of the reports that do not merely repeat the position before them.

    A recorder that hears nothing new repeats the last position under a new time. Believed, the target would stop and
    then jump. The height (report,) may be missing (NaN) on either side; horizontal is (report, 2).
    """
    same_height = (height[1:] == height[:-1]) | np.isnan(height[1:]) | np.isnan(height[:-1])
    return np.append(True, ~((horizontal[1:] == horizontal[:-1]).all(axis=1) & same_height))


def fill_heights(times: FloatArray, height: FloatArray) -> tuple[FloatArray, bool]:
    """Heights (report,) with missing ones (NaN) interpolated in time, held at the ends; and whether any was known."""
    known = ~np.isnan(height)
    if not known.any():
        return np.zeros_like(height), False
    return np.interp(times, times[known], height[known]), True


def flyable(times: FloatArray, positions: FloatArray, max_acceleration: float) -> Mask:
    """Mask (report,) without the reports that could only be reached by more than ``max_acceleration`` [m/s²].

    A position stamped s seconds late lies s times the speed behind the path: the target seems to brake, then to race.
    A report is suspect by its distance to the chord between its neighbours, which under an acceleration a is
    a h₁ h₂ / 2 at most (h: the times to the neighbours). Of the worst suspect and its neighbours the one goes
    whose removal leaves the fewest suspects, and the least suspicion among equals, until none is left.

    Args:
        times: ascending [s], (report,).
        positions: metres, (report, 3).
        max_acceleration: limit [m/s²], beyond ``POSITION_TOLERANCE``; infinite: everything is kept.
    """
    kept = np.arange(len(times))
    suspicion = _suspicion(times, positions, max_acceleration)
    while len(suspicion) and suspicion.max() > 1:
        worst = int(suspicion.argmax()) + 1
        low, high = max(0, worst - 3), worst + 4  # removing a report changes its neighbours' suspicion only
        remaining = {}
        for suspect in (worst, worst - 1, worst + 1):  # the middle one first: it wins a tie
            near = np.delete(kept[low:high], suspect - low)
            left = _suspicion(times[near], positions[near], max_acceleration)
            remaining[suspect] = (int((left > 1).sum()), float(left.sum()))
        kept = np.delete(kept, min(remaining, key=remaining.__getitem__))
        suspicion = _suspicion(times[kept], positions[kept], max_acceleration)
    mask = np.zeros(len(times), np.bool_)
    mask[kept] = True
    return mask


def _suspicion(times: FloatArray, positions: FloatArray, max_acceleration: float) -> FloatArray:
    """Distance of each inner report to its neighbours' chord over what is allowed, (report - 2,)."""
    if len(times) < 3:
        return np.zeros(0)
    before, after = times[1:-1] - times[:-2], times[2:] - times[1:-1]
    weight = (before / (before + after))[:, None]
    chord = (1 - weight) * positions[:-2] + weight * positions[2:]
    allowed = POSITION_TOLERANCE + max_acceleration * before * after / 2
    return np.linalg.norm(positions[1:-1] - chord, axis=1) / allowed
