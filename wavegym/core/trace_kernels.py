"""The cost of a belief in compiled form; callers use ``costs.py``."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from wavegym.core.kernels import kernel
from wavegym.core.lane_array_kernels import gathered, scatter
from wavegym.core.lane_kernels import LANES, rows_from


@kernel
def summed_trace(P, weights, out):
    """out (e,) = sum over targets of trace(Lambda P), Lambda = diag(weights), of P (e, target, n, n)."""
    count, targets, n, _ = P.shape
    for first in range(0, count, LANES):
        rows = rows_from(first, count)
        total = 0.0 * rows
        for t in range(targets):
            for i in range(n):
                total += weights[i] * gathered(P, (rows, t, i, i))
        scatter(out, (rows,), total)


@kernel
def summed_weighted(P, weights, out):
    """out (e,) = sum over targets of trace(Lambda P), Lambda = weights (n, n), of P (e, target, n, n)."""
    count, targets, n, _ = P.shape
    for first in range(0, count, LANES):
        rows = rows_from(first, count)
        total = 0.0 * rows
        for t in range(targets):
            for i in range(n):
                for k in range(n):
                    total += weights[i, k] * gathered(P, (rows, t, k, i))
        scatter(out, (rows,), total)
