"""Compiled Gaussian-mixture tracking in clutter; ``gaussian_mixture.py`` describes the method.

``mixtures`` = (weight (t, c), X (t, c, n), V (t, c, n, n)): the mixture of each target t of one environment. The
components in use come first; the others have weight 0. In flat arrays component c of target t is row g = t C + c.
``bank`` = (centre (g, 2), L (g, 2, 2), G (g, n, 2), S, A): each component's predicted measurement, the factor L of its
innovation covariance, its cross-covariance, and scratch space.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import math

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.clutter_kernels import reach_one
from wavegym.trackers.association_kernels import associate_one
from wavegym.trackers.jpda_kernels import factor_one
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one
from wavegym.trackers.rbpf_kernels import fetch_one, moments_one, peak_of, whiten
from wavegym.trackers.ukf_kernels import predict_measurement_one

NEGLIGIBLE = 0.1
"""A weight, or a merger's cost in nats, below this share of 1 / C is negligible (docs/consistency_in_clutter.md)."""
BOX_SLACK = 1e-9
"""Widens a box around gates by this share of its size and of its distance from the origin, more than rounding."""
LN2 = math.log(2.0)
MANTISSA = 2**52 - 1
"""The bits of a float64 after its sign and exponent."""
TINY = 1e-300
"""Above this value a float64 has all of its bits."""
MARGIN = 1e-6
"""More than the rounding of a cost, per weight, where correlation matrices have condition numbers below 1e8."""


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
def workspace(rows, nn):
    """An empty ``bank`` with this number of rows."""
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

    The predicted mixtures are overwritten. pd (t,). A return is associated with the components whose gate contains it.
    """
    weight, X, V = mixtures
    T, row, limit = np.sum(lit), 0, negligible / weight.shape[1]
    W, beta = np.zeros((T, count + 1)), np.empty((T, count + 1))
    pairs = weigh(lit, weight, z, count, pd, bank, gate, gate_probability, density, W)
    log_evidence = associate_one(W, T, count, beta)
    for t in range(len(lit)):
        if lit[t]:
            for m in range(count + 1):
                beta[row, m] = beta[row, m] / W[row, m] if W[row, m] > 0.0 else 0.0
            w, x, P, children = branch(t, weight, X, V, pairs, beta, row, bank, limit, nn)
            reduce(w, x, P, children, limit, weight[t], X[t], V[t], nn)
            row += 1
    return log_evidence


@kernel
def weigh(lit, weight, z, count, pd, bank, gate, gate_probability, density, W):
    """Add the weights of all components of the lit targets to W (lit target, 1 + return); return their ``pairs``.

    ``pairs`` = (missed (g,), begin (g,), end (g,), number (p,), term (p,), white (p, 2)). missed is the weight of a
    miss of component g. From p = begin[g] to end[g] are the returns in its gate: their numbers m = 1, 2, ..., weights
    and whitened innovations.
    """
    most, used, row, filled = weight.shape[1], 0, 0, 0
    for t in range(len(lit)):
        if lit[t]:
            used += in_use(t, weight)
    missed, begin, end = np.empty(weight.size), np.empty(weight.size, np.int64), np.empty(weight.size, np.int64)
    number, term, white = np.empty(used * count, np.int64), np.empty(used * count), np.empty((used * count, 2))
    near, z0, z1, squared = np.empty(count, np.int64), np.empty(count), np.empty(count), np.empty(count)
    centre, L = bank[0], bank[1]
    for t in range(len(lit)):
        if lit[t]:
            kept = keep_near(t * most, t * most + in_use(t, weight), z, count, centre, L, gate, near, z0, z1)
            for c in range(in_use(t, weight)):
                g = t * most + c
                missed[g] = (1.0 - pd[t] * gate_probability) * weight[t, c]
                W[row, 0] += missed[g]
                begin[g] = filled
                filled = weigh_one(
                    g, near, z0, z1, kept, centre, L, pd[t], weight[t, c], density, gate * gate, squared, number, term,
                    white, filled
                )  # fmt: skip
                end[g] = filled
                for p in range(begin[g], filled):
                    W[row, number[p]] += term[p]
            row += 1
    return missed, begin, end, number, term, white


@inlined
def keep_near(first, end, z, count, centre, L, gate, near, z0, z1):
    """Copy the returns of z[: count] in the box around the gates first to end - 1 to z0, z1; returns how many.

    ``near`` receives their numbers, which begin with 1. The box is wider by BOX_SLACK, so that rounding loses no return
    in a gate.
    """
    low0, high0, low1, high1, kept = np.inf, -np.inf, np.inf, -np.inf, 0
    for g in range(first, end):
        r0, r1 = reach_one(g, L, gate)
        r0 += BOX_SLACK * (r0 + abs(centre[g, 0]))
        r1 += BOX_SLACK * (r1 + abs(centre[g, 1]))
        low0, high0 = min(low0, centre[g, 0] - r0), max(high0, centre[g, 0] + r0)
        low1, high1 = min(low1, centre[g, 1] - r1), max(high1, centre[g, 1] + r1)
    for m in range(count):
        near[kept], z0[kept], z1[kept] = m + 1, z[m, 0], z[m, 1]
        kept += (low0 <= z[m, 0] <= high0) & (low1 <= z[m, 1] <= high1)
    return kept


@inlined
def weigh_one(g, near, z0, z1, kept, centre, L, pd, weight, density, farthest, squared, number, term, white, filled):
    """Append the returns of component g with a squared distance below ``farthest`` to the pairs from ``filled``.

    The returns are near, z0, z1 [: kept]. Returns the new end. The weight of a return is that of ``weigh_row`` times
    the component's. The distances of all returns, squared (kept,), are computed first and without a branch, so that the
    compiler vectorises the loop.
    """
    begin, first, below, second = filled, 1.0 / L[g, 0, 0], L[g, 1, 0], 1.0 / L[g, 1, 1]
    peak, c0, c1 = peak_of(pd, first, second, density), centre[g, 0], centre[g, 1]
    for m in range(kept):
        w0, w1 = whiten(z0[m] - c0, z1[m] - c1, first, below, second)
        squared[m] = w0 * w0 + w1 * w1
    for m in range(kept):
        number[filled] = m
        filled += squared[m] < farthest
    for p in range(begin, filled):
        m = number[p]
        number[p] = near[m]
        white[p, 0], white[p, 1] = whiten(z0[m] - c0, z1[m] - c1, first, below, second)
        term[p] = peak * np.exp(-0.5 * squared[m]) * weight
    return filled


@kernel
def branch(t, weight, X, V, pairs, scale, row, bank, least, nn):
    """The posterior of target t before its reduction: weights w, means x, covariances P, and their number.

    A weight of ``pairs`` times scale[row, m] is the weight of a hypothesis: its component is true and its return is m
    (0: missed). A hypothesis with a weight of at least ``least`` becomes a component. The other hypotheses of a parent,
    with the miss, become one component: the PDA update of the parent.
    """
    n, most, parents, children = len(nn), weight.shape[1], in_use(t, weight), in_use(t, weight)
    (_, L, G), (missed, begin, end, number, term, white) = bank[:3], pairs
    for g in range(t * most, t * most + parents):
        for p in range(begin[g], end[g]):
            children += term[p] * scale[row, number[p]] >= least
    w, x, P = np.empty(children), np.empty((children, n)), np.empty((children, n, n))
    x_all, P_all, U, filled = X.reshape(-1, n), V.reshape(-1, n, n), np.empty((n, 2)), 0
    for g in range(t * most, t * most + parents):
        filled = branch_one(
            g, x_all, P_all, missed[g] * scale[row, 0], begin[g], end[g], number, term, white, scale, row, L, G, least,
            w, x, P, filled, U, nn
        )  # fmt: skip
    return w, x, P, filled


@inlined
def branch_one(g, x_all, P_all, missed, begin, end, number, term, white, scale, row, L, G, least, w, x, P, filled, U,
               nn):  # fmt: skip
    """``branch`` for component g: fills w, x and P from ``filled`` on; returns the new number of filled ones.

    The sums s and q are moments of the whitened innovations of the hypotheses below ``least``. U (n, 2) is scratch
    space.
    """
    first, below, second = 1.0 / L[g, 0, 0], L[g, 1, 0], 1.0 / L[g, 1, 1]
    for a in range(len(nn)):
        U[a, 0] = G[g, a, 0] * first
        U[a, 1] = (G[g, a, 1] - below * U[a, 0]) * second
    rest, s0, s1, q00, q01, q11 = missed, 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(begin, end):
        share = term[p] * scale[row, number[p]]
        if share > 0.0:
            w0, w1 = white[p, 0], white[p, 1]
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

    The Gaussians are taken in order of decreasing weight. Each one joins the component with the lowest cost of merging
    by Runnalls's bound, if this cost is at most ``similar`` or no place is free. Otherwise it becomes a component. If
    costs are equal, the first counts. w sums to 1. A merger is not evaluated if its ``floor`` shows that it costs more.
    """
    n, most, used = len(nn), len(weight), 0
    logs, planar, floor, areas = np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    bits, L, y, Y = areas.view(np.int64), np.empty((n, n)), np.empty((1, n)), np.empty((1, n, n))
    for i in np.argsort(-w[:count], kind="mergesort"):
        own, flat = log_determinant_one(i, P, L, nn), np.log(area_one(i, P))
        first = merger_floors(w[i], i, x, P, flat, weight, X, V, planar, used, areas, bits, floor)
        best, least, together, limit = 0, np.inf, np.nan, similar if used < most else np.inf
        for k in range(first, first + used):
            c = k if k < used else k - used
            if floor[c] > min(least, limit):
                continue
            merge_one(w[i], i, x, P, weight[c], c, X, V, 0, y, Y, nn)
            both = log_determinant_one(0, Y, L, nn)
            cost = 0.5 * ((w[i] + weight[c]) * both - w[i] * own - weight[c] * logs[c])
            if cost < least or (cost == least and c < best):
                best, least, together = c, cost, both
        if used < most and not least <= similar:
            fetch_one(i, x, P, used, X, V, nn)
            weight[used], logs[used], planar[used] = w[i], own, flat
            used += 1
        else:
            merge_one(w[i], i, x, P, weight[best], best, X, V, best, X, V, nn)
            weight[best] += w[i]
            logs[best], planar[best] = together, np.log(area_one(best, V))
    for c in range(used, most):
        weight[c] = 0.0


