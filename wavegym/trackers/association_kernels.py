"""Compiled joint association and LMIPDA; ``association.py`` has the public functions.

W (T, M+1) holds the weights of one problem, all >= 0. W[t, 0] is the weight of "target t is missed". W[t, m] is the
weight of "measurement m comes from target t" relative to "m is clutter". A feasible association gives each target at
most one measurement and each measurement at most one target. Its weight is the product of its T entries. The evidence Z
is the sum of the weights of all feasible associations.

Targets that share measurements form a cluster, and Z is the product over clusters. Most clusters have one or two
targets and are solved in a few times M operations. Larger clusters, and weights beyond 1e+-200, are solved by dynamic
programming over sets A of targets (bit masks). f_m[A] is the sum over all assignments of the measurements 1 to m to
exactly the targets A. g_m[A] is the sum over all completions with the other measurements and targets:

    f_m[A] = c_m f_{m-1}[A] + sum_{t in A} W[t, m] f_{m-1}[A - t],          f_0[{}] = 1, f_0[A] = 0
    g_{m-1}[A] = c_m g_m[A] + sum_{t not in A} W[t, m] g_m[A + t],          g_M[A] = prod_{t not in A} W[t, 0]
    Z = sum_A f_M[A] g_M[A],    beta[t, m] = W[t, m] sum_{A without t} f_{m-1}[A] g_m[A + t] / Z

This takes M T 2^T operations and no subtraction. Entries are scaled by powers of two, 2^-u_t for a target and 2^-p_m
for a measurement. The clutter weight of measurement m is then c_m = 2^-p_m instead of 1. The scaling is exact and is
undone in log Z. A problem without a solution gives NaN, never an exception. The caller ensures that weights are not
negative.

LMIPDA takes one receiver's scan, several tracks with existence probabilities and several models each; arrays hold the
tracks of one environment.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import math

import numpy as np

from wavegym.core.kernels import inlined, kernel

CLUSTER_LIMIT = 10  # targets that share measurements, directly or through others: 2^10 sets of them
IMPOSSIBLE = -40_000  # the exponent of 0: smaller than that of any product of CLUSTER_LIMIT doubles
# With entries <= 1 all underflow adds up to less than 1e-270, which is negligible if Z is this large.
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
    """Log of Z with the scales undone; NaN if no association is feasible or a weight is not finite."""
    return np.log(Z) + LN2 * (u.sum() + p.sum()) if 0.0 < Z < np.inf else np.nan


@kernel
def forward(W, rows, T, columns, M, u, p, V, c, F, G, stride):
    """Choose scales u, p, fill the scaled V (T, M+1), c and G = g_M, run f_0 to f_M; return the scaled Z.

    p is zero on entry. f_m begins at m * stride in F: a stride of 2^T keeps all of them, a stride of 0 only the last.
    The scales u are sufficient, except if several targets compete for one measurement and Z underflows relative to the
    product of the targets' best weights. Then ``auction`` chooses u and p.
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
    """Choose u, p so that all entries are <= 1 and all factors of one association are >= 1/4: Z cannot underflow.

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


@kernel
def associate(W, beta, log_evidence):
    """``associate_one`` for a batch: W (e, T, M+1) -> beta (e, T, M+1), log_evidence (e,)."""
    for e in range(W.shape[0]):
        log_evidence[e] = associate_one(W[e], W.shape[1], W.shape[2] - 1, beta[e])


@kernel
def associate_one(W, T, M, beta):
    """Fill the marginals beta (T, M+1) and return log Z; W and beta may be larger than the (T, M+1) in use.

    Log Z and beta are NaN if no association is feasible or a cluster has more targets than CLUSTER_LIMIT.
    """
    for t in range(T):
        for m in range(M + 1):
            beta[t, m] = 0.0
    if T == 1:
        log_evidence = single(W, 0, M, beta)
    elif T == 2:  # as ``clusters``, without allocating arrays
        log_evidence = pair(W, 0, 1, M, beta) if share(W, M) else single(W, 0, M, beta) + single(W, 1, M, beta)
    else:
        log_evidence = clusters(W, T, M, beta)
    if np.isnan(log_evidence):
        for t in range(T):
            for m in range(M + 1):
                beta[t, m] = np.nan
    return log_evidence


@kernel
def clusters(W, T, M, beta):
    """``associate_one`` for any T, cluster by cluster."""
    label, rows, columns = np.empty(T, np.int64), np.empty(T, np.int64), np.empty(M + 1, np.int64)
    label_clusters(W, T, M, label)
    log_evidence = 0.0
    for first in range(T):
        if label[first] == first:
            count, used = members(W, T, M, label, first, rows, columns)
            if count == 1:
                log_evidence += single(W, first, M, beta)
            elif count == 2:
                log_evidence += pair(W, first, rows[1], M, beta)
            elif count <= CLUSTER_LIMIT:
                log_evidence += several(W, rows, count, columns, used, beta)
            else:
                log_evidence = np.nan
    return log_evidence


@kernel
def log_evidence_one(W, T, M, f):
    """Log Z alone, without clustering, for T <= CLUSTER_LIMIT (else NaN); f (2^T,) is scratch space."""
    if T > CLUSTER_LIMIT:
        return np.nan
    if T <= 2:
        Z = 1.0 if T == 0 else row_sum(W, 0, M) if T == 1 else pair_evidence(W, 0, 1, M)
        if 1.0 / SAFE > Z > SAFE:
            return np.log(Z)
    return log_evidence_of_several(W, T, M, f)


@kernel
def row_sum(W, t, M):
    """Sum of the weights of target t."""
    total = 0.0
    for m in range(M + 1):
        total += W[t, m]
    return total


@kernel
def single(W, t, M, beta):
    """Fill the row of beta of a target that shares no measurement, W / sum W, and return the log of the sum."""
    total = row_sum(W, t, M)
    if not 1.0 / SAFE > total > SAFE:
        return several(W, np.full(1, t), 1, np.arange(M + 1), M, beta)
    for m in range(M + 1):
        beta[t, m] = W[t, m] / total
    return np.log(total)


@kernel
def pair_evidence(W, a, b, M):
    """Z of the targets a and b by the forward recursion; terms of two factors need no scaling."""
    first, second, both = 0.0, 0.0, 0.0
    for m in range(1, M + 1):
        both += W[a, m] * second + W[b, m] * first
        first += W[a, m]
        second += W[b, m]
    return W[a, 0] * W[b, 0] + first * W[b, 0] + second * W[a, 0] + both


@kernel
def pair(W, a, b, M, beta):
    """Fill the rows of beta of a cluster of two targets and return log Z: W[a, m] is weighted by row b without m."""
    Z = pair_evidence(W, a, b, M)
    if not 1.0 / SAFE > Z > SAFE:
        rows = np.full(2, a)
        rows[1] = b
        return several(W, rows, 2, np.arange(M + 1), M, beta)
    first, second = W[a, 0], W[b, 0]  # sums of the columns before m, then after m, so that nothing is subtracted
    for m in range(1, M + 1):
        beta[a, m], beta[b, m] = second, first
        first += W[a, m]
        second += W[b, m]
    beta[a, 0], beta[b, 0] = W[a, 0] * second / Z, W[b, 0] * first / Z
    first, second = 0.0, 0.0
    for m in range(M, 0, -1):
        beta[a, m] = W[a, m] * (beta[a, m] + second) / Z
        beta[b, m] = W[b, m] * (beta[b, m] + first) / Z
        first += W[a, m]
        second += W[b, m]
    return np.log(Z)


@kernel
def share(W, M):
    """Whether the first two targets share a measurement."""
    shared = False
    for m in range(1, M + 1):
        shared |= W[0, m] != 0.0 and W[1, m] != 0.0
    return shared


@kernel
def label_clusters(W, T, M, label):
    """Set label[t] to the first target of the cluster of t: targets that share measurements, perhaps through others."""
    for t in range(T):
        label[t] = t
    for m in range(1, M + 1):
        first = -1
        for t in range(T):
            if W[t, m] != 0.0:
                if first < 0:
                    first = t
                elif label[t] != label[first]:
                    low, high = min(label[t], label[first]), max(label[t], label[first])
                    for s in range(T):
                        if label[s] == high:
                            label[s] = low


@kernel
def largest_cluster(W):
    """The number of targets in the largest cluster of W (T, M+1)."""
    T = W.shape[0]
    label, size, largest = np.empty(T, np.int64), np.zeros(T, np.int64), 0
    label_clusters(W, T, W.shape[1] - 1, label)
    for t in range(T):
        size[label[t]] += 1
        largest = max(largest, size[label[t]])
    return largest


@kernel
def members(W, T, M, label, first, rows, columns):
    """Write one cluster's targets to ``rows`` and measurements to ``columns`` (after column 0); return both counts."""
    count, used = 0, 0
    for t in range(T):
        if label[t] == first:
            rows[count] = t
            count += 1
    columns[0] = 0
    for m in range(1, M + 1):
        for i in range(count):
            if W[rows[i], m] != 0.0:
                used += 1
                columns[used] = m
                break
    return count, used


