"""Search over the grid of RF/EO settings in compiled form: one step ahead, the least trace or the most information.

Shapes and arguments are those of ``look_kernels.py``. The grid of a platform has two axes of g points: PRF, which sets
range and range-rate, and pixel angle with turn, which set the azimuth. The bandwidth is the greatest.

- ``sizes``: number of points on each axis;
- ``chosen`` (p, 2): every platform's grid point;
- ``tables``: R (t, a, g), the predicted variance of every quantity at every point of its axis; seen (t, p, g), the
  probability that the radar sees the target; widths (g, 3), the unambiguous intervals; here (t,), whether the target is
  in the scene.

Information weighted with the predicted covariance is a sum over platforms and quantities, so the information of one
platform's settings does not depend on the other platforms. The trace does depend on them.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.array_kernels import copy_matrices, copy_matrix
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.platform_kernels import wrapped
from wavegym.systems.rf_eo.look_kernels import (
    expected_innovation,
    gain_of,
    noise_of,
    predict_ahead,
    predicted_variance,
    seen_one,
    spread_of,
    weighted_information,
    width_of,
)
from wavegym.trackers.kernels import shrink_one

SWEEPS = 10  # maximum number of passes of a search over all platforms
STARTS = 12  # each platform's own optimum; forwards and backwards from no choice; own optima for other target weights
FORWARDS, BACKWARDS = 1, 2
LEAST_SHARE = 1e-6  # smaller shares of a target are raised to this value
FEW = 8  # greatest number of PRFs that are tried in pairs; pairs of a box's fine grid gained nothing


@kernel
def empty_tables(targets, platforms, points):
    """R, seen, widths and here, which ``tabulate`` fills."""
    R, seen = np.empty((targets, 3 * platforms, points)), np.empty((targets, platforms, points))
    return R, seen, np.empty((points, 3)), np.empty(targets, np.bool_)


@inlined
def variance_at(g, q, value, spread, look, axes, fence, rules):
    """R~ of quantity q at point g of its axis; value: predicted (azimuth: from +y); look: direction before the turn."""
    if q == 2:
        value = wrapped(value - wrapped(look + axes[3, g, 2]))
    return predicted_variance(value, spread, axes[0, g, q], axes[1, g, q], axes[2, g, q], q, fence, rules)


@kernel
def tabulate(V, h, H, looks, axes, fence, rules, tables, spread):
    """Fill the tables, and spread (t, a), the variance of each quantity's prediction.

    looks (p,): look directions before the step. axes (4, g, 3): variance, low, high and turn at the points; columns 0
    and 1 belong to the PRF, column 2 to pixel angle and turn.
    """
    (R, seen, widths, here), high = tables, axes[2]
    for g in range(axes.shape[1]):
        for q in range(3):
            widths[g, q] = width_of(q, high[g, q], rules)
    for t in range(h.shape[0]):
        here[t] = h[t, 0] >= 0.0
        for a in range(h.shape[1]):
            q = a % 3
            spread[t, a] = spread_of(q, t, V, H[t], a)
            for g in range(axes.shape[1]):
                R[t, a, g] = np.inf
                if h[t, a - q] >= rules.nearest:
                    R[t, a, g] = variance_at(g, q, h[t, a], spread[t, a], looks[a // 3], axes, fence, rules)
        for j in range(seen.shape[1]):
            a = 3 * j
            for g in range(axes.shape[1]):
                seen[t, j, g] = seen_one(h[t, a], h[t, a + 1], spread[t, a], spread[t, a + 1], high, g, rules)


@kernel
def absorb_platform(V, H, tables, j, prf, angle, v, nn):
    """Update V (t, n, n) with the measurements of platform j at the points ``prf`` and ``angle`` of its axes.

    A negative point has not been chosen yet.
    """
    R, seen, widths, _ = tables
    for t in range(V.shape[0]):
        for q in range(3):
            a, g = 3 * j + q, angle if q == 2 else prf
            if g >= 0:
                gain = gain_of(q, t, V, H[t], a, v, nn)
                s = expected_innovation(gain, R[t, a, g], seen[t, j, g], widths[g, q])
                shrink_one(t, V, v, s, nn)


@kernel
def absorb_all(V, H, tables, chosen, v, nn):
    """Update V (t, n, n) with the measurements of all platforms; chosen (p, 2).

    If ranges fold, all azimuths come first, as in the tracker: the covariance after them decides whether a fold is
    certain.
    """
    folds = tables[2][0, 0] < np.inf
    if folds:
        for j in range(chosen.shape[0]):
            absorb_platform(V, H, tables, j, -1, chosen[j, 1], v, nn)
    for j in range(chosen.shape[0]):
        absorb_platform(V, H, tables, j, chosen[j, 0], -1 if folds else chosen[j, 1], v, nn)


@kernel
def weighted_trace(V, here, weights):
    """trace(W P) summed over the targets of V (t, n, n) that are in the scene, here (t,); weights (n, n)."""
    total = 0.0
    for t in range(V.shape[0]):
        if not here[t]:
            continue
        for i in range(weights.shape[0]):
            for k in range(weights.shape[0]):
                total += weights[i, k] * V[t, k, i]
    return total


@kernel
def cost_of(V, H, tables, chosen, weights, W, v, nn):
    """trace(W P) summed over the targets after all measurements of ``chosen``; W: scratch space."""
    copy_matrices(V, W)
    absorb_all(W, H, tables, chosen, v, nn)
    return weighted_trace(W, tables[3], weights)


@kernel
def better_pair(V, H, tables, size, weights, chosen, least, W, v, nn):
    """Change the PRFs of two platforms at once to the best pair, if that costs less than ``least``; the least cost."""
    for i in range(chosen.shape[0]):
        for j in range(i):
            best = chosen[i, 0], chosen[j, 0]
            for f in range(size):
                for g in range(size):
                    chosen[i, 0], chosen[j, 0] = f, g
                    cost = cost_of(V, H, tables, chosen, weights, W, v, nn)
                    if cost < least:
                        least, best = cost, (f, g)
            chosen[i, 0], chosen[j, 0] = best
    return least


@kernel
def search_folded(V, H, tables, sizes, weights, backwards, chosen, W, v, nn):
    """``search`` if ranges fold: one axis of one platform at a time, each point tried with all other choices.

    A PRF may pay only in combination with a PRF of another platform. Up to ``FEW`` PRFs are therefore also tried in
    pairs.
    """
    platforms, least = chosen.shape[0], np.inf
    chosen[:] = -1
    for _ in range(SWEEPS):
        changed = False
        for order in range(platforms):
            j = platforms - 1 - order if backwards else order
            for axis in (1, 0):
                before, best, least = chosen[j, axis], 0, np.inf
                for g in range(sizes[axis]):
                    chosen[j, axis] = g
                    cost = cost_of(V, H, tables, chosen, weights, W, v, nn)
                    if cost < least:
                        least, best = cost, g
                chosen[j, axis] = best
                changed = changed or best != before
        if not changed:
            single = least
            if sizes[0] <= FEW:
                least = better_pair(V, H, tables, sizes[0], weights, chosen, least, W, v, nn)
            if least == single:
                break
    return least


@kernel
def best_platform(V, H, R, here, j, sizes, weights, W, v, nn):
    """Cost and best points (prf, angle) of platform j's axes, after all others have measured; nothing folds.

    For each PRF the covariance (in W) is updated with range and range-rate. An azimuth then lowers the trace by
    v' W v / (h' P h + R), with the same v for every pixel angle.
    """
    targets, n, azimuth = V.shape[0], len(nn), 3 * j + 2
    least, prf, angle = np.inf, 0, 0
    off, g = np.empty(targets), np.empty(targets)
    for f in range(sizes[0]):
        total = 0.0
        for t in range(targets):
            copy_matrix(V[t], W[t])
            for q in range(2):
                s = gain_of(q, t, W, H[t], 3 * j + q, v, nn) + R[t, 3 * j + q, f]
                shrink_one(t, W, v, s, nn)
            g[t] = gain_of(2, t, W, H[t], azimuth, v, nn)
            off[t] = 0.0
            if not here[t]:
                continue
            for i in range(n):
                for k in range(n):
                    total += weights[i, k] * W[t, k, i]
                    off[t] += weights[i, k] * v[k] * v[i]
        for m in range(sizes[1]):
            cost = total
            for t in range(targets):
                cost -= off[t] / (g[t] + R[t, azimuth, m])
            if cost < least:
                least, prf, angle = cost, f, m
    return least, prf, angle


@kernel
def search(V, H, tables, sizes, weights, backwards, chosen, W, rest, v, nn):
    """Fill ``chosen`` (p, 2) platform by platform, each with its best point given the others, until none changes.

    In the first sweep a platform considers only the platforms before it. Returns the cost.
    """
    if tables[2][0, 0] < np.inf:
        return search_folded(V, H, tables, sizes, weights, backwards, chosen, W, v, nn)
    platforms, cost = chosen.shape[0], np.inf
    chosen[:] = -1
    for _ in range(SWEEPS):
        changed = False
        for order in range(platforms):
            j = platforms - 1 - order if backwards else order
            copy_matrices(V, rest)
            for other in range(platforms):
                if other != j and chosen[other, 0] >= 0:
                    absorb_platform(rest, H, tables, other, chosen[other, 0], chosen[other, 1], v, nn)
            cost, prf, angle = best_platform(rest, H, tables[0], tables[3], j, sizes, weights, W, v, nn)
            changed = changed or prf != chosen[j, 0] or angle != chosen[j, 1]
            chosen[j, 0], chosen[j, 1] = prf, angle
        if not changed:
            break
    return cost


@kernel
def best_of_two(V, H, tables, sizes, weights, chosen, other, W, rest, v, nn):
    """Fill ``chosen`` (p, 2) with the better result of a forward and a backward search; returns the cost."""
    cost = search(V, H, tables, sizes, weights, False, chosen, W, rest, v, nn)
    if chosen.shape[0] > 1:
        second = search(V, H, tables, sizes, weights, True, other, W, rest, v, nn)
        if second < cost:
            chosen[:], cost = other, second
    return cost


@kernel
def best_settings(step, mean, P, looks, axes, sizes, weights, scene, chosen, nn):
    """Fill ``chosen`` (e, p, 2), the grid points with nearly the least trace one step ahead."""
    (count, platforms), targets, n = chosen.shape[:2], mean.shape[1], len(nn)
    rows = 3 * platforms
    x, V = np.empty((targets, n)), np.empty((targets, n, n))
    W, rest = np.empty(V.shape), np.empty(V.shape)
    h, H, spread = np.empty((targets, rows)), np.empty((targets, rows, n)), np.empty((targets, rows))
    tables, v = empty_tables(targets, platforms, axes.shape[1]), np.empty(n)
    other = np.empty((platforms, 2), np.int64)
    for e in range(count):
        predict_ahead(step[e], mean[e], P[e], scene, noise_of(e, scene), x, V, h, H, nn)
        tabulate(V, h, H, looks[e], axes, scene.fence, scene.rules, tables, spread)
        best_of_two(V, H, tables, sizes, weights, chosen[e], other, W, rest, v, nn)


@kernel
def worth(totals, threshold):
    """Least of the targets' totals (t,), at most ``threshold``, and their sum: the two values that are compared."""
    least, total = np.inf, 0.0
    for t in range(totals.shape[0]):
        least = min(least, totals[t])
        total += totals[t]
    return min(least, threshold), total


