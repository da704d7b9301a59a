"""Compiled Rao-Blackwellised particle filter over joint associations (Särkkä, Vehtari & Lampinen 2007).

``rbpf.py`` describes the method and has the public functions. Arrays are those of one environment: X (particle, target,
n), V (particle, target, n, n).
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.clutter_kernels import in_gate
from wavegym.trackers.association_kernels import SAFE, associate_one, row_sum
from wavegym.trackers.jpda_kernels import factor_one
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one
from wavegym.trackers.ukf_kernels import predict_measurement_one

FARTHEST = 60.0
"""Squared distance beyond which a return is not associated: its weight would be below 1e-13 of the peak weight."""


@kernel
def predict_particles(X, V, present, F, Q, X_out, V_out, nn):
    """F X and F V F' + Q of the present targets; the others are copied."""
    n, slots = len(nn), len(present)
    x, P, x_out, P_out = X.reshape(-1, n), V.reshape(-1, n, n), X_out.reshape(-1, n), V_out.reshape(-1, n, n)
    T = np.empty((n, n))
    for e in range(len(x)):
        if present[e % slots]:
            predict_mean_one(e, x, F, 0, x_out, nn)
            predict_covariance_one(e, P, F, Q, 0, T, P_out, nn)
        else:
            copy_one(e, x, P, x_out, P_out, nn)


@kernel
def copy_one(e, x, P, x_out, P_out, nn):
    """Copy x[e] to x_out[e] and P[e] to P_out[e]."""
    fetch_one(e, x, P, e, x_out, P_out, nn)


@kernel
def fetch_one(source, x, P, e, x_out, P_out, nn):
    """x_out[e] = x[source], P_out[e] = P[source]."""
    for a in range(len(nn)):
        x_out[e, a] = x[source, a]
        for b in range(len(nn)):
            P_out[e, a, b] = P[source, a, b]


@kernel
def update_particles(key, present, X, V, log_weight, z, count, pd, noise, sx, sy, gates, density, nn):
    """Process one sensor's scan z[: count] for each particle: draw the association, update, add the log evidence.

    log_weight (particle,) grows by the exact joint log likelihood, a sum over all feasible associations. pd (t,), noise
    (t, 2, 2). ``gates`` = (centre (t, 2), L (t, 2, 2), gate, gate probability): only returns in one of the gates were
    received; gate = inf: all returns. If a particle predicts a return outside all gates, a missing return does not
    change its weight. A factor 1 - Pd would remove small modes of the posterior in places that no sensor observed.
    """
    n, slots, here = len(nn), len(present), np.flatnonzero(present)
    x, P, T = X.reshape(-1, n), V.reshape(-1, n, n), len(here)
    W, beta, owner = np.empty((T, count + 1)), np.empty((T, count + 1)), np.empty(T, np.int64)
    centre, S, L, G = np.empty((T, 2)), np.empty((T, 2, 2)), np.empty((T, 2, 2)), np.empty((T, n, 2))
    A, U = np.empty((T, n, n)), np.empty((n, 2))
    for j in range(len(X)):
        for row in range(T):
            t = here[row]
            predict_measurement_one(row, j * slots + t, x, P, sx, sy, A, centre, S, G, nn)
            for a in range(2):
                for b in range(2):
                    S[row, a, b] += noise[t, a, b]
            factor_one(row, S, L)
            seen = pd[t] * received(centre[row, 0], centre[row, 1], present, gates)
            weigh_row(row, z, count, centre, L, pd[t], seen, density, FARTHEST, W)
        log_weight[j] += draw_association(stream(key, j), W, T, count, beta, owner)
        for row in range(T):
            if owner[row] > 0:
                m = owner[row] - 1
                correct_one(j * slots + here[row], x, P, z[m, 0], z[m, 1], row, centre, L, G, U, nn)


@inlined
def received(z0, z1, present, gates):
    """The gate probability if (z0, z1), where a return is predicted, lies in a present target's gate, else 0."""
    centre, L, gate, gate_probability = gates
    for t in range(len(present)):
        if present[t] and in_gate(t, z0, z1, centre, L, gate):
            return gate_probability
    return 0.0


@inlined
def weigh_row(row, z, count, centre, L, pd, seen, density, farthest, W):
    """Association weights of one target: W[row, 0] = 1 - seen, W[row, m] = Pd N(z_m; centre, L L') / density.

    The weight of a return at a squared distance of ``farthest`` or more is 0.
    """
    first, below, second = 1.0 / L[row, 0, 0], L[row, 1, 0], 1.0 / L[row, 1, 1]
    peak, z0, z1 = peak_of(pd, first, second, density), centre[row, 0], centre[row, 1]
    W[row, 0] = 1.0 - seen
    for m in range(count):
        w0, w1 = whiten(z[m, 0] - z0, z[m, 1] - z1, first, below, second)
        squared = w0 * w0 + w1 * w1
        W[row, m + 1] = peak * np.exp(-0.5 * squared) if squared < farthest else 0.0


@inlined
def peak_of(pd, first, second, density):
    """The weight Pd N(z; z, L L') / density of a return at its predicted place z; reciprocals as in ``whiten``."""
    return pd * first * second / (2.0 * np.pi * density)


@kernel
def whiten(d0, d1, first, below, second):
    """L^-1 d for a lower triangular L (2, 2); ``first`` and ``second`` are the reciprocals of its diagonal."""
    w0 = d0 * first
    return w0, (d1 - below * w0) * second


