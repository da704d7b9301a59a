"""Clutter: a Poisson field of false returns, looked up in validation gates."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_finite, check_key
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_non_negative, check_positive, check_within
from wavegym.sensors import clutter_kernels as kernels
from wavegym.sensors.gates import cholesky, gate_volume

MOST_POINTS = 1e7
"""Greatest expected number of clutter points in one call."""


def union_clutter(key: int, centre: ArrayLike, S: ArrayLike, gate: float, density: float) -> Array:
    """Points of one scan's clutter field that lie in the union of the gates (overlaps count once).

    The field is Poisson with constant density and fills the measurement plane. A point depends on the key and the
    density alone: other gates find the same points where they overlap, and a larger gate keeps those of a smaller one.

    Args:
        key: an integer in [0, 2^64), one per world, step and sensor.
        centre: the gates' centres, the predicted measurements, (gates, 2).
        S: innovation covariances, (gates, 2, 2).
        gate: size of all gates in standard deviations, > 0.
        density: expected points per unit of gate volume (m^2/s for range and range-rate), >= 0.

    Returns:
        The points, (points, 2).

    Raises:
        InputError: invalid shapes or values, more than 1e7 expected points, or gates too long or too far away.
    """
    own = check_key(key)
    points, L = np.array(check_finite("centre", centre, 2), order="C"), cholesky(S)
    if points.ndim != 2 or L.shape != (len(points), 2, 2):
        raise InputError(
            f"centre and S have shapes {points.shape} and {L.shape}, expected (gates, 2) and (gates, 2, 2)"
        )
    expected = check_non_negative("density", density) * float(gate_volume(S, check_positive("gate", gate)).sum())
    check_within("expected number of clutter points (density x gate volumes)", expected, 0.0, MOST_POINTS)
    present = np.ones(len(points), dtype=np.bool_)
    if not kernels.most_load(present, points, L, float(gate), float(density)) < np.inf:
        wanted = f"within {kernels.FARTHEST:.0g} and sizes up to {0.5 * kernels.LONGEST:.0g} clutter cells"
        raise InputError(f"density is {density!r} with cells of area 1 / density, expected gates {wanted}")
    z, count = kernels.add_clutter(own, points, L, present, float(gate), float(density), np.empty((64, 2)), 0)
    return z[:count].copy()