@kernel
def best_addition(others, radar, camera, sizes, threshold, totals):
    """Best grid point of one platform in addition to ``others`` (t,): feasible points first, then the greatest sum.

    radar (t, g): information of range and range-rate; camera (t, g): of the azimuth.
    """
    share, gain, prf, angle = -np.inf, -np.inf, 0, 0
    for f in range(sizes[0]):
        for m in range(sizes[1]):
            for t in range(totals.shape[0]):
                totals[t] = others[t] + radar[t, f] + camera[t, m]
            least, total = worth(totals, threshold)
            if least > share or (least == share and total > gain):
                share, gain, prf, angle = least, total, f, m
    return prf, angle


@kernel
def sums(radar, camera, chosen, without, totals):
    """Fill totals (t,): every target's information from all platforms that have chosen, except platform ``without``."""
    totals[:] = 0.0
    for j in range(chosen.shape[0]):
        if j != without and chosen[j, 0] >= 0:
            for t in range(totals.shape[0]):
                totals[t] += radar[j, t, chosen[j, 0]] + camera[j, t, chosen[j, 1]]


@kernel
def own_best(radar, camera, sizes, weights, chosen):
    """Fill ``chosen`` (p, 2) with each platform's greatest weighted sum; PRF and pixel angle contribute separately."""
    for j in range(chosen.shape[0]):
        for axis, table in enumerate((radar, camera)):
            most = -np.inf
            for g in range(sizes[axis]):
                value = 0.0
                for t in range(weights.shape[0]):
                    value += weights[t] * table[j, t, g]
                if value > most:
                    most, chosen[j, axis] = value, g


