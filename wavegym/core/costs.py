"""The cost of a belief."""

from __future__ import annotations

import numpy as np

from wavegym.core.arrays import Array, for_kernel
from wavegym.core.trace_kernels import summed_trace, summed_weighted


def trace_cost(covariance: Array, weights: Array) -> Array:
    """Sum over targets of trace(Lambda P), (...), for P (..., target, n, n).

    weights: Lambda (n, n), or its diagonal (n,).
    """
    lead = covariance.shape[:-3]
    P = for_kernel(covariance).reshape(-1, *covariance.shape[-3:])
    cost = np.empty(len(P))
    (summed_weighted if weights.ndim == 2 else summed_trace)(P, weights, cost)
    return cost.reshape(lead)
