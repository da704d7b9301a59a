"""Compiled loops over arrays that all systems share: copies, boxes of actions, traces and checks of matrices.

Copies are loops because Numba takes three seconds to compile ``out[:] = source``: it adds a check of the shapes. A
matrix is tested by its Cholesky factorisation, which is faster than its eigenvalues. ``covariances.py`` has the
functions that raise errors, and the cost.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel

# Relative rounding error that a covariance may carry: single precision, or an update that cancels digits.
ROUNDING = 1e-6


@kernel
def copy_vector(source, out):
    """Copy source (n,) to out (n,)."""
    for i in range(len(out)):
        out[i] = source[i]


@kernel
def copy_matrix(source, out):
    """Copy source (n, m) to out (n, m)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = source[i, j]


@kernel
def copy_matrices(source, out):
    """Copy source (k, n, m) to out (k, n, m)."""
    for i in range(len(out)):
        copy_matrix(source[i], out[i])


@kernel
def summed_trace(P, weights, out):
    """out (e,) = sum over targets of trace(Lambda P), Lambda = diag(weights), of P (e, target, n, n)."""
    for e in range(P.shape[0]):
        total = 0.0
        for t in range(P.shape[1]):
            for i in range(weights.shape[0]):
                total += weights[i] * P[e, t, i, i]
        out[e] = total


@kernel
def summed_weighted(P, weights, out):
    """out (e,) = sum over targets of trace(Lambda P), Lambda = weights (n, n), of P (e, target, n, n)."""
    for e in range(P.shape[0]):
        total = 0.0
        for t in range(P.shape[1]):
            for i in range(weights.shape[0]):
                for k in range(weights.shape[0]):
                    total += weights[i, k] * P[e, t, k, i]
        out[e] = total


@kernel
def decode(action, low, high, width, log, value):
    """Fill value (e, d) with the physical values of a box's actions in [-1, 1]; bounds and scales are (d,).

    Where ``log`` is True, ``width`` is the width of the logarithm. Returns whether all actions are inside the box.
    """
    inside = True
    for e in range(action.shape[0]):
        for i in range(action.shape[1]):
            steps = 0.5 * (action[e, i] + 1.0) * width[i]
            raw = low[i] * np.exp(steps) if log[i] else low[i] + steps
            value[e, i] = min(max(raw, low[i]), high[i])
            inside = inside and abs(action[e, i]) <= 1.0
    return inside


@inlined
def symmetric_one(e, A, nn):
    """Whether A[e] is finite and symmetric up to rounding, relative to the two diagonal entries."""
    for i in range(len(nn)):
        if not np.isfinite(A[e, i, i]):
            return False
        for j in range(i):
            difference = A[e, i, j] - A[e, j, i]
            if difference != 0.0 or not np.isfinite(A[e, i, j]):
                allowed = ROUNDING * np.sqrt(abs(A[e, i, i])) * np.sqrt(abs(A[e, j, j]))
                if not abs(difference) <= allowed:  # also for a NaN and for two infinities
                    return False
    return True


@inlined
def factorises_one(e, A, slack, L, D, nn):
    """Whether A[e] + slack diag(A[e]) = L diag(1/D) L' with D > 0; a row of zeros may have D = 0 if slack > 0."""
    for i in range(len(nn)):
        for j in range(i + 1):
            value = A[e, i, j] * (1.0 + slack) if i == j else A[e, i, j]
            for k in range(j):
                value -= L[i, k] * L[j, k] * D[k]
            L[i, j] = value
            if i > j and D[j] == 0.0 and value != 0.0:
                return False
        if L[i, i] > 0.0:
            D[i] = 1.0 / L[i, i]
        elif slack > 0.0 and L[i, i] == 0.0 and A[e, i, i] == 0.0:
            D[i] = 0.0
        else:
            return False
    return True


@kernel
def first_invalid(A, slack, nn):
    """Index of the first of A (e, n, n) that is not finite, symmetric and positive definite up to ``slack``, or -1.

    slack = 0 requires a positive definite matrix. slack = ROUNDING requires a positive semidefinite one: the least
    eigenvalue of its correlation matrix is above -ROUNDING.
    """
    L, D = np.empty((len(nn), len(nn))), np.empty(len(nn))
    for e in range(A.shape[0]):
        if not (symmetric_one(e, A, nn) and factorises_one(e, A, slack, L, D, nn)):
            return e
    return -1
