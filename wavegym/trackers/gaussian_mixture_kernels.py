"""Gaussian-mixture tracking in clutter, in compiled form; ``gaussian_mixture.py`` describes the method.

``mixtures`` = (weight (t, c), X (t, c, n), V (t, c, n, n)): the mixture of each target t of one environment. The
components in use come first; the others have the weight 0. In flat arrays component c of target t is row g = t C + c.
``bank`` = (centre (g, 2), L (g, 2, 2), G (g, n, 2), S, A): each component's predicted measurement, the factor L of its
innovation covariance, its cross-covariance, and scratch space.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.trackers.joint_association_kernels import associate_one
from wavegym.trackers.jpda_kernels import factor_one
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one
from wavegym.trackers.rbpf_kernels import fetch_one, moments_one, weigh_row, whiten
from wavegym.trackers.ukf_kernels import predict_measurement_one

NEGLIGIBLE = 0.1
"""A weight, or a merger's cost in nats, below this share of 1 / C is negligible (docs/consistency_in_clutter.md)."""


@inlined
def in_use(t, weight):
    """The number of components of target t."""
    count = 0
    while count < weight.shape[1] and weight[t, count] > 0.0:
        count += 1
    return count


@kernel
def predict_mixtures(mixtures, present, F, Q, mixtures_out, nn):
    """F X and F V F' + Q of all components of the present targets; those of the others are copied."""
    (weight, X, V), (weight_out, X_out, V_out) = mixtures, mixtures_out
    n, most = len(nn), weight.shape[1]
    x, P, x_out, P_out = X.reshape(-1, n), V.reshape(-1, n, n), X_out.reshape(-1, n), V_out.reshape(-1, n, n)
    T = np.empty((n, n))
    for t in range(len(present)):
        for c in range(most):
            g = t * most + c
            weight_out[t, c] = weight[t, c]
            if present[t] and weight[t, c] > 0.0:
                predict_mean_one(g, x, F, 0, x_out, nn)
                predict_covariance_one(g, P, F, Q, 0, T, P_out, nn)
            else:
                fetch_one(g, x, P, g, x_out, P_out, nn)


@kernel
def empty_mixtures(count_t, count_c, nn):
    """An empty ``mixtures`` of so many targets and components."""
    n = len(nn)
    return np.empty((count_t, count_c)), np.empty((count_t, count_c, n)), np.empty((count_t, count_c, n, n))


@kernel
def workspace(rows, nn):
    """An empty ``bank`` of so many rows."""
    n = len(nn)
    return (
        np.empty((rows, 2)), np.empty((rows, 2, 2)), np.empty((rows, n, 2)), np.empty((rows, 2, 2)),
        np.empty((rows, n, n)),
    )  # fmt: skip


@kernel
def predict_bank(mixtures, lit, noise, sx, sy, bank, opened, nn):
    """Fill ``bank``, and opened (g,): whether a row is a component of a lit target. noise (t, 2, 2)."""
    (weight, X, V), (centre, L, G, S, A) = mixtures, bank
    n, most = len(nn), weight.shape[1]
    x, P = X.reshape(-1, n), V.reshape(-1, n, n)
    for g in range(len(opened)):
        t = g // most
        opened[g] = lit[t] and weight[t, g - t * most] > 0.0
        if opened[g]:
            predict_measurement_one(g, g, x, P, sx, sy, A, centre, S, G, nn)
            for a in range(2):
                for b in range(2):
                    S[g, a, b] += noise[t, a, b]
            factor_one(g, S, L)


