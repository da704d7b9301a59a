"""Kernels of the Gaussian algebra of one scan: densities, gates, and the update by several possible measurements.

A measurement is (range, range-rate), or (range, range-rate, direction cosine). ``ll`` has one zero for each quantity,
so the compiler unrolls the loops. The direction cosine is measured up to multiples of 2.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import effective_snr
from wavegym.sensors.multistatic_kernels import direction_variance, folded, noise

LOG_2PI = np.log(2.0 * np.pi)


@inlined
def covariance_at(eta, wave, rate_floor, constants, R, ll):
    """Error covariance R (m, m) of a detected echo with the mean SNR ``eta``.

    wave (2, 2): covariance of range and range-rate at unit SNR.
    """
    eta = effective_snr(eta, constants.effective_table)
    R[0, 0], R[0, 1], R[1, 1] = noise(wave, eta, rate_floor)
    R[1, 0] = R[0, 1]
    if len(ll) == 3:
        R[0, 2] = R[2, 0] = R[1, 2] = R[2, 1] = 0.0
        R[2, 2] = direction_variance(eta, constants.elements)


@inlined
def factor_sum(S, R, L, ll):
    """Lower triangular L (m, m) with L L' = S + R; returns the log of the determinant of S + R."""
    determinant = 1.0
    for i in range(len(ll)):
        for j in range(i + 1):
            total = S[i, j] + R[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = np.sqrt(total) if i == j else total / L[j, j]
        determinant *= L[i, i] * L[i, i]
    return np.log(determinant)


@inlined
def whiten(z, centre, L, w, ll):
    """w (m,) = L^-1 (z - centre); returns its squared length, the squared Mahalanobis distance."""
    squared = 0.0
    for i in range(len(ll)):
        total = z[i] - centre[i]
        if i == 2:
            total = folded(total, 1.0)
        for k in range(i):
            total -= L[i, k] * w[k]
        w[i] = total / L[i, i]
        squared += w[i] * w[i]
    return squared


@inlined
def log_density(squared, log_determinant, ll):
    """Log of the normal density at a squared Mahalanobis distance."""
    return -0.5 * (squared + log_determinant + len(ll) * LOG_2PI)


@inlined
def whiten_gain(row, G, L, W, nn, ll):
    """W (m, n) = L^-1 G[row]': the gain is W' L^-1, and the covariance shrinks by W' W."""
    for j in range(len(nn)):
        for i in range(len(ll)):
            total = G[row, j, i]
            for k in range(i):
                total -= L[i, k] * W[k, j]
            W[i, j] = total / L[i, i]


@kernel
def shrink(row, P, W, share, nn, ll):
    """P[row] -= share W' W, symmetric to the last bit."""
    for j in range(len(nn)):
        for k in range(j + 1):
            total = 0.0
            for i in range(len(ll)):
                total += W[i, j] * W[i, k]
            P[row, j, k] -= share * total
            P[row, k, j] = P[row, j, k]


@kernel
def update_one(row, x, P, z, R, count, beta, centre, S, G, scratch, nn, ll):
    """Mean and covariance of the mixture of updates of x[row], P[row] by each measurement and by none.

    beta[row] (1 + count): probabilities, column 0 = missed. Each measurement i has its own covariance R[i] and hence
    its own gain K_i: P - sum beta_i K_i S_i K_i' + sum beta_i d_i d_i' - d d', d_i = K_i v_i, d = sum beta_i d_i. With
    equal R this is the update of probabilistic data association (Bar-Shalom and Fortmann 1988).
    """
    L, W, w, shift, total = scratch.L, scratch.W, scratch.w, scratch.shift, scratch.total
    n = len(nn)
    for j in range(n):
        total[j] = 0.0
    for i in range(count):
        b = beta[row, i + 1]
        if not b > 0.0:
            continue
        factor_sum(S[row], R[i], L, ll)
        whiten(z[i], centre[row], L, w, ll)
        whiten_gain(row, G, L, W, nn, ll)
        shrink(row, P, W, b, nn, ll)
        for j in range(n):
            shift[j] = 0.0
            for k in range(len(ll)):
                shift[j] += W[k, j] * w[k]
            total[j] += b * shift[j]
        for j in range(n):
            for k in range(j + 1):
                P[row, j, k] += b * shift[j] * shift[k]
                P[row, k, j] = P[row, j, k]
    for j in range(n):
        x[row, j] += total[j]
        for k in range(j + 1):
            P[row, j, k] -= total[j] * total[k]
            P[row, k, j] = P[row, j, k]