@kernel
def ascend(radar, camera, sizes, threshold, backwards, chosen, others, totals):
    """Choose platform by platform, each with its best point given the others, until none changes.

    chosen (p, 2): -1 if a platform has not chosen yet; radar, camera (p, t, g).
    """
    platforms = chosen.shape[0]
    for _ in range(SWEEPS):
        changed = False
        for order in range(platforms):
            j = platforms - 1 - order if backwards else order
            sums(radar, camera, chosen, j, others)
            prf, angle = best_addition(others, radar[j], camera[j], sizes, threshold, totals)
            changed = changed or prf != chosen[j, 0] or angle != chosen[j, 1]
            chosen[j, 0], chosen[j, 1] = prf, angle
        if not changed:
            break


@kernel
def choose(radar, camera, sizes, threshold, tried, chosen, weights, others, totals):
    """Fill ``chosen`` (p, 2) with the best of all STARTS; returns its least share, at most ``threshold``.

    The first start has the greatest possible sum, so no other start is tried if it is feasible. Later starts give more
    weight to targets that received less information before, like the multipliers of a Lagrangian.
    """
    share, gain = -np.inf, -np.inf
    weights[:] = 1.0
    for start in range(STARTS):
        if start in (FORWARDS, BACKWARDS):
            tried[:] = -1
        else:
            own_best(radar, camera, sizes, weights, tried)
            sums(radar, camera, tried, -1, totals)
            for t in range(totals.shape[0]):
                weights[t] /= np.sqrt(max(totals[t], LEAST_SHARE))
        ascend(radar, camera, sizes, threshold, start == BACKWARDS, tried, others, totals)
        sums(radar, camera, tried, -1, totals)
        least, total = worth(totals, threshold)
        if least > share or (least == share and total > gain):
            share, gain = least, total
            copy_matrix(tried, chosen)
        if start == 0 and share >= threshold:
            break
    return share


