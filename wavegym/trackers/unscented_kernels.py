"""Unscented transform of range and range-rate in compiled form, for trackers and schedulers alike.

Arrays hold the targets of one environment; ``t`` is the target. Sizes as in ``kernels.py``.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.kernels import kernel
from wavegym.sensors.geometry_kernels import range_and_rate


@kernel
def cholesky_one(t, P, A, nn):
    """Lower triangular A[t] with A[t] A[t]' = P[t]; NaN where P[t] is not positive definite."""
    for i in range(len(nn)):
        for j in range(i + 1):
            total = P[t, i, j]
            for k in range(j):
                total -= A[t, i, k] * A[t, j, k]
            A[t, i, j] = np.sqrt(total) if i == j else total / A[t, j, j]


@kernel
def foresee_measurement_one(t, x, P, sx, sy, A, z, S, G, nn):
    """Mean z[t] (2), covariance S[t] (2, 2) and cross-covariance G[t] = cov(x, z) (4, 2) of (r, rdot) at (sx, sy).

    2 n sigma points x +- sqrt(n) A_i of equal weight: Julier & Uhlmann (1997) with kappa = 0, which cannot give an
    indefinite S. A (targets, n, n) is scratch space.
    """
    n = len(nn)
    cholesky_one(t, P, A, nn)
    reach, share = np.sqrt(np.float64(n)), 0.5 / n
    r0, v0 = range_and_rate(x[t, 0], x[t, 1], x[t, 2], x[t, 3], sx, sy)  # differences from it lose no digits
    mean_r = mean_v = rr = rv = vv = 0.0
    for j in range(n):
        G[t, j, 0] = G[t, j, 1] = 0.0
    for i in range(n):
        for j in range(i):
            A[t, j, i] = 0.0
        d0, d1, d2, d3 = reach * A[t, 0, i], reach * A[t, 1, i], reach * A[t, 2, i], reach * A[t, 3, i]
        r1, v1 = range_and_rate(x[t, 0] + d0, x[t, 1] + d1, x[t, 2] + d2, x[t, 3] + d3, sx, sy)
        r2, v2 = range_and_rate(x[t, 0] - d0, x[t, 1] - d1, x[t, 2] - d2, x[t, 3] - d3, sx, sy)
        r1, r2, v1, v2 = r1 - r0, r2 - r0, v1 - v0, v2 - v0
        mean_r += r1 + r2
        mean_v += v1 + v2
        rr += r1 * r1 + r2 * r2
        rv += r1 * v1 + r2 * v2
        vv += v1 * v1 + v2 * v2
        for j in range(i, n):
            G[t, j, 0] += share * reach * A[t, j, i] * (r1 - r2)
            G[t, j, 1] += share * reach * A[t, j, i] * (v1 - v2)
    mean_r, mean_v = share * mean_r, share * mean_v
    z[t, 0], z[t, 1] = r0 + mean_r, v0 + mean_v
    S[t, 0, 0] = share * rr - mean_r * mean_r
    S[t, 0, 1] = S[t, 1, 0] = share * rv - mean_r * mean_v
    S[t, 1, 1] = share * vv - mean_v * mean_v
