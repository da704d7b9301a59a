"""Validation gates, the ellipses in which a tracker looks for a target's return, and the clutter in them.

A gate of size g holds the measurements z with (z - centre)' S^-1 (z - centre) <= g^2. S is the innovation covariance of
a two-dimensional measurement (Bar-Shalom, Li, Kirubarajan 2001, section 5.4.2, with gamma = g^2). Clutter is a Poisson
field of false returns.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import Array, check_elements, check_finite, check_key, check_last_axes
from wavegym.core.covariances import check_positive_definite
from wavegym.core.errors import InputError, check_non_negative, check_positive, check_within
from wavegym.sensors import clutter_kernels as kernels

MOST_POINTS = 1e7
"""Greatest expected number of clutter points in one call."""


def gate_probability(gate: ArrayLike) -> Array:
    """Pg = 1 - exp(-g^2 / 2), the probability that a detected target's return lies in its gate of size g > 0."""
    g = check_elements(check_positive, "gate", gate)
    return -np.expm1(-0.5 * g * g)


def gate_volume(S: ArrayLike, gate: ArrayLike) -> Array:
    """Area pi g^2 sqrt(det S) of the gate, in the product of the measurement's units: m^2/s for range and range-rate.

    Args:
        S: innovation covariance, (..., 2, 2).
        gate: g > 0, (...); leading axes broadcast.

    Raises:
        InputError: an S that is not symmetric positive definite, a g not finite and > 0, or shapes that do not fit.
    """
    return kernels.volume(check_elements(check_positive, "gate", gate), cholesky(S))


def inside_gate(innovation: ArrayLike, S: ArrayLike, gate: ArrayLike) -> NDArray[np.bool_]:
    """Whether an innovation z - centre, (..., 2), lies in the gate: (...). S, gate, errors: see ``gate_volume``."""
    g = check_elements(check_positive, "gate", gate)
    squared = kernels.distance(check_finite("innovation", innovation, 2), np.zeros(2), cholesky(S))
    return np.asarray(squared <= g * g)


def cholesky(S: ArrayLike) -> Array:
    """Lower triangular L with L L' = S, (..., 2, 2); InputError for an S that is not symmetric positive definite."""
    S = check_positive_definite("S", check_last_axes("S", S, 2, 2))
    L = np.zeros(S.shape)
    L[..., 0, 0] = np.sqrt(S[..., 0, 0])
    L[..., 1, 0] = S[..., 1, 0] / L[..., 0, 0]
    L[..., 1, 1] = np.sqrt(np.maximum(S[..., 1, 1] - L[..., 1, 0] * L[..., 1, 0], 0.0))
    return L


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
