"""Compiled interacting multiple models; ``imm.py`` has the public functions.

A track has one mean and one covariance for each model. x (rows, n) and P (rows, n, n) hold them track after track: the
rows of track ``t`` begin at t * models. ``mm`` has one zero for each model, ``nn`` one for each state component.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.array_kernels import copy_matrices, copy_matrix
from wavegym.core.kernels import batched, inlined, kernel
from wavegym.trackers.jpda_kernels import gain_one, shrink_one
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one, update_one
from wavegym.trackers.ukf_kernels import predict_multistatic_one

LOG_2PI = np.log(2.0 * np.pi)


@inlined
def mix_one(t, x, P, mu, s, transition, c, X, PP, nn, mm):
    """Mixed X[row], PP[row] of each model from all models' x, P, and c[t] = predicted model probabilities.

    transition[s] (models, models): from row to column. A model with c = 0 keeps its own x and P.
    """
    M, n, first = len(mm), len(nn), t * len(mm)
    for j in range(M):
        total = 0.0
        for i in range(M):
            total += transition[s, i, j] * mu[t, i]
        c[t, j] = total
        row = first + j
        for k in range(n):
            mean = x[row, k] if total == 0.0 else 0.0
            for i in range(M if total > 0.0 else 0):
                mean += transition[s, i, j] * mu[t, i] / total * x[first + i, k]
            X[row, k] = mean
        for k in range(n):
            for m in range(k + 1):
                value = P[row, k, m] if total == 0.0 else 0.0
                for i in range(M if total > 0.0 else 0):
                    spread = (x[first + i, k] - X[row, k]) * (x[first + i, m] - X[row, m])
                    value += transition[s, i, j] * mu[t, i] / total * (P[first + i, k, m] + spread)
                PP[row, k, m] = PP[row, m, k] = value


@inlined
def combine_one(t, x, P, mu, x_out, P_out, nn, mm):
    """Mean x_out[t] and covariance P_out[t] of the mixture of track t's models."""
    M, n, first = len(mm), len(nn), t * len(mm)
    for k in range(n):
        total = 0.0
        for i in range(M):
            total += mu[t, i] * x[first + i, k]
        x_out[t, k] = total
    for k in range(n):
        for m in range(k + 1):
            total = 0.0
            for i in range(M):
                spread = (x[first + i, k] - x_out[t, k]) * (x[first + i, m] - x_out[t, m])
                total += mu[t, i] * (P[first + i, k, m] + spread)
            P_out[t, k, m] = P_out[t, m, k] = total


@inlined
def reweigh_one(t, c, log_likelihood, mu, mm):
    """mu[t] from the predicted c[t] and log_likelihood[t]; scaled to a greatest likelihood of 1, to avoid underflow."""
    best = -np.inf
    for j in range(len(mm)):
        if c[t, j] > 0.0:
            best = max(best, log_likelihood[t, j])
    total = 0.0
    for j in range(len(mm)):
        mu[t, j] = c[t, j] * np.exp(log_likelihood[t, j] - best) if c[t, j] > 0.0 else 0.0
        total += mu[t, j]
    for j in range(len(mm)):
        mu[t, j] /= total


@inlined
def squared_length(d0, d1, s00, s01, s11):
    """d' S^-1 d in two dimensions, and det S."""
    determinant = s00 * s11 - s01 * s01
    return (s11 * d0 * d0 - 2.0 * s01 * d0 * d1 + s00 * d1 * d1) / determinant, determinant


@inlined
def log_density_one(row, d0, d1, S):
    """Log of N(d; 0, S[row]) in two dimensions; NaN if S[row] is not positive definite."""
    if not S[row, 0, 0] > 0.0:
        return np.nan
    squared, determinant = squared_length(d0, d1, S[row, 0, 0], S[row, 0, 1], S[row, 1, 1])
    return -0.5 * (squared + np.log(determinant)) - LOG_2PI


@batched("(m,n),(m,n,n),(m),(m,m)->(m,n),(m,n,n),(m)")
def mix(x, P, mu, transition, X, PP, c, mm, nn):
    """``mix_one`` for a batch."""
    E, M, n = len(x), len(mm), len(nn)
    rows, squares = x.reshape(E * M, n), P.reshape(E * M, n, n)
    X, PP = X.reshape(E * M, n), PP.reshape(E * M, n, n)
    for e in range(E):
        mix_one(e, rows, squares, mu, e, transition, c, X, PP, nn, mm)


