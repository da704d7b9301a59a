"""A plan of several steps for RF/EO platforms in compiled form.

Shapes and arguments as in ``search_kernels.py``; s steps ahead; ``chosen`` (s, p, 2), and so
are R and seen of the ``tables``.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import kernel
from wavegym.systems.rf_eo.prediction_kernels import predict_ahead
from wavegym.systems.rf_eo.search_kernels import SWEEPS, absorb_all, best_of_two, tabulate, weighted_trace
from wavegym.trackers.kernels import predict_covariance_one

BETTER = 1e-9  # least relative improvement for which the plan is changed


@kernel
def follow(U, H, tables, chosen, s, last, weights, F, Q, bound, T, v, nn):
    """Cost of the steps s to ``last`` from U[s] (t, n, n); fills U[s + 1], ...; stops where it reaches ``bound``."""
    (R, seen, widths), total = tables, 0.0
    for k in range(s, last + 1):
        for t in range(U.shape[1]):
            predict_covariance_one(t, U[k], F, Q, 0, T, U[k + 1], nn)
        absorb_all(U[k + 1], H[k], (R[k], seen[k], widths), chosen[k], v, nn)
        total += weighted_trace(U[k + 1], weights)
        if total >= bound:
            break
    return total


@kernel
def improve(U, H, tables, chosen, sizes, weights, F, Q, T, v, nn):
    """Change one grid point of one platform at one step at a time, as long as the plan's cost falls.

    U (s + 1, t, n, n) holds the covariances of the plan so far. The tables stay those of the plan given.
    """
    depth, platforms = chosen.shape[:2]
    total = follow(U, H, tables, chosen, 0, depth - 1, weights, F, Q, np.inf, T, v, nn)
    for _ in range(SWEEPS):
        before, spent = total, 0.0  # spent: cost of the steps before k
        for k in range(depth):
            for j in range(platforms):
                for axis in range(2):
                    best, kept = chosen[k, j, axis], total
                    for g in range(sizes[axis]):
                        chosen[k, j, axis] = g
                        cost = spent + follow(
                            U, H, tables, chosen, k, depth - 1, weights, F, Q, total - spent, T, v, nn
                        )  # fmt: skip
                        if cost < total - BETTER * kept:
                            best, total = g, cost
                    chosen[k, j, axis] = best
            spent += follow(U, H, tables, chosen, k, k, weights, F, Q, np.inf, T, v, nn)
        if total >= before:
            break


@kernel
def foresee(x, U, h, H, tables, chosen, search, axes, sizes, weights, F, Q, places, fence, rules, room, nn):
    """Fill x, U and the tables of every step along the plan ``chosen`` from x[0], U[0]; returns the plan's cost.

    search: fill ``chosen`` too, by the one-step scheduler. room: scratch space.
    """
    (R, seen, widths), (other, W, rest, spread, v) = tables, room
    total = 0.0
    for k in range(chosen.shape[0]):
        now = (R[k], seen[k], widths)
        predict_ahead(x[k], U[k], F, Q, places, rules, x[k + 1], U[k + 1], h, H[k], nn)
        tabulate(U[k + 1], h, H[k], axes, fence, rules, now, spread)
        if search:
            best_of_two(U[k + 1], H[k], now, sizes, weights, chosen[k], other, W, rest, v, nn)
        absorb_all(U[k + 1], H[k], now, chosen[k], v, nn)
        total += weighted_trace(U[k + 1], weights)
    return total


@kernel
def plan(mean, P, step, horizon, axes, sizes, weights, F, Q, places, fence, rules, chosen, cost, nn):
    """Fill ``chosen`` (e, s, p, 2), the one-step scheduler's plan improved, and its predicted cost (e,).

    The plan is shorter at the episode's end. What a setting is worth depends on the predicted spread, and so on the
    plan before it: where it does, the plan is improved again from its own spread, as long as its cost falls.
    """
    (count, depth, platforms), targets, n = chosen.shape[:3], mean.shape[1], len(nn)
    rows, points = 3 * platforms, axes.shape[1]
    x, U = np.empty((depth + 1, targets, n)), np.empty((depth + 1, targets, n, n))
    W, rest, spread = np.empty(U.shape[1:]), np.empty(U.shape[1:]), np.empty((targets, rows))
    h, H = np.empty((targets, rows)), np.empty((depth, targets, rows, n))
    R, seen = np.empty((depth, targets, rows, points)), np.empty((depth, targets, platforms, points))
    tables = R, seen, np.empty((points, 3))
    T, v, other = np.empty((n, n)), np.empty(n), np.empty((platforms, 2), np.int64)
    room = (other, W, rest, spread, v)
    for e in range(count):
        levels = max(1, min(depth, horizon - step[e]))
        best, trial = chosen[e, :levels], np.empty((levels, platforms, 2), np.int64)
        x[0], U[0], least = mean[e], P[e], np.inf
        for attempt in range(SWEEPS):
            total = foresee(
                x, U, h, H, tables, trial, attempt == 0, axes, sizes, weights, F, Q, places, fence, rules, room, nn
            )  # fmt: skip
            if total >= least * (1.0 - BETTER):
                break
            best[:], least = trial, total
            if attempt > 0 and not (rules.folding or rules.margin > 0.0):
                break
            improve(U, H, tables, trial, sizes, weights, F, Q, T, v, nn)
        cost[e] = least
