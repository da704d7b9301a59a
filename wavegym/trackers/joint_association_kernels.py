"""Joint association in compiled form; ``joint_association.py`` holds the public function.

W (T, M+1) holds the weights of one problem, all >= 0. W[t, 0] is the weight of "target t is missed". W[t, m] is the
weight of "measurement m comes from target t" relative to "m is clutter". A feasible association gives each target at
most one measurement and each measurement at most one target. Its weight is the product of its T entries. The evidence Z
is the sum of the weights of all feasible associations.

Targets that share measurements form a cluster, and Z is the product over clusters. Most clusters have one or two
targets: this file solves them in a few M steps. ``subset_kernels.py`` solves larger ones, and weights beyond 1e+-200.
A problem without a solution gives NaN, never an exception. The caller ensures that weights are not negative.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import kernel
from wavegym.trackers.subset_kernels import CLUSTER_LIMIT, SAFE, log_evidence_of_several, several


@kernel
def associate(W, beta, log_evidence):
    """``associate_one`` for a batch: W (e, T, M+1) -> beta (e, T, M+1), log_evidence (e,)."""
    for e in range(W.shape[0]):
        log_evidence[e] = associate_one(W[e], W.shape[1], W.shape[2] - 1, beta[e])


@kernel
def associate_one(W, T, M, beta):
    """Fill the marginals beta (T, M+1) and return log Z; W and beta may be larger than the (T, M+1) in use.

    Log Z and beta are NaN where no association is feasible or a cluster has more targets than CLUSTER_LIMIT.
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
    first, second = W[a, 0], W[b, 0]  # sums of the columns before m, then after m: no subtraction
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
    """Set label[t] to the first target of the cluster of t: targets that share measurements, also through others."""
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
