"""The cost of a belief in compiled form; callers use ``costs.py``."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from wavegym.core.kernels import kernel


@kernel
def summed_trace(P, weights, out):
    """out (e,) = sum over targets of trace(Lambda P), Lambda = diag(weights), of P (e, target, n, n)."""
    for e in range(P.shape[0]):
        total = 0.0
        for t in range(P.shape[1]):
            for i in range(weights.shape[0]):
                total += weights[i] * P[e, t, i, i]
        out[e] = total


@kernel
def summed_weighted(P, weights, out):
    """out (e,) = sum over targets of trace(Lambda P), Lambda = weights (n, n), of P (e, target, n, n)."""
    for e in range(P.shape[0]):
        total = 0.0
        for t in range(P.shape[1]):
            for i in range(weights.shape[0]):
                for k in range(weights.shape[0]):
                    total += weights[i, k] * P[e, t, k, i]
        out[e] = total