@batched("(m,n),(m,n,n),(m)->(n),(n,n)")
def combine(x, P, mu, x_out, P_out, mm, nn):
    """``combine_one`` for a batch."""
    E, M, n = len(x), len(mm), len(nn)
    rows, squares = x.reshape(E * M, n), P.reshape(E * M, n, n)
    for e in range(E):
        combine_one(e, rows, squares, mu, x_out, P_out, nn, mm)


@batched("(m),(m)->(m)")
def reweigh(c, log_likelihood, mu, mm):
    """``reweigh_one`` for a batch."""
    for e in range(len(c)):
        reweigh_one(e, c, log_likelihood, mu, mm)


@batched("(n),(n,n),(m),(m,n),(m,m)->(n),(n,n),()")
def kalman_update(x, P, y, H, R, x_out, P_out, log_likelihood, nn, mm):
    """The Kalman update of a batch, with the log likelihood of each innovation: log N(y; 0, H P H' + R)."""
    n, m = len(nn), len(mm)
    L, D, V, w = np.empty((m, m)), np.empty(m), np.empty((n, m)), np.empty(m)
    for e in range(x.shape[0]):
        update_one(e, x, P, y, H, R, L, D, V, w, x_out, P_out, nn, mm)
        total = -m * LOG_2PI
        for j in range(m):
            total += np.log(D[j]) - w[j] * w[j] * D[j]
        log_likelihood[e] = 0.5 * total


@inlined
def ukf_update_one(row, x, P, z0, z1, R, r, tx, ty, sx, sy, A, z, S, G, K, nn):
    """Update x[row], P[row] by (z0, z1) with covariance R[r]; return its log likelihood. A, z, S, G, K are scratch."""
    predict_multistatic_one(row, row, x, P, tx, ty, sx, sy, A, z, S, G, nn)
    S[row, 0, 0] += R[r, 0, 0]
    S[row, 0, 1] += R[r, 0, 1]
    S[row, 1, 0] += R[r, 1, 0]
    S[row, 1, 1] += R[r, 1, 1]
    d0, d1 = z0 - z[row, 0], z1 - z[row, 1]
    gain_one(row, G, S, K, nn)
    for i in range(len(nn)):
        x[row, i] += K[i, 0] * d0 + K[i, 1] * d1
    shrink_one(row, P, K, S[row, 0, 0], S[row, 0, 1], S[row, 1, 1], nn)
    return log_density_one(row, d0, d1, S)


@batched("(n),(n,n),(b),(b,b),(a),(a)->(n),(n,n),()")
def ukf_update(x, P, measurement, R, transmitter, receiver, x_out, P_out, log_likelihood, nn, bb, aa):
    """``ukf_update_one`` for a batch: x_out, P_out and the log likelihood of each measurement."""
    E, n = len(x), len(nn)
    copy_matrix(x, x_out)
    copy_matrices(P, P_out)
    A, z, S, G, K = np.empty((E, n, n)), np.empty((E, 2)), np.empty((E, 2, 2)), np.empty((E, n, 2)), np.empty((n, 2))
    for e in range(E):
        log_likelihood[e] = ukf_update_one(
            e, x_out, P_out, measurement[e, 0], measurement[e, 1], R, e,
            transmitter[e, 0], transmitter[e, 1], receiver[e, 0], receiver[e, 1], A, z, S, G, K, nn,
        )  # fmt: skip


@kernel
def scan(x, P, mu, measurement, R, transmitter, receiver, F, Q, transition, nn, mm):
    """Mix, predict and update x (track, model, n), P and mu in place by one measurement of each track."""
    E, M, n = len(x), len(mm), len(nn)
    rows, squares = x.reshape(E * M, n), P.reshape(E * M, n, n)
    X, PP, c, log_likelihood = np.empty((E * M, n)), np.empty((E * M, n, n)), np.empty((E, M)), np.empty((E, M))
    A, z, S = np.empty((E * M, n, n)), np.empty((E * M, 2)), np.empty((E * M, 2, 2))
    G, K, T = np.empty((E * M, n, 2)), np.empty((n, 2)), np.empty((n, n))
    for e in range(E):
        mix_one(e, rows, squares, mu, 0, transition, c, X, PP, nn, mm)
        for j in range(M):
            row = e * M + j
            predict_mean_one(row, X, F, j, rows, nn)
            predict_covariance_one(row, PP, F, Q, j, T, squares, nn)
            log_likelihood[e, j] = ukf_update_one(
                row, rows, squares, measurement[e, 0], measurement[e, 1], R, e,
                transmitter[0], transmitter[1], receiver[0], receiver[1], A, z, S, G, K, nn,
            )  # fmt: skip
        reweigh_one(e, c, log_likelihood, mu, mm)
