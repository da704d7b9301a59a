"""A plan of several steps for RF/EO platforms in compiled form.

Shapes and arguments are those of ``search_kernels.py``. There are s steps ahead: ``chosen`` is (s, p, 2), and R, seen
and here of the ``tables`` also have the leading axis s.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.array_kernels import copy_vector
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.platform_kernels import wrapped
from wavegym.systems.rf_eo.look_kernels import noise_of, predict_ahead
from wavegym.systems.rf_eo.search_kernels import (
    SWEEPS,
    absorb_all,
    best_of_two,
    tabulate,
    variance_at,
    weighted_trace,
)
from wavegym.trackers.kernels import predict_covariance_one

BETTER = 1e-9  # least relative improvement for which the plan is changed


@kernel
def follow(U, H, tables, chosen, s, last, weights, F, Q, bound, T, v, nn):
    """Cost of the steps s to ``last`` from U[s] (t, n, n); fills U[s + 1], ...; stops at a cost of ``bound``."""
    (R, seen, widths, here), total = tables, 0.0
    for k in range(s, last + 1):
        for t in range(U.shape[1]):
            if here[k, t]:
                predict_covariance_one(t, U[k], F, Q, t, T, U[k + 1], nn)
            else:
                U[k + 1, t] = U[k, t]
        absorb_all(U[k + 1], H[k], (R[k], seen[k], widths, here[k]), chosen[k], v, nn)
        total += weighted_trace(U[k + 1], here[k], weights)
        if total >= bound:
            break
    return total


@kernel
def turn_later(j, k, ahead, R, chosen, axes, fence, rules):
    """Fill looks[k + 1:, j], and R of the azimuths after step k, for the turns of platform j from step k on."""
    (looks, h, spread), a = ahead, 3 * j + 2
    for s in range(k, chosen.shape[0]):
        looks[s + 1, j] = wrapped(looks[s, j] + axes[3, chosen[s, j, 1], 2])
    for s in range(k + 1, chosen.shape[0]):
        for t in range(h.shape[1]):
            if h[s, t, 3 * j] >= rules.nearest:
                for g in range(axes.shape[1]):
                    R[s, t, a, g] = variance_at(g, 2, h[s, t, a], spread[s, t, a], looks[s, j], axes, fence, rules)


@inlined
def change(
    j, axis, k, end, spent, total, U, ahead, H, tables, chosen, axes, sizes, weights, F, Q, fence, rules, T, v, nn
):
    """Give platform j the best grid point of an axis, the same at steps k to ``end`` - 1; returns the plan's cost.

    The plan does not change if no point costs less than ``total``. spent: cost of the steps before k.
    """
    turns, kept, best = axis == 1 and axes[3].any(), chosen[k:end, j, axis].copy(), -1
    least, turned = total, np.nan
    for g in range(sizes[axis]):
        chosen[k:end, j, axis] = g
        if turns and axes[3, g, 2] != turned:
            turned = axes[3, g, 2]
            turn_later(j, k, ahead, tables[0], chosen, axes, fence, rules)
        cost = spent + follow(U, H, tables, chosen, k, len(chosen) - 1, weights, F, Q, least - spent, T, v, nn)
        if cost < least - BETTER * total:
            best, least = g, cost
    if best >= 0:
        kept[:] = best
    copy_vector(kept, chosen[k:end, j, axis])
    if turns:
        turn_later(j, k, ahead, tables[0], chosen, axes, fence, rules)
    return least


@kernel
def improve(U, ahead, H, tables, chosen, axes, sizes, weights, F, Q, fence, rules, T, v, nn):
    """Change one grid point of one platform at one step at a time, as long as the plan's cost falls.

    A platform that turns may also take the same turn at all remaining steps, because one turn may not reach a target.
    U (s + 1, t, n, n) holds the covariances of the current plan. The tables remain those of the first plan, except that
    they follow the platforms' turns.
    """
    (depth, platforms), turning = chosen.shape[:2], axes[3].any()
    total = follow(U, H, tables, chosen, 0, depth - 1, weights, F, Q, np.inf, T, v, nn)
    for _ in range(SWEEPS):
        before, spent = total, 0.0  # spent: cost of the steps before k
        for k in range(depth):
            for j in range(platforms):
                for axis, end in ((0, k + 1), (1, k + 1), (1, depth)):
                    if end == k + 1 or turning:
                        total = change(
                            j, axis, k, end, spent, total, U, ahead, H, tables, chosen, axes, sizes, weights, F, Q,
                            fence, rules, T, v, nn
                        )  # fmt: skip
            spent += follow(U, H, tables, chosen, k, k, weights, F, Q, np.inf, T, v, nn)
        if total >= before:
            break


@kernel
def foresee(step, x, U, ahead, H, tables, chosen, search, axes, sizes, weights, scene, Q, room, nn):
    """Fill x, U, looks and the tables of each step of the plan ``chosen`` from x[0], U[0], looks[0]; returns its cost.

    ahead: looks (s + 1, p), the look directions before each step, h and spread (s, t, a). search: the one-step
    scheduler also fills ``chosen``. room: scratch space.
    """
    (R, seen, widths, here), (looks, h, spread), (other, W, rest, v) = tables, ahead, room
    total = 0.0
    for k in range(chosen.shape[0]):
        now = (R[k], seen[k], widths, here[k])
        predict_ahead(step + k, x[k], U[k], scene, Q, x[k + 1], U[k + 1], h[k], H[k], nn)
        tabulate(U[k + 1], h[k], H[k], looks[k], axes, scene.fence, scene.rules, now, spread[k])
        if search:
            best_of_two(U[k + 1], H[k], now, sizes, weights, chosen[k], other, W, rest, v, nn)
        absorb_all(U[k + 1], H[k], now, chosen[k], v, nn)
        for j in range(chosen.shape[1]):
            looks[k + 1, j] = wrapped(looks[k, j] + axes[3, chosen[k, j, 1], 2])
        total += weighted_trace(U[k + 1], here[k], weights)
    return total


@kernel
def plan(step, mean, P, looks, horizon, axes, sizes, weights, scene, chosen, cost, nn):
    """Fill ``chosen`` (e, s, p, 2), an improved plan of the one-step scheduler, and its predicted cost (e,).

    The plan is shorter at the episode's end. The value of a setting may depend on earlier steps of the plan, through
    the spread and the look directions. In that case the plan is improved again with the spread and look directions that
    it leads to, as long as its cost falls.
    """
    (count, depth, platforms), targets, n = chosen.shape[:3], mean.shape[1], len(nn)
    rows, points = 3 * platforms, axes.shape[1]
    x, U = np.empty((depth + 1, targets, n)), np.empty((depth + 1, targets, n, n))
    W, rest, spread = np.empty(U.shape[1:]), np.empty(U.shape[1:]), np.empty((depth, targets, rows))
    h, H = np.empty((depth, targets, rows)), np.empty((depth, targets, rows, n))
    R, seen = np.empty((depth, targets, rows, points)), np.empty((depth, targets, platforms, points))
    tables = R, seen, np.empty((points, 3)), np.empty((depth, targets), np.bool_)
    T, v, other = np.empty((n, n)), np.empty(n), np.empty((platforms, 2), np.int64)
    room, ahead = (other, W, rest, v), (np.empty((depth + 1, platforms)), h, spread)
    F, fence, rules = scene.F, scene.fence, scene.rules
    depends = rules.folding or rules.margin > 0.0 or axes[3].any()
    for e in range(count):
        Q = noise_of(e, scene)
        levels = max(1, min(depth, horizon - step[e]))
        best, trial = chosen[e, :levels], np.empty((levels, platforms, 2), np.int64)
        x[0], U[0], ahead[0][0], least = mean[e], P[e], looks[e], np.inf
        for attempt in range(SWEEPS):
            total = foresee(
                step[e], x, U, ahead, H, tables, trial, attempt == 0, axes, sizes, weights, scene, Q, room, nn
            )  # fmt: skip
            if total >= least * (1.0 - BETTER):
                break
            best[:], least = trial, total
            if attempt > 0 and not depends:
                break
            improve(U, ahead, H, tables, trial, axes, sizes, weights, F, Q, fence, rules, T, v, nn)
        cost[e] = least