@inlined
def area_one(e, P):
    """The determinant of the covariance of the first two states, the position."""
    return P[e, 0, 0] * P[e, 1, 1] - P[e, 1, 0] * P[e, 1, 0]


@inlined
def merger_floors(v, i, x, P, flat, weight, X, V, planar, used, areas, bits, floor):
    """Fill floor[: used] with lower bounds of the costs to merge x[i], P[i] of weight v with each component.

    Returns the component with the least bound. Runnalls's bound is v KL(own, merged) + w KL(component, merged): the
    traces of the two divergences cancel, because merging preserves the covariance. No divergence is below that of the
    positions alone, and merging the positions gives the position of the merged state. So no cost is below the same
    formula for the positions' covariances. The logarithm is replaced by a lower bound: with value = (1 + f) 2^k, the
    function log(1 + f) - f log 2 - f (1 - f) / 8 is concave for 0 <= f <= 1 and 0 at both ends. MARGIN covers rounding.
    flat, planar (c,): log |covariance of the position|. areas (c,) is scratch space; bits (c,) is the same memory as
    integers.
    """
    first = 0
    for c in range(used):
        both = v + weight[c]
        a, b = v / both, weight[c] / both
        d0, d1 = x[i, 0] - X[c, 0], x[i, 1] - X[c, 1]
        P00 = a * P[i, 0, 0] + b * V[c, 0, 0] + a * b * d0 * d0
        P10 = a * P[i, 1, 0] + b * V[c, 1, 0] + a * b * d0 * d1
        P11 = a * P[i, 1, 1] + b * V[c, 1, 1] + a * b * d1 * d1
        areas[c] = P00 * P11 - P10 * P10
        f, k = np.float64(bits[c] & MANTISSA) * 2.0**-52, np.float64((bits[c] >> 52) - 1023)
        log = (k + f) * LN2 + 0.125 * f * (1.0 - f) - MARGIN
        floor[c] = 0.5 * (both * log - v * flat - weight[c] * planar[c]) if areas[c] > TINY else -np.inf
        first = c if floor[c] < floor[first] else first
    return first


@inlined
def log_determinant_one(e, P, L, nn):
    """log |P[e]| from the pivots of L D L'; NaN if one is negative. L (n, n) is scratch space."""
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
    """Fill mean (t, n) and covariance (t, n, n) of the present targets' mixtures; NaN without components."""
    weight, X, V = mixtures
    n, most = len(nn), weight.shape[1]
    x, P = X.reshape(-1, n), V.reshape(-1, n, n)
    for t in range(len(present)):
        if present[t]:
            moments_one(t, weight[t], in_use(t, weight), x, P, t * most, 1, mean, covariance, nn)
            if not weight[t, 0] > 0.0:
                mean[t, :], covariance[t, :, :] = np.nan, np.nan
