"""Posterior linearisation in compiled form: the update where a wide prior meets a fine, curved measurement.

The extended Kalman filter linearises a measurement at the predicted mean, and keeps no account of what it neglects.
Here the measurement is regressed on the state over the spread of a Gaussian, z = h + H (x - mean) + residual; the
variance of the residual adds to that of the measurement. The regression is repeated over the updated estimate, until
it moves no more (García-Fernández, Svensson, Morelande and Särkkä, "Posterior linearization filter: principles and
implementation using sigma points", IEEE Trans. Signal Process. 63(20), 2015, section III).

A system measures the sigma points itself, because only it knows the measurement; see ``sigma_point_kernels``.
Shapes: n states, m measured quantities, 2 n points.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from wavegym.core.copy_kernels import copy_matrix
from wavegym.core.kernels import inlined
from wavegym.trackers.rank_one_kernels import absorb_rows_one
from wavegym.trackers.sigma_point_kernels import regression_one


@inlined
def regress_one(Z, A, h, H, R, nn):
    """Regress the measurements Z (2 n, m) of sigma points on the state: fills h (m,) and H (m, n); overwrites Z.

    Adds the variance of the residual to the variance R (m,). Residuals count as uncorrelated.
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
