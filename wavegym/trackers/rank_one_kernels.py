"""Measurement updates one scalar at a time, exact for independent measurement errors; in compiled form.

With a diagonal R, [P^-1 + H' R^-1 H]^-1 is one rank-one update for each row h of H (Sherman and Morrison), without a
matrix inverse: P - v v' / s with v = P h, s = h'v + variance. A missing measurement has an infinite variance.
``cc`` holds the columns in which a row may differ from 0, known at compile time: position columns alone halve the work.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.copy_kernels import copy_matrix
from wavegym.core.kernels import batched, inlined


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
    """d (n,) += v (y - h'd) / s: d is the correction of the mean so far; y is an innovation at the predicted mean."""
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
