"""Compiled Kalman prediction and update; ``kalman.py`` has the public functions.

The sizes n and m are given as tuples ``nn`` and ``mm`` of n and m zeros. The length of a tuple is part of its type, so
the compiler unrolls the small loops: five times faster than sizes read from the arrays.
The ``*_one`` functions work on entry ``e`` of a batch, because indexing a whole array is three times faster in compiled
code than taking a view. The fused kernels of the systems call them too.
A matrix that is not positive definite gives NaN, never an exception: a kernel must not stop in the middle of a batch.

If measurement errors are independent, updates with one scalar at a time are exact. With a diagonal R,
[P^-1 + H' R^-1 H]^-1 is one rank-one update for each row h of H (Sherman and Morrison), without a matrix inverse:
P - v v' / s with v = P h, s = h'v + variance. A missing measurement has an infinite variance. ``cc`` holds the columns
in which a row may differ from 0, known at compile time. With position columns only, the work is halved.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.array_kernels import copy_matrix
from wavegym.core.kernels import batched, inlined, kernel


@inlined
def predict_mean_one(e, x, F, f, x_out, nn):
    """x_out[e] = F[f] x[e]."""
    for i in range(len(nn)):
        total = 0.0
        for k in range(len(nn)):
            total += F[f, i, k] * x[e, k]
        x_out[e, i] = total


@inlined
def predict_covariance_one(e, P, F, Q, f, T, P_out, nn):
    """P_out[e] = F[f] P[e] F[f]' + Q[f]. T (n, n) is scratch space; P_out may be P itself."""
    n = len(nn)
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += F[f, i, k] * P[e, k, j]
            T[i, j] = total
    for i in range(n):
        for j in range(i + 1):
            total = Q[f, i, j]
            for k in range(n):
                total += T[i, k] * F[f, j, k]
            P_out[e, i, j] = total
            P_out[e, j, i] = total


@kernel
def factor_innovation_one(e, P, H, h, R, r, scale, L, D, V, nn, mm):
    """Innovation covariance S = H[h] P[e] H[h]' + scale R[r] = L diag(1/D) L', L unit lower triangular (m, m), D (m,).

    V (n, m) = P H' L^-T, so that the gain is K = V diag(D) L^-1 and K S K' = V diag(D) V'. This takes m divisions and
    no square root. D is NaN if S is not positive definite.
    """
    n, m = len(nn), len(mm)
    for i in range(n):
        for j in range(m):
            total = 0.0
            for k in range(n):
                total += P[e, i, k] * H[h, j, k]
            V[i, j] = total
    for j in range(m):
        for i in range(j, m):
            total = scale * R[r, i, j]
            for k in range(n):
                total += H[h, i, k] * V[k, j]
            L[i, j] = total
    for j in range(m):
        D[j] = 1.0 / L[j, j] if L[j, j] > 0.0 else np.nan
        for i in range(j + 1, m):
            for k in range(j + 1, i + 1):
                L[i, k] -= L[i, j] * L[k, j] * D[j]
        for i in range(j + 1, m):
            L[i, j] *= D[j]
            for k in range(n):
                V[k, i] -= L[i, j] * V[k, j]


@kernel
def update_covariance_one(e, P, D, V, o, P_out, nn, mm):
    """P_out[o] = P[e] - V diag(D) V', symmetric by construction."""
    n, m = len(nn), len(mm)
    for i in range(n):
        for j in range(i + 1):
            total = P[e, i, j]
            for k in range(m):
                total -= V[i, k] * V[j, k] * D[k]
            P_out[o, i, j] = total
            P_out[o, j, i] = total


@kernel
def update_mean_one(e, x, y, L, D, V, w, x_out, nn, mm):
    """x_out[e] = x[e] + V diag(D) w with w (m,) = L^-1 y[e]; sum D w^2 is the normalised innovation squared.

    x_out may be x itself.
    """
    n, m = len(nn), len(mm)
    for j in range(m):
        total = y[e, j]
        for k in range(j):
            total -= L[j, k] * w[k]
        w[j] = total
    for i in range(n):
        total = x[e, i]
        for j in range(m):
            total += V[i, j] * D[j] * w[j]
        x_out[e, i] = total


@batched("(n),(n,n),(n,n),(n,n)->(n),(n,n)")
def predict(x, P, F, Q, x_out, P_out, nn):
    """x' = F x, P' = F P F' + Q."""
    T = np.empty((len(nn), len(nn)))
    for e in range(x.shape[0]):
        predict_mean_one(e, x, F, e, x_out, nn)
        predict_covariance_one(e, P, F, Q, e, T, P_out, nn)


@batched("(n,n),(n,n),(n,n)->(n,n)")
def predict_covariance(P, F, Q, P_out, nn):
    """P' = F P F' + Q."""
    T = np.empty((len(nn), len(nn)))
    for e in range(P.shape[0]):
        predict_covariance_one(e, P, F, Q, e, T, P_out, nn)