@inlined
def draw_association(key, W, T, M, beta, owner):
    """Draw owner (T,), each target's measurement or 0, from the joint posterior of W; return the log evidence.

    The targets are drawn from the last to the first, each from its marginal. Then the target and its measurement are
    removed from the problem. The marginal of the first target is its remaining row of W. W is overwritten.
    """
    if T == 0:
        return 0.0
    Z = last_of_two(W, M, beta) if T == 2 else np.nan
    if 1.0 / SAFE > Z > SAFE:
        log_evidence, total = np.log(Z), Z
    else:
        log_evidence, total = associate_one(W, T, M, beta), 1.0
    for t in range(T - 1, 0, -1):
        if t < T - 1:
            associate_one(W, t + 1, M, beta)
        m = owner[t] = draw_column(t, beta, M, total * uniform(key, t))
        if m > 0:
            for s in range(t):
                W[s, m] = 0.0
    owner[0] = draw_column(0, W, M, uniform(key, 0) * row_sum(W, 0, M))
    return log_evidence


@inlined
def last_of_two(W, M, beta):
    """beta[1] = Z times the second target's marginal: W[1, m] times the sum of row 0 without m; returns Z."""
    left = W[0, 0]
    for m in range(1, M + 1):
        beta[1, m] = left
        left += W[0, m]
    beta[1, 0] = W[1, 0] * left
    Z, left = beta[1, 0], 0.0
    for m in range(M, 0, -1):
        beta[1, m] = W[1, m] * (beta[1, m] + left)
        left += W[0, m]
        Z += beta[1, m]
    return Z


@inlined
def draw_column(t, p, M, left):
    """The column of p[t] (M+1) whose interval of the cumulative sum from the last column contains ``left`` in [0, sum).

    So a rounding error leads to column 0, which is always possible.
    """
    m = M
    while m > 0 and left >= p[t, m]:
        left -= p[t, m]
        m -= 1
    return m


@inlined
def correct_one(e, x, P, z0, z1, row, centre, L, G, U, nn):
    """x[e] + U w, P[e] - U U' with U = G[row] L[row]^-T and w = L[row]^-1 (z - centre[row]); the gain is U L^-1.

    U (n, 2) is scratch space.
    """
    first, below, second = 1.0 / L[row, 0, 0], L[row, 1, 0], 1.0 / L[row, 1, 1]
    w0, w1 = whiten(z0 - centre[row, 0], z1 - centre[row, 1], first, below, second)
    for a in range(len(nn)):
        U[a, 0] = G[row, a, 0] * first
        U[a, 1] = (G[row, a, 1] - below * U[a, 0]) * second
        x[e, a] += U[a, 0] * w0 + U[a, 1] * w1
        for b in range(a + 1):
            P[e, a, b] -= U[a, 0] * U[b, 0] + U[a, 1] * U[b, 1]
            P[e, b, a] = P[e, a, b]


@kernel
def normalise(log_weight, weight):
    """Fill weight (particle,) of sum 1, equal if none is finite; return the effective sample size 1 / sum w^2."""
    top, total, squares = log_weight.max(), 0.0, 0.0
    for j in range(len(weight)):
        weight[j] = np.exp(log_weight[j] - top)
        total += weight[j]
    for j in range(len(weight)):
        weight[j] = weight[j] / total if total > 0.0 else 1.0 / len(weight)
        squares += weight[j] * weight[j]
    return 1.0 / squares


@kernel
def mixture(weight, X, V, present, mean, covariance, nn):
    """Fill mean (t, n) and covariance (t, n, n) of the present targets' Gaussian mixtures."""
    n, slots = len(nn), len(present)
    x, P = X.reshape(-1, n), V.reshape(-1, n, n)
    for t in range(slots):
        if present[t]:
            moments_one(t, weight, len(weight), x, P, t, slots, mean, covariance, nn)


@kernel
def moments_one(t, weight, count, x, P, first, stride, mean, covariance, nn):
    """Fill mean[t] and covariance[t] of a Gaussian mixture; component j < count is x, P [first + j stride]."""
    n = len(nn)
    for a in range(n):
        mean[t, a] = 0.0
        for b in range(n):
            covariance[t, a, b] = 0.0
    for j in range(count):
        for a in range(n):
            mean[t, a] += weight[j] * x[first + j * stride, a]
    for j in range(count):
        e = first + j * stride
        for a in range(n):
            d = x[e, a] - mean[t, a]
            for b in range(a + 1):
                covariance[t, a, b] += weight[j] * (P[e, a, b] + d * (x[e, b] - mean[t, b]))
    for a in range(n):
        for b in range(a):
            covariance[t, b, a] = covariance[t, a, b]


@kernel
def resample(key, weight, X, V, X_out, V_out, nn):
    """Systematic resampling to equally weighted X_out, V_out; returns the number of different survivors."""
    index = np.empty(len(weight), np.int64)
    distinct = systematic(uniform(key, 0), weight, index)
    n, slots = len(nn), X.shape[1]
    x, P, x_out, P_out = X.reshape(-1, n), V.reshape(-1, n, n), X_out.reshape(-1, n), V_out.reshape(-1, n, n)
    for j in range(len(weight)):
        for t in range(slots):
            fetch_one(index[j] * slots + t, x, P, j * slots + t, x_out, P_out, nn)
    return distinct


@kernel
def systematic(u, weight, index):
    """Set index[j] to the particle whose weight interval of [0, 1) contains (j + u) / N; return how many differ."""
    count, reached, source, distinct = len(weight), weight[0], 0, 1
    for j in range(count):
        while (j + u) / count >= reached and source < count - 1:
            source += 1
            reached += weight[source]
        distinct += j > 0 and source != index[j - 1]
        index[j] = source
    return distinct
