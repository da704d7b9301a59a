"""Validation gates: the ellipses in which a tracker looks for a target's return.

A gate of size g holds the measurements z with (z - centre)' S^-1 (z - centre) <= g^2. S is the innovation covariance of
a two-dimensional measurement (Bar-Shalom, Li, Kirubarajan 2001, section 5.4.2, with gamma = g^2).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.array_checks import check_elements, check_finite, check_last_axes
from wavegym.core.arrays import Array
from wavegym.core.covariance_checks import check_positive_definite
from wavegym.core.errors import check_positive
from wavegym.sensors import gate_kernels as kernels


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