@inlined
def update_one(e, x, P, y, H, R, L, D, V, w, x_out, P_out, nn, mm):
    """x' = x + K y, P' = P - K S K' of row e. L, D, V, w: scratch; S = L diag(1 / D) L' and w = L^-1 y afterwards."""
    factor_innovation_one(e, P, H, e, R, e, 1.0, L, D, V, nn, mm)
    update_mean_one(e, x, y, L, D, V, w, x_out, nn, mm)
    update_covariance_one(e, P, D, V, e, P_out, nn, mm)


@batched("(n),(n,n),(m),(m,n),(m,m)->(n),(n,n)")
def update(x, P, y, H, R, x_out, P_out, nn, mm):
    """``update_one`` for a batch."""
    n, m = len(nn), len(mm)
    L, D, V, w = np.empty((m, m)), np.empty(m), np.empty((n, m)), np.empty(m)
    for e in range(x.shape[0]):
        update_one(e, x, P, y, H, R, L, D, V, w, x_out, P_out, nn, mm)


@batched("(n,n),(m,n),(m,m)->(n,n)")
def update_covariance(P, H, R, P_out, nn, mm):
    """P' = P - K S K'."""
    n, m = len(nn), len(mm)
    L, D, V = np.empty((m, m)), np.empty(m), np.empty((n, m))
    for e in range(P.shape[0]):
        factor_innovation_one(e, P, H, e, R, e, 1.0, L, D, V, nn, mm)
        update_covariance_one(e, P, D, V, e, P_out, nn, mm)


@kernel
def squared_mahalanobis_one(e, d, P, L, nn):
    """d' P[e]^-1 d by Cholesky factorisation: L (n, n) becomes the factor and d (n,) L^-1 d."""
    total = 0.0
    for i in range(len(nn)):
        for j in range(i + 1):
            value = P[e, i, j]
            for k in range(j):
                value -= L[i, k] * L[j, k]
            L[i, j] = np.sqrt(value) if i == j else value / L[j, j]
        value = d[i]
        for k in range(i):
            value -= L[i, k] * d[k]
        d[i] = value / L[i, i]
        total += d[i] * d[i]
    return total


@batched("(n),(n,n)->()")
def squared_mahalanobis(d, P, out, nn):
    """d' P^-1 d."""
    L, w = np.empty((len(nn), len(nn))), np.empty(len(nn))
    for e in range(d.shape[0]):
        for i in range(len(nn)):
            w[i] = d[e, i]
        out[e] = squared_mahalanobis_one(e, w, P, L, nn)


@inlined
def spread_one(e, P, H, a, cc):
    """h'P[e] h with h = H[a]: the variance of the predicted quantity."""
    total = 0.0
    for i in cc:
        value = 0.0
        for k in cc:
            value += P[e, i, k] * H[a, k]
        total += H[a, i] * value
    return total


@inlined
def gain_one(e, P, H, a, v, nn, cc):
    """v (n,) = P[e] h with h = H[a]; returns h'P h, the predicted quantity's variance."""
    total = 0.0
    for i in range(len(nn)):
        value = 0.0
        for k in cc:
            value += P[e, i, k] * H[a, k]
        v[i] = value
    for i in cc:
        total += H[a, i] * v[i]
    return total


@inlined
def shrink_one(e, P, v, s, nn):
    """P[e] -= v v' / s, symmetric by construction."""
    inverse = 1.0 / s
    for i in range(len(nn)):
        share = v[i] * inverse
        for j in range(i + 1):
            value = P[e, i, j] - share * v[j]
            P[e, i, j] = value
            P[e, j, i] = value


@inlined
def correct_one(d, H, a, v, s, y, nn):
    """d (n,) += v (y - h'd) / s: d is the correction of the mean so far; y is the innovation at the predicted mean."""
    rest = y
    for i in range(len(nn)):
        rest -= H[a, i] * d[i]
    rest /= s
    for i in range(len(nn)):
        d[i] += v[i] * rest


@inlined
def absorb_rows_one(e, P, H, y, variance, d, v, nn):
    """d (n,) = K y and P[e] = [P[e]^-1 + H' R^-1 H]^-1, R = diag(variance); rows of infinite variance are left out."""
    for k in range(len(nn)):
        d[k] = 0.0
    for a in range(len(variance)):
        if variance[a] < np.inf:
            s = gain_one(e, P, H, a, v, nn, range(len(nn))) + variance[a]
            correct_one(d, H, a, v, s, y[a], nn)
            shrink_one(e, P, v, s, nn)


@batched("(n),(n,n),(m),(m,n),(m)->(n),(n,n)")
def rank_one_update(x, P, y, H, variance, x_out, P_out, nn, mm):
    """x' = x + K y, P' = [P^-1 + H' R^-1 H]^-1, R = diag(variance); rows of infinite variance are left out."""
    n = len(nn)
    v, d = np.empty(n), np.empty(n)
    for e in range(x.shape[0]):
        copy_matrix(P[e], P_out[e])
        absorb_rows_one(e, P_out, H[e], y[e], variance[e], d, v, nn)
        for i in range(n):
            x_out[e, i] = x[e, i] + d[i]