@kernel
def most_information(step, mean, P, looks, axes, sizes, threshold, scene, chosen, feasible, nn):
    """Fill ``chosen`` (e, p, 2) with nearly the most information that gives every target at least ``threshold``.

    feasible (e,): whether such a choice was found. If not, the choice favours the target with the least information.
    """
    (count, platforms), targets, n = chosen.shape[:2], mean.shape[1], len(nn)
    rows, points = 3 * platforms, axes.shape[1]
    x, V = np.empty((targets, n)), np.empty((targets, n, n))
    h, H, spread = np.empty((targets, rows)), np.empty((targets, rows, n)), np.empty((targets, rows))
    tables, tried = empty_tables(targets, platforms, points), np.empty((platforms, 2), np.int64)
    R, seen, widths, here = tables
    radar, camera = np.empty((platforms, targets, points)), np.empty((platforms, targets, points))
    weights, others, totals = np.empty(targets), np.empty(targets), np.empty(targets)
    for e in range(count):
        predict_ahead(step[e], mean[e], P[e], scene, noise_of(e, scene), x, V, h, H, nn)
        tabulate(V, h, H, looks[e], axes, scene.fence, scene.rules, tables, spread)
        present = 0
        for t in range(targets):
            if not here[t]:
                continue
            for j in range(platforms):
                for g in range(points):
                    a = 3 * j
                    radar[j, present, g] = 0.0
                    for q in range(2):
                        radar[j, present, g] += weighted_information(
                            spread[t, a + q], R[t, a + q, g], seen[t, j, g], widths[g, q]
                        )
                    camera[j, present, g] = spread[t, a + 2] / R[t, a + 2, g]
            present += 1
        share = choose(
            radar[:, :present], camera[:, :present], sizes, threshold, tried, chosen[e], weights[:present],
            others[:present], totals[:present]
        )  # fmt: skip
        feasible[e] = share >= threshold
