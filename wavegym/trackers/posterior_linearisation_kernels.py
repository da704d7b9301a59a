"""Posterior linearisation in compiled form: the update where a wide prior meets a fine, curved measurement.

The extended Kalman filter linearises a measurement at the predicted mean, and keeps no account of what it neglects.
Here the measurement is regressed on the state over the spread of a Gaussian, z = h + H (x - mean) + residual; the
variance of the residual adds to that of the measurement. The regression is repeated over the updated estimate, until
it moves no more (García-Fernández, Svensson, Morelande and Särkkä, "Posterior linearization filter: principles and
implementation using sigma points", IEEE Trans. Signal Process. 63(20), 2015, section III).

A system writes the measurements of the points of ``spread_points_one`` itself, because only it knows the measurement.
Shapes: n states, m measured quantities, 2 n points; A (1, n, n) is the lower Cholesky factor of the covariance.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined
from wavegym.trackers.rank_one_kernels import absorb_rows_one
from wavegym.trackers.ukf_kernels import cholesky_columns_one


@inlined
def spread_points_one(at, P, i, A, points, nn):
    """points (2 n, n): at[0] + sqrt(n) A_k and at[0] - sqrt(n) A_k for each column k of A, A A' = P[i].

    The cubature points of the filter of Arasaratnam and Haykin (2009): equal weights, exact for cubic polynomials.
    """
    n = len(nn)
    reach = np.sqrt(np.float64(n))
    cholesky_columns_one(0, i, P, A, nn, nn)
    for k in range(n):
        for a in range(n):
            away = reach * A[0, a, k] if a >= k else 0.0
            points[2 * k, a], points[2 * k + 1, a] = at[0, a] + away, at[0, a] - away


@inlined
def regress_one(Z, A, h, H, residual, nn):
    """Statistical linear regression of the measurements Z (2 n, m) of the points: h (m,), H (m, n), residual (m,).

    With B_k = (z+ - z-) / (2 sqrt(n)), H = B A^-1. The residual's variance is the mean square of half the second
    differences s_k = z+ + z- - 2 h, which is exact and never negative. Residuals count as uncorrelated.
    """
    n = len(nn)
    share = 0.5 / np.sqrt(np.float64(n))
    for a in range(Z.shape[1]):
        total = 0.0
        for k in range(2 * n):
            total += Z[k, a]
        h[a], squares = total / (2 * n), 0.0
        for k in range(n - 1, -1, -1):
            bend = Z[2 * k, a] + Z[2 * k + 1, a] - 2.0 * h[a]
            squares += bend * bend
            rest = share * (Z[2 * k, a] - Z[2 * k + 1, a])
            for b in range(k + 1, n):
                rest -= H[a, b] * A[0, b, k]
            H[a, k] = rest / A[0, k, k]
        residual[a] = squares / (4 * n)


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
    P[i] = prior
    absorb_rows_one(i, P, H, y, R, d, v, nn)
    moved = 0.0
    for k in range(len(nn)):
        step = x[i, k] + d[k] - at[0, k]
        moved = max(moved, step * step / P[i, k, k])
        at[0, k] = x[i, k] + d[k]
    return moved
