"""The cost of a belief, now and over the steps to come."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.errors import whole
from wavegym.systems.trace_kernels import summed_trace

Array = NDArray[Any]


def trace_cost(covariance: Array, weights: Array) -> Array:
    """Sum over targets of trace(Lambda P), Lambda = diag(weights): (...) for P (..., target, n, n), weights (n,)."""
    lead = covariance.shape[:-3]
    P = np.ascontiguousarray(covariance).reshape(-1, *covariance.shape[-3:])
    cost = np.empty(len(P))
    summed_trace(P, weights, cost)
    return cost.reshape(lead)


def horizon_weights(F: ArrayLike, weights: ArrayLike, ahead: int) -> Array:
    """M with trace(M P) = sum over l < ahead of trace(Lambda F^l P F'^l), the share of P in the costs to come.

    Without further measurements the covariance l steps on is F^l P F'^l and noise that no look changes, so what a look
    takes off the summed cost of ``ahead`` steps is linear in the difference that it makes to P.

    Args:
        F: transition, (n, n).
        weights: diagonal of Lambda, (n,).
        ahead: L, steps, the one of the look included.

    Returns:
        (n, n), symmetric.

    Raises:
        InputError: fewer than one step.
    """
    F, power = np.asarray(F, np.float64), np.eye(len(np.asarray(F)))
    M = np.zeros_like(F)
    for _ in range(whole("ahead", ahead, 1)):
        M += power.T * np.asarray(weights) @ power
        power = F @ power
    return M
