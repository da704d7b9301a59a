"""Compiled gain of a pulse after a pause, for heuristics with a price of energy.

Axes and argument groups as in ``agile_clutter.kernels``; c candidate. ``pulse`` has an entry for each candidate.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.array_kernels import copy_matrices, copy_matrix
from wavegym.core.kernels import kernel
from wavegym.systems.agile_clutter.kernels import density_of, expected_echo_of, is_lit, is_present, predict_targets
from wavegym.systems.agile_clutter.prediction_kernels import information, predict_sensor
from wavegym.systems.agile_clutter.state import Pulse
from wavegym.trackers.ukf_kernels import predict_measurement_one


@kernel
def gain(step, mean, covariance, wait, clear, left, M, pulse, choices, targets, F, Q, radar, q2, out, nn):
    """out (e, c) = trace(M (P without - P with)), summed over targets, of candidate c's pulse after wait[e, c] steps.

    clear (e, c): probability that the slot is clear; 0 gives 0. left (e, c): steps from that pulse to the episode's
    end. M (l, n, n) is for 1, 2, ... steps; the entry of ``left`` counts, or the last. choices (c, sensor): neighbours
    that differ in the last sensor only share the work for the other sensors, so the order of a joint library is the
    fastest.
    """
    count_t, n, last = len(targets[0]), len(nn), choices.shape[1] - 1
    present, lit = np.empty(count_t, np.bool_), np.empty(count_t, np.bool_)
    x, seen = np.empty((count_t, n)), np.empty(pulse.chance.shape)
    P = np.empty((last + 1, count_t, n, n))  # before the first sensor's pulse, and after each pulse except the last
    A, z, S = np.empty((count_t, n, n)), np.empty((count_t, 2)), np.empty((count_t, 2, 2))
    G, K, draws = np.empty((count_t, n, 2)), np.empty((n, 2)), np.full((1, last + 1, count_t), -1.0)
    for e in range(len(step)):
        before, fallen = -1, 0.0  # before: the candidate to which the predictions P and x belong
        for c in range(len(choices)):
            if clear[e, c] <= 0.0:
                out[e, c] = 0.0
                continue
            start, own = 0, M[min(left[e, c], len(M)) - 1]
            if before < 0 or wait[e, c] != wait[e, before]:
                predict_later(e, step[e], mean, covariance, wait[e, c], targets, F, Q, present, x, P[0], nn)
                before = -1
            else:
                while start < last and choices[c, start] == choices[before, start]:
                    start += 1
            seen[c] = clear[e, c] * pulse.chance[c]
            for i in range(start, last):
                P[i + 1] = P[i]
                is_lit(c, i, present, seen, lit)
                used = Pulse(pulse.C, pulse.strength, seen, pulse.alarm, pulse.window, pulse.windows)
                predict_sensor(c, i, x, P[i + 1], lit, used, draws, radar, q2, A, z, S, G, K, nn)
            if before < 0 or start < last:
                fallen = fall(P[0], P[last], present, own)
                for t in range(count_t):
                    if present[t]:
                        predict_measurement_one(
                            t, t, x, P[last], radar.sensors[last, 0], radar.sensors[last, 1], A, z, S, G, nn
                        )
            out[e, c] = fallen + last_fall(c, last, present, pulse, seen, z, S, G, own, radar, q2)
            before = c


@kernel
def last_fall(c, i, present, pulse, seen, z, S, G, M, radar, q2):
    """Reduction of trace(M P) by the last sensor's pulse, summed over targets; z, S, G: predicted for this sensor."""
    total = 0.0
    for t in range(len(present)):
        if present[t] and seen[c, i, t] > 0.0:
            pd, R00, R01, R11 = expected_echo_of(c, i, z[t, 0], z[t, 1], S[t, 1, 1], pulse, radar)
            if pd == 0.0:
                continue
            s0, s1, s2 = S[t, 0, 0] + R00, S[t, 0, 1] + R01, S[t, 1, 1] + R11
            share = information(pd, seen[c, i, t], (s0, s1, s2), density_of(c, i, pulse, radar), q2, -1.0)
            g00 = g01 = g11 = 0.0
            for a in range(len(M)):
                for b in range(len(M)):
                    g00 += M[a, b] * G[t, a, 0] * G[t, b, 0]
                    g01 += M[a, b] * G[t, a, 0] * G[t, b, 1]
                    g11 += M[a, b] * G[t, a, 1] * G[t, b, 1]
            total += share * (g00 * s2 - 2.0 * g01 * s1 + g11 * s0) / (s0 * s2 - s1 * s1)
    return total


@kernel
def predict_later(e, step, mean, covariance, wait, targets, F, Q, present, x, P, nn):
    """x (t, n), P (t, n, n), present (t,): the belief of environment e at a pulse after ``wait`` more steps."""
    birth, lifetime = targets
    y, V = mean[e : e + 1].copy(), covariance[e : e + 1].copy()
    for k in range(wait + 1):
        is_present(step + 1 + k, birth, lifetime, present)
        predict_targets(0, y, V, present, F, Q, x, P, nn)
        copy_matrix(x, y[0])
        copy_matrices(P, V[0])


@kernel
def fall(before, after, present, M):
    """trace(M (before - after)) summed over the targets present."""
    total = 0.0
    for t in range(len(present)):
        if present[t]:
            for a in range(len(M)):
                for b in range(len(M)):
                    total += M[a, b] * (before[t, b, a] - after[t, b, a])
    return total
