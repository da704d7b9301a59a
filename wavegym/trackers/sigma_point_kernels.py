"""Compiled sigma points, and posterior linearisation of a measurement with them.

2 n points p +- sqrt(n) A_k of equal weight with A A' = S: Julier & Uhlmann (1997) with kappa = 0, which cannot give an
indefinite covariance. ``i`` is the entry of a batch of means p (i, n) and covariances S (i, n, n); points (2 n, n);
A (n, n), lower triangular; m measured quantities.

The extended Kalman filter linearises at the predicted mean and ignores the linearisation error, which is large for a
wide prior and an accurate, curved measurement. Posterior linearisation regresses the measurement on the state over the
spread of a Gaussian, z = h + H (x - mean) + residual. The variance of the residual is added to that of the measurement.
The regression is repeated over the updated estimate until it converges (García-Fernández, Svensson, Morelande and
Särkkä, "Posterior linearization filter: principles and implementation using sigma points", IEEE Trans. Signal Process.
63(20), 2015, section III). A system measures the sigma points itself, because only it knows the measurement.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.array_kernels import copy_matrix
from wavegym.core.kernels import inlined
from wavegym.trackers.kernels import absorb_rows_one


@inlined
def cholesky_one(i, S, A, n):
    """The lower triangle of A (n, n) with A A' = S[i]; a pivot that rounding made negative counts as 0."""
    for a in range(n):
        for b in range(a, n):
            total = S[i, b, a]
            for k in range(a):
                total -= A[b, k] * A[a, k]
            if a == b:
                A[a, a] = np.sqrt(max(total, 0.0))
            else:
                A[b, a] = total / A[a, a] if A[a, a] > 0.0 else 0.0


@inlined
def sigma_points_one(i, p, S, A, points, nn):
    """Fill A and the points: 2 k and 2 k + 1 lie on both sides of the mean along column k of A."""
    n = len(nn)
    cholesky_one(i, S, A, n)
    reach = np.sqrt(np.float64(n))
    for k in range(n):
        for a in range(n):
            step = reach * A[a, k] if a >= k else 0.0
            points[2 * k, a], points[2 * k + 1, a] = p[i, a] + step, p[i, a] - step


@inlined
def moments_one(i, points, p, S, nn):
    """Mean p[i] and covariance S[i] of points (m, n) of equal weight."""
    n, m = len(nn), points.shape[0]
    for a in range(n):
        total = 0.0
        for k in range(m):
            total += points[k, a] - points[0, a]
        p[i, a] = points[0, a] + total / m
    for a in range(n):
        for b in range(a + 1):
            total = 0.0
            for k in range(m):
                total += (points[k, a] - p[i, a]) * (points[k, b] - p[i, b])
            S[i, a, b] = S[i, b, a] = total / m


@inlined
def regression_one(a, values, A, slope, nn):
    """Statistical linear regression of values (2 n, rows), column a, on the state: fills slope (rows, n), row a.

    Returns the mean of the values. ``values[2 k]`` becomes the residual of points 2 k and 2 k + 1: the covariance of
    the linearisation errors of rows a and b is the mean over k of values[2 k, a] values[2 k, b].
    """
    n = len(nn)
    middle = 0.0
    for k in range(2 * n):
        middle += values[k, a] - values[0, a]
    middle = values[0, a] + middle / (2 * n)
    reach = np.sqrt(np.float64(n))
    for back in range(n):
        k = n - 1 - back
        total = 0.5 * (values[2 * k, a] - values[2 * k + 1, a]) / reach
        for b in range(k + 1, n):
            total -= slope[a, b] * A[b, k]
        slope[a, k] = total / A[k, k] if A[k, k] > 0.0 else 0.0
        values[2 * k, a] = 0.5 * (values[2 * k, a] + values[2 * k + 1, a]) - middle
    return middle


@inlined
def regress_one(Z, A, h, H, R, nn):
    """Regress the measurements Z (2 n, m) of sigma points on the state: fills h (m,) and H (m, n); overwrites Z.

    Adds the variance of the residual to the variance R (m,). Residuals are treated as uncorrelated.
    """
    for a in range(len(R)):
        h[a] = regression_one(a, Z, A, H, nn)
        for k in range(len(nn)):
            R[a] += Z[2 * k, a] * Z[2 * k, a] / len(nn)


@inlined
def update_from_one(i, x, P, prior, at, z, h, H, R, y, d, v, nn):
    """Update the prediction x[i], ``prior`` (n, n) with z (m,), whose regression h, H was made around ``at`` (1, n).

    Writes P[i] and the new estimate to ``at``; R (m,) are the variances, infinite for missing measurements. Returns
    the largest squared movement of the estimate, in units of its variances.
    """
    for a in range(len(R)):
        y[a] = z[a] - h[a]
        for k in range(len(nn)):
            y[a] += H[a, k] * (at[0, k] - x[i, k])
    copy_matrix(prior, P[i])
    absorb_rows_one(i, P, H, y, R, d, v, nn)
    moved = 0.0
    for k in range(len(nn)):
        step = x[i, k] + d[k] - at[0, k]
        moved = max(moved, step * step / P[i, k, k])
        at[0, k] = x[i, k] + d[k]
    return moved
