"""The paper's scheduler in compiled form: the most weighted information that leaves every target its threshold.

Shapes and arguments as in ``search_kernels.py``. Information weighted with the predicted covariance is a sum over
platforms and quantities, so the information of one platform's settings does not depend on the other platforms.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.array_kernels import copy_matrix
from wavegym.core.kernels import kernel
from wavegym.systems.rf_eo.look_kernels import predict_ahead, weighted_information
from wavegym.systems.rf_eo.search_kernels import SWEEPS, empty_tables, tabulate

STARTS = 12  # each platform's own optimum; forwards and backwards from nothing; own optima for other target weights
FORWARDS, BACKWARDS = 1, 2
LEAST_SHARE = 1e-6  # a smaller share of a target counts as this much


@kernel
def worth(totals, threshold):
    """Least share, at most ``threshold``, and sum of the targets' totals (t,): the two values that are compared."""
    least, total = np.inf, 0.0
    for t in range(totals.shape[0]):
        least = min(least, totals[t])
        total += totals[t]
    return min(least, threshold), total


@kernel
def best_addition(others, radar, camera, sizes, threshold, totals):
    """Best grid point of one platform, added to ``others`` (t,): feasibility first, then the greatest sum.

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
    """Choose platform after platform, each best given the others, until none changes.

    chosen (p, 2): -1 where a platform has not chosen yet; radar, camera (p, t, g).
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

    The first start has the greatest possible sum, so no other is tried where it is feasible. Later starts give more
    weight to targets that received less before, as a Lagrangian's multipliers do.
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
def most_information(
    step, mean, P, looks, axes, sizes, threshold, F, Q, places, fence, rules, stay, chosen, feasible, nn
):
    """Fill ``chosen`` (e, p, 2): nearly the most information that gives every target at least ``threshold``.

    feasible (e,): whether such a choice was found; where not, the choice favours the worst-off target.
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
        predict_ahead(step[e], mean[e], P[e], F, Q, places, rules, stay, x, V, h, H, nn)
        tabulate(V, h, H, looks[e], axes, fence, rules, tables, spread)
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