@inlined
def claims(t, p, mu, pd, existence, density, count, own, claim):
    """own[t] = p^(t)_i = sum_r mu_r p^(t,r)_i, and claim[t] = p^(t)_i P^(t)_i / (1 - P^(t)_i), (measurement,).

    P^(t)_i is the probability that measurement i comes from track t if there are no other tracks.
    """
    total = 0.0
    for i in range(count):
        own[t, i] = 0.0
        for r in range(mu.shape[1]):
            own[t, i] += mu[t, r] * p[t, r, i]
        total += own[t, i] / density[t, i]
    for i in range(count):
        mine = pd[t] * existence[t] * own[t, i] / density[t, i] / total if total > 0.0 else 0.0
        claim[t, i] = own[t, i] * mine / (1.0 - mine)


@kernel
def lmipda_one(p, mu, pd, existence, density, count, beta, own, claim):
    """Fill the association probabilities beta (track * model, 1 + measurement) and update mu and existence in place.

    Likelihoods p (track, model, measurement), 0 outside a gate; pd = Pd Pg (track,); density (track, measurement);
    own and claim (track, measurement) are scratch space. Only the first ``count`` measurements are used.
    """
    tracks, models = mu.shape
    for t in range(tracks):
        claims(t, p, mu, pd, existence, density, count, own, claim)
    for t in range(tracks):
        for i in range(count):  # own becomes Omega: clutter and the claims of the other tracks
            own[t, i] = density[t, i]
            for s in range(tracks):
                if s != t:
                    own[t, i] += claim[s, i]
        whole = 0.0
        for r in range(models):
            seen = 0.0
            for i in range(count):
                seen += p[t, r, i] / own[t, i]
            left = 1.0 - pd[t] + pd[t] * seen  # 1 - delta^(t,r)
            row = t * models + r
            beta[row, 0] = (1.0 - pd[t]) / left
            for i in range(count):
                beta[row, i + 1] = pd[t] * p[t, r, i] / own[t, i] / left
            mu[t, r] *= left
            whole += mu[t, r]  # 1 - delta^(t)
        for r in range(models):
            mu[t, r] /= whole
        existence[t] = whole * existence[t] / (1.0 - existence[t] + whole * existence[t])


@kernel
def lmipda(p, mu, pd, existence, density, beta):
    """``lmipda_one`` for a batch, all arrays with one flat leading axis; beta (env, track * model, 1 + measurement)."""
    own, claim = np.empty(density.shape[1:]), np.empty(density.shape[1:])
    for e in range(len(p)):
        lmipda_one(p[e], mu[e], pd[e], existence[e], density[e], p.shape[3], beta[e], own, claim)
