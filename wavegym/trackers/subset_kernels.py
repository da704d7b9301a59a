"""The sum over feasible associations by dynamic programming over subsets of targets.

The weights W (T, M+1) of one cluster and its evidence Z are defined in ``joint_association_kernels.py``.
A is a set of targets (a bit mask). f_m[A] is the sum over all assignments of the measurements 1 to m to exactly the
targets A. g_m[A] is the sum over all completions with the other measurements and targets:

    f_m[A] = c_m f_{m-1}[A] + sum_{t in A} W[t, m] f_{m-1}[A - t],          f_0[{}] = 1, f_0[A] = 0
    g_{m-1}[A] = c_m g_m[A] + sum_{t not in A} W[t, m] g_m[A + t],          g_M[A] = prod_{t not in A} W[t, 0]
    Z = sum_A f_M[A] g_M[A],    beta[t, m] = W[t, m] sum_{A without t} f_{m-1}[A] g_m[A + t] / Z

in M T 2^T steps and without a subtraction. Entries are scaled by powers of two, 2^-u_t for a target and 2^-p_m for a
measurement. The clutter weight of measurement m is then c_m = 2^-p_m instead of 1. The scaling is exact and undone in
log Z.
A problem without a solution gives NaN, never an exception. The caller ensures that weights are not negative.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import math

import numpy as np

from wavegym.core.kernels import kernel

CLUSTER_LIMIT = 10  # targets that share measurements, directly or through others: 2^10 sets of them
IMPOSSIBLE = -40_000  # exponent of 0: below that of any product of CLUSTER_LIMIT doubles
# With entries <= 1 all underflow adds up to less than 1e-270, which is negligible beside a Z of this size.
SAFE = 1e-200
LN2 = math.log(2.0)


@kernel
def top_exponent(W, t, columns, M):
    """The exponent of the largest weight of target t: the weight is in [1/2, 1) times two to that power."""
    top = 0.0
    for m in range(M + 1):
        top = max(top, W[t, columns[m]])
    return math.frexp(top)[1]


@kernel
def several(W, rows, T, columns, M, beta):
    """Fill beta and return log Z of one cluster: the targets ``rows`` and measurements ``columns`` of W."""
    u, p, sets = np.empty(T, np.int64), np.zeros(M + 1, np.int64), 1 << T
    V, c, F, G = np.empty((T, M + 1)), np.empty(M + 1), np.empty((M + 1) * sets), np.empty(sets)
    Z = forward(W, rows, T, columns, M, u, p, V, c, F, G, sets)
    backward(rows, T, columns, M, V, c, F, G, Z, beta)
    return log_of(Z, u, p)


@kernel
def log_evidence_of_several(W, T, M, f):
    """Log Z of all targets of W; f (2^T,) is scratch space."""
    u, p = np.empty(T, np.int64), np.zeros(M + 1, np.int64)
    Z = forward(
        W, np.arange(T), T, np.arange(M + 1), M, u, p, np.empty((T, M + 1)), np.empty(M + 1), f, np.empty(1 << T), 0
    )
    return log_of(Z, u, p)


@kernel
def log_of(Z, u, p):
    """Log of Z with the scales undone; NaN where no association is feasible or a weight is not finite."""
    return np.log(Z) + LN2 * (u.sum() + p.sum()) if 0.0 < Z < np.inf else np.nan


@kernel
def forward(W, rows, T, columns, M, u, p, V, c, F, G, stride):
    """Choose scales u, p, fill the scaled V (T, M+1), c and G = g_M, run f_0 to f_M; return the scaled Z.

    p is zero on entry. f_m begins at m * stride in F: a stride of 2^T keeps all of them, a stride of 0 only the last.
    The scales u are enough unless Z underflows beside the product of the targets' best weights, because several
    targets compete for one measurement. Then ``auction`` chooses u and p.
    """
    for t in range(T):
        u[t] = top_exponent(W, rows[t], columns, M)
    Z = scaled_forward(W, rows, T, columns, M, u, p, V, c, F, G, stride)
    if not Z >= SAFE:
        auction(W, rows, T, columns, M, u, p)
        Z = scaled_forward(W, rows, T, columns, M, u, p, V, c, F, G, stride)
    return Z


@kernel
def scaled_forward(W, rows, T, columns, M, u, p, V, c, F, G, stride):
    """``forward`` with the scales given."""
    for m in range(M + 1):
        c[m] = math.ldexp(1.0, -p[m])
        for t in range(T):
            V[t, m] = math.ldexp(W[rows[t], columns[m]], -(u[t] + p[m]))
    sets = 1 << T
    F[0] = 1.0
    for A in range(1, sets):
        F[A] = 0.0
    for m in range(1, M + 1):
        source, target = (m - 1) * stride, m * stride
        for A in range(sets - 1, -1, -1):  # in place where stride = 0: f_m[A] needs f_{m-1} of smaller sets only
            total = c[m] * F[source + A]
            for t in range(T):
                if A >> t & 1:
                    total += V[t, m] * F[source + A - (1 << t)]
            F[target + A] = total
    G[sets - 1], Z = 1.0, F[M * stride + sets - 1]
    for A in range(sets - 2, -1, -1):
        t = 0
        while A >> t & 1:
            t += 1
        G[A] = V[t, 0] * G[A + (1 << t)]
        Z += F[M * stride + A] * G[A]
    return Z


@kernel
def backward(rows, T, columns, M, V, c, F, G, Z, beta):
    """Run g_M to g_1 in G and fill the marginals of one cluster from f_0 to f_M in F."""
    sets, share = 1 << T, np.zeros(T)
    for A in range(sets):
        for t in range(T):
            if not A >> t & 1:
                share[t] += F[M * sets + A] * G[A]
    for t in range(T):
        beta[rows[t], 0] = share[t] / Z
    for m in range(M, 0, -1):
        for t in range(T):
            share[t] = 0.0
        for A in range(sets):  # in place: g_{m-1}[A] needs g_m of larger sets only
            total, reached = c[m] * G[A], F[(m - 1) * sets + A]
            for t in range(T):
                if not A >> t & 1:
                    rest = V[t, m] * G[A + (1 << t)]
                    share[t] += reached * rest
                    total += rest
            G[A] = total
        for t in range(T):
            beta[rows[t], columns[m]] = share[t] / Z


@kernel
def auction(W, rows, T, columns, M, u, p):
    """Choose u, p so that all entries are <= 1 and one association has factors >= 1/4 only: Z cannot underflow.

    Bertsekas' auction on the binary exponents, with bids of at least one. Measurements are goods with prices p;
    "missed" is free. u is the value of a target's best choice at the final prices.
    """
    owner, waiting, count = np.full(M + 1, -1), np.arange(T), T
    while count > 0:
        count -= 1
        t = waiting[count]
        choice, best, second = bid(W, rows[t], columns, M, p)
        if choice > 0:
            p[choice] += best - second + 1
            if owner[choice] >= 0:
                waiting[count] = owner[choice]
                count += 1
            owner[choice] = t
    for t in range(T):
        u[t] = bid(W, rows[t], columns, M, p)[1]


@kernel
def bid(W, t, columns, M, p):
    """The column of the greatest value minus price to target t, that difference, and the second greatest difference."""
    choice, best = 0, math.frexp(W[t, 0])[1] if W[t, 0] > 0.0 else IMPOSSIBLE
    second = best
    for m in range(1, M + 1):
        if W[t, columns[m]] > 0.0:
            value = math.frexp(W[t, columns[m]])[1] - p[m]
            if value > best:
                choice, best, second = m, value, best
            elif value > second:
                second = value
    return choice, best, second