@kernel
def update_mixtures(lit, mixtures, z, count, pd, bank, gate, gate_probability, density, negligible, nn):
    """Update the mixtures of all lit targets by one sensor's scan z[: count]; return its log evidence.

    The predicted mixtures are overwritten. pd (t,). A return is associated with the components in whose gate it
    lies.
    """
    weight, X, V = mixtures
    most, T, row = weight.shape[1], np.sum(lit), 0
    limit = negligible / most
    terms = np.empty((len(lit) * most, count + 1))
    W, beta = np.zeros((T, count + 1)), np.empty((T, count + 1))
    for t in range(len(lit)):
        if lit[t]:
            for c in range(in_use(t, weight)):
                g = t * most + c
                weigh_row(g, z, count, bank[0], bank[1], pd[t], pd[t] * gate_probability, density, gate * gate, terms)
                for m in range(count + 1):
                    terms[g, m] *= weight[t, c]
                    W[row, m] += terms[g, m]
            row += 1
    log_evidence = associate_one(W, T, count, beta)
    row = 0
    for t in range(len(lit)):
        if lit[t]:
            for m in range(count + 1):
                beta[row, m] = beta[row, m] / W[row, m] if W[row, m] > 0.0 else 0.0
            w, x, P, children = branch(t, weight, X, V, z, count, terms, beta, row, bank, limit, nn)
            reduce(w, x, P, children, limit, weight[t], X[t], V[t], nn)
            row += 1
    return log_evidence


@kernel
def branch(t, weight, X, V, z, count, terms, scale, row, bank, least, nn):
    """The posterior of target t before its reduction: weights w, means x, covariances P, and their number.

    terms[g, m] scale[row, m] is the weight of the hypothesis that component g holds and its return is m (0: missed).
    One of at least ``least`` becomes a component. The others of a parent, the miss included, become one: its own PDA
    update.
    """
    n, most, parents, children = len(nn), weight.shape[1], in_use(t, weight), in_use(t, weight)
    for g in range(t * most, t * most + parents):
        for m in range(1, count + 1):
            children += terms[g, m] * scale[row, m] >= least
    w, x, P = np.empty(children), np.empty((children, n)), np.empty((children, n, n))
    x_all, P_all, U, filled = X.reshape(-1, n), V.reshape(-1, n, n), np.empty((n, 2)), 0
    for g in range(t * most, t * most + parents):
        filled = branch_one(g, x_all, P_all, z, count, terms, scale, row, bank, least, w, x, P, filled, U, nn)
    return w, x, P, filled


@inlined
def branch_one(g, x_all, P_all, z, count, terms, scale, row, bank, least, w, x, P, filled, U, nn):
    """``branch`` for the component g, which fills w, x and P from ``filled`` on; returns how many are filled then.

    The sums s and q are moments of the whitened innovations of the light hypotheses. U (n, 2) is scratch space.
    """
    centre, L, G = bank[0], bank[1], bank[2]
    first, below, second = 1.0 / L[g, 0, 0], L[g, 1, 0], 1.0 / L[g, 1, 1]
    for a in range(len(nn)):
        U[a, 0] = G[g, a, 0] * first
        U[a, 1] = (G[g, a, 1] - below * U[a, 0]) * second
    missed = terms[g, 0] * scale[row, 0]
    rest, s0, s1, q00, q01, q11 = missed, 0.0, 0.0, 0.0, 0.0, 0.0
    for m in range(1, count + 1):
        share = terms[g, m] * scale[row, m]
        if share > 0.0:
            w0, w1 = whiten(z[m - 1, 0] - centre[g, 0], z[m - 1, 1] - centre[g, 1], first, below, second)
            if share >= least:
                w[filled] = share
                child_one(filled, g, x_all, P_all, U, w0, w1, 1.0, 0.0, 1.0, x, P, nn)
                filled += 1
            else:
                rest += share
                s0, s1 = s0 + share * w0, s1 + share * w1
                q00, q01, q11 = q00 + share * w0 * w0, q01 + share * w0 * w1, q11 + share * w1 * w1
    if rest > 0.0:
        seen, s0, s1 = (rest - missed) / rest, s0 / rest, s1 / rest
        c00, c01, c11 = seen - (q00 / rest - s0 * s0), s0 * s1 - q01 / rest, seen - (q11 / rest - s1 * s1)
        w[filled] = rest
        child_one(filled, g, x_all, P_all, U, s0, s1, c00, c01, c11, x, P, nn)
        filled += 1
    return filled


