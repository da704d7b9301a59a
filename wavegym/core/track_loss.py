"""When a target counts as lost: one rule by truth for all systems.

A target is astray in a step if no track follows it: its track is too far away, or contradicts it by its own covariance,
or was dropped. It is lost after ``LOST_AFTER`` consecutive steps astray. How large the tracker believes its error to
be, and what the sensors received, do not count.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from wavegym.core.arrays import Array

LOST_AFTER = 5  # consecutive steps astray
REGION = 0.999  # probability of the region of a track's own covariance that has to hold the true state
NO_TRACK_YET = -1  # in place of a number of steps


@cache
def greatest_nees(dimension: int) -> float:
    """The NEES at the edge of the region: a quantile of chi-square with ``dimension`` degrees of freedom."""
    from scipy.special import chdtri  # a tenth of a second that an import of the package need not spend

    return float(chdtri(dimension, 1.0 - REGION))


def is_astray(position_error: Array, nees: Array, beyond: float, dimension: int | None) -> Array:
    """Whether each target is ``beyond`` metres or more from its estimate, or outside the region of its track, bool.

    Args:
        position_error: m, of any shape.
        nees: of the same shape.
        beyond: m, where the sensor or the association no longer finds a target; see ``System.lost_beyond``.
        dimension: of the error in ``nees``; None leaves the region out.
    """
    inside = position_error < beyond  # so that NaN counts as astray
    return ~inside if dimension is None else ~(inside & (nees <= greatest_nees(dimension)))


def steps_astray(before: Array | int, astray: Array, has_track: Array | bool) -> Array:
    """The consecutive steps astray of each target after one more step, int, of any shape.

    A target without a track is astray only if it had one before. A target that is neither astray nor has a track is
    absent: its number stays, so absence makes no target lost and ends no loss.

    Args:
        before: the result after the step before; at first ``NO_TRACK_YET``.
        astray: see ``is_astray``; of a target that is there without a track, True.
        has_track: whether the target has a track; True: all have.
    """
    begun = np.maximum(before, has_track - 1)  # 0 or more for a target that has or had a track
    return np.where(astray < has_track, 0, begun + (astray & (begun >= 0)))
