"""Cost and key figures of the urban loop in compiled form; ``state_info`` of the system says what they mean.

Shapes: e environments, s slots, t targets, M models, n = 6 states; x (e, s, M, n), P (e, s, M, n, n), mu (e, s, M).
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import math

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.systems.urban.tracker_kernels import CONFIRMED, EMPTY
from wavegym.trackers.imm_kernels import combine_one


@inlined
def rows_of(e, x, P):
    """x (s M, n) and P (s M, n, n) of environment e, as ``combine_one`` takes them."""
    rows, n = x.shape[1] * x.shape[2], x.shape[3]
    return x[e].reshape(rows, n), P[e].reshape(rows, n, n)


@kernel
def costs(x, P, mu, existence, weights, absent, out, nn, mm):
    """out (e, s): the cost of every slot, from the least one up; ``absent``: that of a track that is not there."""
    slots, n = mu.shape[1], len(nn)
    mean, covariance = np.empty((slots, n)), np.empty((slots, n, n))
    for e in range(len(out)):
        own_x, own_P = rows_of(e, x, P)
        for s in range(slots):
            combine_one(s, own_x, own_P, mu[e], mean, covariance, nn, mm)
            trace = 0.0
            for k in range(n):
                trace += covariance[s, k, k] * weights[k]
            out[e, s] = absent - existence[e, s] * (absent - min(trace, absent))
        out[e].sort()


@inlined
def distance_one(e, t, s, targets, mean):
    """Distance of target t from the mean of track s, m."""
    return math.hypot(targets[e, t, 0] - mean[s, 0], targets[e, t, 1] - mean[s, 1])


@inlined
def nearest_one(e, t, targets, sure, mean):
    """Distance of target t from the nearest confirmed track, infinite without one, and the slot of this track."""
    least, near = np.inf, 0
    for s in range(sure.shape[1]):
        distance = distance_one(e, t, s, targets, mean) if sure[e, s] else np.inf
        if distance < least:
            least, near = distance, s
    return least, near


@inlined
def is_false(e, s, targets, present, mean, within):
    """Whether no target is near track s."""
    alone = True
    for t in range(targets.shape[1]):
        alone = alone and not (present[e, t] and distance_one(e, t, s, targets, mean) <= within)
    return alone


@kernel
def squared_error(e, t, s, targets, mean, covariance, off):
    """NEES of position and velocity of target t by track s; off (4,): scratch space."""
    for k in range(4):
        off[k] = targets[e, t, k] - mean[s, k]
    solved, total = np.linalg.solve(covariance[s, :4, :4].copy(), off), 0.0
    for k in range(4):
        total += off[k] * solved[k]
    return total


@kernel
def figures(
    step, x, P, mu, status, targets, present, number, direct, within, values, flags, counts, sure, places, nn, mm
):
    """Fill the figures of targets, the counts of a scan, and which tracks are confirmed, with their places.

    targets (e, t, n), present (e, t), number (e, pair): the truth. direct (scan, t): whether the direct paths are
    visible. within: greatest distance at which a track holds a target, m. values (3, e, t): position error, position
    variance and NEES; flags (2, e, t): held and lost; counts (4, e): confirmed, false and tentative tracks,
    measurements; sure (e, s); places (e, s, 2): x and y of confirmed tracks, otherwise 0.
    """
    slots, n = mu.shape[1], len(nn)
    mean, covariance, off = np.empty((slots, n)), np.empty((slots, n, n)), np.empty(4)
    places[:], counts[:] = 0.0, 0
    for e in range(len(step)):
        own_x, own_P = rows_of(e, x, P)
        for s in range(slots):
            sure[e, s] = status[e, s] == CONFIRMED
            counts[2, e] += status[e, s] != EMPTY and not sure[e, s]
            if sure[e, s]:
                combine_one(s, own_x, own_P, mu[e], mean, covariance, nn, mm)
                places[e, s, 0], places[e, s, 1] = mean[s, 0], mean[s, 1]
                counts[0, e] += 1
                counts[1, e] += is_false(e, s, targets, present, mean, within)
        counts[3, e] = number[e].sum()
        for t in range(targets.shape[1]):
            least, near = nearest_one(e, t, targets, sure, mean)
            held = present[e, t] and least <= within
            flags[0, e, t], flags[1, e, t] = held, direct[step[e], t] and not held
            values[0, e, t], values[1, e, t], values[2, e, t] = min(least, within) if present[e, t] else 0.0, 0.0, 0.0
            if held:
                values[1, e, t] = covariance[near, 0, 0] + covariance[near, 1, 1]
                values[2, e, t] = squared_error(e, t, near, targets, mean, covariance, off)
