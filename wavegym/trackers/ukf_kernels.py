"""Compiled unscented transform of range and range-rate, for trackers and schedulers.

``e`` is the entry of the beliefs x (e, n) and P (e, n, n), and ``row`` the entry of the results. Sizes as in
``kernels.py``.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.geometry_kernels import direction_cosine, multistatic_range_and_rate, range_and_rate


@kernel
def cholesky_columns_one(row, e, P, A, nn, cc):
    """The first len(cc) columns of the lower triangular A[row] with A[row] A[row]' = P[e], from the diagonal down.

    NaN if P[e] is not positive definite.
    """
    for i in range(len(cc)):
        for j in range(i, len(nn)):
            total = P[e, j, i]
            for k in range(i):
                total -= A[row, j, k] * A[row, i, k]
            A[row, j, i] = np.sqrt(total) if j == i else total / A[row, i, i]


@inlined
def predict_measurement_one(row, e, x, P, sx, sy, A, z, S, G, nn):
    """``predict_multistatic_one`` for a monostatic radar; the compiler merges the two equal paths."""
    predict_multistatic_one(row, e, x, P, sx, sy, sx, sy, A, z, S, G, nn)


@inlined
def predict_multistatic_one(row, e, x, P, tx, ty, sx, sy, A, z, S, G, nn):
    """Mean z[row], covariance S[row] and cross-covariance G[row] = cov(x, z) (n, 2) of a target's (r, rdot).

    r is half the path from (tx, ty) over the target to (sx, sy), and rdot its rate; x = (x, y, xdot, ydot, ...). 2 n
    sigma points x +- sqrt(n) A_i of equal weight: Julier & Uhlmann (1997) with kappa = 0, which cannot give an
    indefinite S. Only the first two columns of the Cholesky factor A change the position. Along the other columns the
    range is constant and the range-rate is linear, so their exact share is that of a linear measurement with the rest
    of P. A (rows, n, n) is scratch space.
    """
    n = len(nn)
    cholesky_columns_one(row, e, P, A, nn, (0, 0))
    A[row, 0, 1] = 0.0
    reach, share = np.sqrt(np.float64(n)), 0.5 / n
    out, _ = range_and_rate(x[e, 0], x[e, 1], 0.0, 0.0, tx, ty)
    back, _ = range_and_rate(x[e, 0], x[e, 1], 0.0, 0.0, sx, sy)
    u0 = 0.5 * ((x[e, 0] - tx) / out + (x[e, 0] - sx) / back)
    u1 = 0.5 * ((x[e, 1] - ty) / out + (x[e, 1] - sy) / back)
    # differences from (r0, v0) below avoid cancellation
    r0, v0 = multistatic_range_and_rate(x[e, 0], x[e, 1], x[e, 2], x[e, 3], tx, ty, sx, sy)
    G[row, 0, 0] = G[row, 0, 1] = G[row, 1, 0] = G[row, 1, 1] = 0.0
    for j in range(2, n):
        G[row, j, 0], G[row, j, 1] = 0.0, u0 * left_one(row, e, j, 2, P, A) + u1 * left_one(row, e, j, 3, P, A)
    linear = u0 * G[row, 2, 1] + u1 * G[row, 3, 1]
    mean_r = mean_v = rr = rv = vv = 0.0
    for i in range(2):
        d0, d1, d2, d3 = reach * A[row, 0, i], reach * A[row, 1, i], reach * A[row, 2, i], reach * A[row, 3, i]
        r1, v1 = multistatic_range_and_rate(x[e, 0] + d0, x[e, 1] + d1, x[e, 2] + d2, x[e, 3] + d3, tx, ty, sx, sy)
        r2, v2 = multistatic_range_and_rate(x[e, 0] - d0, x[e, 1] - d1, x[e, 2] - d2, x[e, 3] - d3, tx, ty, sx, sy)
        r1, r2, v1, v2 = r1 - r0, r2 - r0, v1 - v0, v2 - v0
        mean_r += r1 + r2
        mean_v += v1 + v2
        rr += r1 * r1 + r2 * r2
        rv += r1 * v1 + r2 * v2
        vv += v1 * v1 + v2 * v2
        for j in range(i, n):
            G[row, j, 0] += share * reach * A[row, j, i] * (r1 - r2)
            G[row, j, 1] += share * reach * A[row, j, i] * (v1 - v2)
    mean_r, mean_v = share * mean_r, share * mean_v
    z[row, 0], z[row, 1] = r0 + mean_r, v0 + mean_v
    S[row, 0, 0] = share * rr - mean_r * mean_r
    S[row, 0, 1] = S[row, 1, 0] = share * rv - mean_r * mean_v
    S[row, 1, 1] = share * vv - mean_v * mean_v + linear


@kernel
def left_one(row, e, i, j, P, A):
    """cov(x_i, x_j) given the position: P minus the share of the first two columns of A."""
    return P[e, i, j] - A[row, i, 0] * A[row, j, 0] - A[row, i, 1] * A[row, j, 1]


@inlined
def predict_direction_one(row, e, x, P, tx, ty, sx, sy, ax, ay, A, z, S, G, nn):
    """Extend the result of ``predict_multistatic_one`` by the direction cosine at (sx, sy) with the axis (ax, ay).

    Fills z[row, 2], S[row, 2, :], S[row, :, 2] and G[row, :, 2] from the same sigma points; A[row] is the factor of
    ``predict_multistatic_one``. The cosine depends on the position only.
    """
    n = len(nn)
    reach, share = np.sqrt(np.float64(n)), 0.5 / n
    r0, v0 = multistatic_range_and_rate(x[e, 0], x[e, 1], x[e, 2], x[e, 3], tx, ty, sx, sy)
    c0 = direction_cosine(x[e, 0], x[e, 1], sx, sy, ax, ay)
    mean = rc = vc = cc = 0.0
    for j in range(n):
        G[row, j, 2] = 0.0
    for i in range(2):
        d0, d1, d2, d3 = reach * A[row, 0, i], reach * A[row, 1, i], reach * A[row, 2, i], reach * A[row, 3, i]
        r1, v1 = multistatic_range_and_rate(x[e, 0] + d0, x[e, 1] + d1, x[e, 2] + d2, x[e, 3] + d3, tx, ty, sx, sy)
        r2, v2 = multistatic_range_and_rate(x[e, 0] - d0, x[e, 1] - d1, x[e, 2] - d2, x[e, 3] - d3, tx, ty, sx, sy)
        c1 = direction_cosine(x[e, 0] + d0, x[e, 1] + d1, sx, sy, ax, ay) - c0
        c2 = direction_cosine(x[e, 0] - d0, x[e, 1] - d1, sx, sy, ax, ay) - c0
        mean += c1 + c2
        rc += (r1 - r0) * c1 + (r2 - r0) * c2
        vc += (v1 - v0) * c1 + (v2 - v0) * c2
        cc += c1 * c1 + c2 * c2
        for j in range(i, n):
            G[row, j, 2] += share * reach * A[row, j, i] * (c1 - c2)
    mean *= share
    z[row, 2] = c0 + mean
    S[row, 0, 2] = S[row, 2, 0] = share * rc - (z[row, 0] - r0) * mean
    S[row, 1, 2] = S[row, 2, 1] = share * vc - (z[row, 1] - v0) * mean
    S[row, 2, 2] = share * cc - mean * mean
