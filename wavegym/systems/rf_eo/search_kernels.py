"""Search over the grid of RF/EO settings in compiled form: the best settings one step ahead.

Shapes and arguments as in ``kernels.py``; g points on each of the two axes of a platform's grid: PRF (sets
range and range-rate) and pixel angle (sets the azimuth), at the greatest bandwidth. ``sizes``: points on each axis.
``chosen`` (p, 2): every platform's grid point.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import kernel
from wavegym.systems.rf_eo.look_kernels import gain_of, predicted_variance, spread_of
from wavegym.systems.rf_eo.prediction_kernels import predict_ahead
from wavegym.trackers.rank_one_kernels import shrink_one

SWEEPS = 10  # most passes of a search over all platforms


@kernel
def tabulate(V, h, H, axes, fence, rules, R, spread):
    """Fill R (t, a, g), the predicted variance of every quantity at every point of its axis, and spread (t, a).

    spread: variance of the quantity's prediction. axes (3, g, 3): variance, low and high at the points; columns 0 and 1
    belong to the PRF, column 2 to the pixel angle.
    """
    variance, low, high = axes[0], axes[1], axes[2]
    for t in range(h.shape[0]):
        for a in range(h.shape[1]):
            q = a % 3
            spread[t, a] = spread_of(q, t, V, H[t], a)
            for g in range(axes.shape[1]):
                R[t, a, g] = np.inf
                if h[t, a - q] >= rules.nearest:
                    R[t, a, g] = predicted_variance(
                        h[t, a], spread[t, a], variance[g, q], low[g, q], high[g, q], q, fence, rules
                    )


@kernel
def absorb_platform(V, H, R, j, prf, angle, v, nn):
    """Update V (t, n, n) with the measurements of platform j at the points ``prf`` and ``angle`` of its axes."""
    for t in range(V.shape[0]):
        for q in range(3):
            a = 3 * j + q
            s = gain_of(q, t, V, H[t], a, v, nn) + R[t, a, angle if q == 2 else prf]
            shrink_one(t, V, v, s, nn)


@kernel
def best_platform(V, H, R, j, sizes, weights, W, v, nn):
    """Cost and best points (prf, angle) of platform j's axes, where all others have already measured.

    For each PRF the covariance is updated with range and range-rate (in W). An azimuth then lowers the trace by
    v' Lambda v / (h' P h + R), with the same v for every pixel angle.
    """
    targets, n, azimuth = V.shape[0], len(nn), 3 * j + 2
    least, prf, angle = np.inf, 0, 0
    off, g = np.empty(targets), np.empty(targets)
    for f in range(sizes[0]):
        total = 0.0
        for t in range(targets):
            W[t] = V[t]
            for q in range(2):
                s = gain_of(q, t, W, H[t], 3 * j + q, v, nn) + R[t, 3 * j + q, f]
                shrink_one(t, W, v, s, nn)
            g[t] = gain_of(2, t, W, H[t], azimuth, v, nn)
            off[t] = 0.0
            for i in range(n):
                total += weights[i] * W[t, i, i]
                off[t] += weights[i] * v[i] * v[i]
        for m in range(sizes[1]):
            cost = total
            for t in range(targets):
                cost -= off[t] / (g[t] + R[t, azimuth, m])
            if cost < least:
                least, prf, angle = cost, f, m
    return least, prf, angle


@kernel
def search(V, H, R, sizes, weights, backwards, chosen, W, rest, v, nn):
    """Fill ``chosen`` (p, 2) platform after platform, each best given the others, until none changes.

    In the first sweep a platform takes account only of those before it. Returns the cost.
    """
    platforms, cost = chosen.shape[0], np.inf
    chosen[:] = -1
    for _ in range(SWEEPS):
        changed = False
        for order in range(platforms):
            j = platforms - 1 - order if backwards else order
            rest[:] = V
            for other in range(platforms):
                if other != j and chosen[other, 0] >= 0:
                    absorb_platform(rest, H, R, other, chosen[other, 0], chosen[other, 1], v, nn)
            cost, prf, angle = best_platform(rest, H, R, j, sizes, weights, W, v, nn)
            changed = changed or prf != chosen[j, 0] or angle != chosen[j, 1]
            chosen[j, 0], chosen[j, 1] = prf, angle
        if not changed:
            break
    return cost


@kernel
def best_of_two(V, H, R, sizes, weights, chosen, other, W, rest, v, nn):
    """Fill ``chosen`` (p, 2) by the better of a forward and a backward search; returns the cost."""
    cost = search(V, H, R, sizes, weights, False, chosen, W, rest, v, nn)
    if chosen.shape[0] > 1:
        second = search(V, H, R, sizes, weights, True, other, W, rest, v, nn)
        if second < cost:
            chosen[:], cost = other, second
    return cost


@kernel
def best_settings(mean, P, axes, sizes, weights, F, Q, places, fence, rules, chosen, nn):
    """Fill ``chosen`` (e, p, 2), the grid points with nearly the least trace one step ahead."""
    (count, platforms), targets, n = chosen.shape[:2], mean.shape[1], len(nn)
    rows = 3 * platforms
    x, V = np.empty((targets, n)), np.empty((targets, n, n))
    W, rest = np.empty(V.shape), np.empty(V.shape)
    h, H, spread = np.empty((targets, rows)), np.empty((targets, rows, n)), np.empty((targets, rows))
    R, v, other = np.empty((targets, rows, axes.shape[1])), np.empty(n), np.empty((platforms, 2), np.int64)
    for e in range(count):
        predict_ahead(mean[e], P[e], F, Q, places, rules, x, V, h, H, nn)
        tabulate(V, h, H, axes, fence, rules, R, spread)
        best_of_two(V, H, R, sizes, weights, chosen[e], other, W, rest, v, nn)