@inlined
def child_one(e, g, x_all, P_all, U, s0, s1, c00, c01, c11, x, P, nn):
    """x[e] = x_all[g] + U s, P[e] = P_all[g] - U [[c00, c01], [c01, c11]] U'."""
    for a in range(len(nn)):
        x[e, a] = x_all[g, a] + U[a, 0] * s0 + U[a, 1] * s1
        u, v = U[a, 0] * c00 + U[a, 1] * c01, U[a, 0] * c01 + U[a, 1] * c11
        for b in range(a + 1):
            P[e, a, b] = P_all[g, a, b] - (u * U[b, 0] + v * U[b, 1])
            P[e, b, a] = P[e, a, b]


@kernel
def reduce(w, x, P, count, similar, weight, X, V, nn):
    """Merge the Gaussians w, x, P [: count] into at most len(weight) components weight, X, V; moments are preserved.

    From the heaviest down, a Gaussian joins the component with which merging costs least by Runnalls's bound, if that
    is at most ``similar`` or no place is free; else it becomes a component. w sums to 1.
    """
    n, most, used = len(nn), len(weight), 0
    logs, L, y, Y = np.empty(most), np.empty((n, n)), np.empty((1, n)), np.empty((1, n, n))
    for i in np.argsort(-w[:count], kind="mergesort"):
        own, best, least, together = log_determinant_one(i, P, L, nn), 0, np.inf, np.nan
        for c in range(used):
            merge_one(w[i], i, x, P, weight[c], c, X, V, 0, y, Y, nn)
            both = log_determinant_one(0, Y, L, nn)
            cost = 0.5 * ((w[i] + weight[c]) * both - w[i] * own - weight[c] * logs[c])
            if cost < least:
                best, least, together = c, cost, both
        if used < most and not least <= similar:
            fetch_one(i, x, P, used, X, V, nn)
            weight[used], logs[used] = w[i], own
            used += 1
        else:
            merge_one(w[i], i, x, P, weight[best], best, X, V, best, X, V, nn)
            weight[best] += w[i]
            logs[best] = together
    for c in range(used, most):
        weight[c] = 0.0


@inlined
def log_determinant_one(e, P, L, nn):
    """log |P[e]| from the pivots of L D L'; NaN where they are negative. L (n, n) is scratch space."""
    product = 1.0
    for j in range(len(nn)):
        for i in range(j, len(nn)):
            value = P[e, i, j]
            for k in range(j):
                value -= L[i, k] * L[j, k] * L[k, k]
            L[i, j] = value if i == j else value / L[j, j]
        product *= L[j, j]
    return np.log(product)


@inlined
def merge_one(v, i, x, P, w, j, y, R, o, x_out, P_out, nn):
    """Mean x_out[o] and covariance P_out[o] of (x[i], P[i]) with the weight v and (y[j], R[j]) with the weight w.

    The result may overwrite one of the two.
    """
    a, b = v / (v + w), w / (v + w)
    for r in range(len(nn)):
        d = a * b * (x[i, r] - y[j, r])
        for s in range(r + 1):
            P_out[o, r, s] = a * P[i, r, s] + b * R[j, r, s] + d * (x[i, s] - y[j, s])
            P_out[o, s, r] = P_out[o, r, s]
    for r in range(len(nn)):
        x_out[o, r] = a * x[i, r] + b * y[j, r]


@kernel
def moments(mixtures, present, mean, covariance, nn):
    """Fill mean (t, n) and covariance (t, n, n) of the present targets' mixtures; NaN for one without components."""
    weight, X, V = mixtures
    n, most = len(nn), weight.shape[1]
    x, P = X.reshape(-1, n), V.reshape(-1, n, n)
    for t in range(len(present)):
        if present[t]:
            moments_one(t, weight[t], in_use(t, weight), x, P, t * most, 1, mean, covariance, nn)
            if not weight[t, 0] > 0.0:
                mean[t, :], covariance[t, :, :] = np.nan, np.nan
