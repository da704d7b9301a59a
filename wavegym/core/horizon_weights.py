"""A linear cost, and the weight of a covariance in the costs of future steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import Array
from wavegym.core.errors import check_int


class LinearCost:
    """A cost trace(Lambda P), summed over targets whose motion is linear.

    Args:
        F: transition, (n, n).
        weights: Lambda (n, n), or its diagonal (n,).
    """

    def __init__(self, F: Array, weights: ArrayLike) -> None:
        self.F, self.weights = F, weights
        self._made: dict[int, Array] = {}

    def weights_ahead(self, ahead: int) -> Array:
        """``horizon_weights`` of 1, 2, ... ``ahead`` steps, (ahead, n, n); made once."""
        if ahead not in self._made:
            steps = range(1, check_int("ahead", ahead, 1) + 1)
            self._made[ahead] = np.stack([horizon_weights(self.F, self.weights, k) for k in steps])
        return self._made[ahead]


def horizon_weights(F: ArrayLike, weights: ArrayLike, ahead: int) -> Array:
    """M with trace(M P) = sum over l < ahead of trace(Lambda F^l P F'^l), the share of P in the future costs.

    Without further measurements the covariance after l steps is F^l P F'^l plus noise that no measurement changes.
    Hence a measurement that reduces P by D reduces the summed cost of ``ahead`` steps by trace(M D).

    Args:
        F: transition, (n, n).
        weights: Lambda (n, n), or its diagonal (n,).
        ahead: L, steps, the step of the measurement included.

    Returns:
        (n, n), symmetric.

    Raises:
        InputError: fewer than one step.
    """
    F, power = np.asarray(F, np.float64), np.eye(len(np.asarray(F)))
    M, given = np.zeros_like(F), np.asarray(weights, np.float64)
    Lambda = np.diag(given) if given.ndim == 1 else given
    for _ in range(check_int("ahead", ahead, 1)):
        M += power.T @ Lambda @ power
        power = F @ power
    return M
