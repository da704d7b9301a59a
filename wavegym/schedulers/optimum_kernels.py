"""Branch and bound over waveform schedules in compiled form; ``optimum.py`` proves the dominance rule.

Shapes: e environments, n states, m measurements, A actions, H steps, N nodes. F, Q (1, n, n), M (1, m, n), R
(H, A, m, m) measurement covariances.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wavegym.core.kernels import kernel
from wavegym.trackers.kernels import factor_innovation_one, predict_covariance_one, update_covariance_one

DEPTH, SLACK = 3, 0.03  # steps from zero covariance in the bound on the cost to come; slack of the dominance


class Nodes(NamedTuple):
    """Beliefs of one step, each reached by a different schedule."""

    cost: NDArray[np.float64]  # (N,) up to this step
    P: NDArray[np.float64]  # (N, n, n)
    origin: NDArray[np.int64]  # (N,) parent's index times A, plus the action


class Model(NamedTuple):
    """The part of the recursion that all environments share."""

    F: NDArray[np.float64]
    Q: NDArray[np.float64]
    M: NDArray[np.float64]
    weights: NDArray[np.float64]  # (n,)


@kernel
def make_nodes(count, nn):
    """Empty arrays for ``count`` nodes."""
    return Nodes(np.empty(count), np.empty((count, len(nn), len(nn))), np.empty(count, np.int64))


@kernel
def copy(P, P_out, nn):
    """P_out = P, (n, n); a slice assignment takes seconds to compile."""
    for i in range(len(nn)):
        for j in range(len(nn)):
            P_out[i, j] = P[i, j]


@kernel
def dominates(b, B, a, A, factor, Z, nn):
    """Whether D = factor A[a] - B[b] is positive semidefinite; Z (n, n) is scratch space."""
    n = len(nn)
    for i in range(n):
        own = factor * A[a, i, i] - B[b, i, i]
        if own < 0.0:
            return False
        for j in range(i):
            cross = factor * A[a, i, j] - B[b, i, j]
            if own * (factor * A[a, j, j] - B[b, j, j]) < cross * cross:
                return False
    return n == 2 or eliminates(b, B, a, A, factor, Z, nn)  # for two states the minors suffice, three times as fast


@kernel
def eliminates(b, B, a, A, factor, Z, nn):
    """``dominates`` by Gaussian elimination: every pivot must be non-negative."""
    n = len(nn)
    for i in range(n):
        for j in range(i + 1):
            Z[i, j] = factor * A[a, i, j] - B[b, i, j]
    for j in range(n):
        if Z[j, j] < 0.0:
            return False
        for i in range(j + 1, n):
            if Z[j, j] > 0.0:
                ratio = Z[i, j] / Z[j, j]
                for k in range(j + 1, i + 1):
                    Z[i, k] -= ratio * Z[k, j]
            elif Z[i, j] != 0.0:
                return False
    return True


@kernel
def branch(nodes, count, model, weights, R, room, children, nn, mm):
    """Apply every action, R (A, m, m), to the first ``count`` nodes; returns how many children cost less than ``room``.

    ``nodes.P`` holds the predicted covariances afterwards.
    """
    n, m, actions = len(nn), len(mm), R.shape[0]
    T, L, D, V = np.empty((n, n)), np.empty((m, m)), np.empty(m), np.empty((n, m))
    born = 0
    for k in range(count):
        predict_covariance_one(k, nodes.P, model.F, model.Q, 0, T, nodes.P, nn)
        for a in range(actions):
            factor_innovation_one(k, nodes.P, model.M, 0, R, a, 1.0, L, D, V, nn, mm)
            update_covariance_one(k, nodes.P, D, V, born, children.P, nn, mm)
            total = nodes.cost[k]
            for i in range(n):
                total += weights[i] * children.P[born, i, i]
            if total < room:
                children.cost[born] = total
                children.origin[born] = k * actions + a
                born += 1
    return born


@kernel
def prune(children, born, slack, allowance, room, nodes, limit, nn):
    """Keep in ``nodes`` the children that no cheaper one dominates: cheapest first, at most ``limit``.

    A child A is dropped if a kept B has c_B + e (room - c_A) <= c_A + allowance and P_B <= (1 + slack + e) P_A. Returns
    the number of kept children, and the cost of the cheapest one beyond ``limit`` (inf: none).
    """
    n, kept = len(nn), 0
    Z, order = np.empty((n, n)), np.empty(limit, np.int64)
    for a in np.argsort(children.cost[:born]):
        gain, base = 1.0 / (room - children.cost[a]), 1.0 + slack
        dominated = False
        for i in range(kept):
            b = order[i]
            factor = base + (children.cost[a] - nodes.cost[b] + allowance) * gain
            if dominates(b, nodes.P, a, children.P, factor, Z, nn):
                dominated = True
                for j in range(i, 0, -1):  # it probably dominates the next child too: try it first
                    order[j] = order[j - 1]
                order[0] = b
                break
        if dominated:
            continue
        if kept == limit:
            return kept, children.cost[a]
        nodes.cost[kept], nodes.origin[kept] = children.cost[a], children.origin[a]
        copy(children.P[a], nodes.P[kept], nn)
        order[kept] = kept
        kept += 1
    return kept, np.inf


@kernel
def cost_to_come(model, R, nodes, children, nn, mm):
    """Lower bound (H,) on the cost of all later steps, for any schedule and covariance.

    Step u costs at least as much as after the best schedule of the last DEPTH steps (or fewer) from zero covariance.
    """
    horizon, n = len(R), len(nn)
    nothing = np.zeros(n), np.zeros((n, n))
    least, rest = np.zeros((horizon, DEPTH)), np.zeros(horizon)
    for start in range(horizon):
        copy(nothing[1], nodes.P[0], nn)
        nodes.cost[0], kept, lost = 0.0, 1, np.inf
        for d in range(min(DEPTH, horizon - start)):
            born = branch(nodes, kept, model, nothing[0], R[start + d], np.inf, children, nn, mm)
            least[start, d] = np.inf
            for k in range(born):
                cost = 0.0
                for i in range(n):
                    cost += model.weights[i] * children.P[k, i, i]
                least[start, d] = min(least[start, d], cost / (1.0 + SLACK) ** d)
            if d + 1 < DEPTH:
                kept, lost = prune(children, born, SLACK, 0.0, np.inf, nodes, len(nodes.cost), nn)
            if lost < np.inf:
                break
    for k in range(horizon):
        for u in range(k + 1, horizon):
            d = min(u - k, DEPTH)
            rest[k] += least[u - d + 1, d - 1]
    return rest


@kernel
def search(P0, model, R, slack, allowance, rest, ceiling, limit, nodes, children, origins, plan, nn, mm):
    """Write the cheapest schedule below ``ceiling`` to ``plan`` (H,); returns its cost and a bound on dropped ones.

    If there is none, ``plan`` is unchanged and the cost is the ceiling. ``origins`` (H, limit) is scratch space.
    """
    actions, bound = R.shape[1], np.inf
    copy(P0, nodes.P[0], nn)
    nodes.cost[0], kept = 0.0, 1
    for k in range(len(R)):
        room = ceiling - rest[k]
        born = branch(nodes, kept, model, model.weights, R[k], room, children, nn, mm)
        kept, lost = prune(children, born, slack, allowance, room, nodes, limit, nn)
        bound = min(bound, lost + rest[k])
        for i in range(kept):
            origins[k, i] = nodes.origin[i]
    if kept == 0:
        return ceiling, bound
    node = 0
    for k in range(len(R) - 1, -1, -1):
        plan[k] = origins[k, node] % actions
        node = origins[k, node] // actions
    return nodes.cost[0], bound
