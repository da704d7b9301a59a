"""Compiled gain of beams for index heuristics: expected covariances of the illuminated targets.

Axes and argument groups as in ``agile_clutter.prediction_kernels``. A target's covariance depends only on the chirps
that the sensors send at it, so it is predicted once for every combination of chirps, not for every joint action. A
code names a combination: a number with one digit for every sensor, the last sensor's digit the lowest; digit 0 means
that the beam points elsewhere, d > 0 that it sends chirp d - 1.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.array_kernels import copy_matrices, copy_matrix, copy_vector
from wavegym.core.kernels import kernel
from wavegym.sensors.detection_kernels import inverse_snr
from wavegym.systems.agile_clutter.kernels import expected_echo, false_density, predict_targets
from wavegym.systems.agile_clutter.prediction_kernels import reduction
from wavegym.trackers.jpda_kernels import gain_one, shrink_one
from wavegym.trackers.ukf_kernels import predict_measurement_one


@kernel
def predict_chirps(i, code, place, x, P, chirps, windows, radar, q2, work, nn):
    """Fill P[code + d place], d = 1, 2, ...: the expected P[code] after sensor i's chirp d - 1.

    ``place``: value of sensor i's digit. The unscented transform and eta do not depend on the chirp and are computed
    once. work: scratch (A, z, S, G, K).
    """
    A, z, S, G, K = work
    sensors = radar.sensors
    predict_measurement_one(0, code, x, P, sensors[i, 0], sensors[i, 1], A, z, S, G, nn)
    weakness = inverse_snr(z[0, 0], radar.reference, radar.nearest)
    spread = (S[0, 0, 0], S[0, 0, 1], S[0, 1, 1])
    for d in range(1, len(chirps) + 1):
        C = chirps[d - 1]
        C00, C01, C11 = C[0, 0], C[0, 1], C[1, 1]
        pd, R00, R01, R11 = expected_echo(
            z[0, 0], z[0, 1], spread[2], weakness, C00, C01, C11, d - 1, windows, 0, radar
        )
        for a in range(len(nn)):
            for b in range(len(nn)):
                P[code + d * place, a, b] = P[code, a, b]
        if pd == 0.0:
            continue
        s0, s1, s2 = spread[0] + R00, spread[1] + R01, spread[2] + R11
        density = false_density(C00, C01, C11, 0, radar)
        S[0, 0, 0], S[0, 0, 1], S[0, 1, 0], S[0, 1, 1] = s0, s1, s1, s2
        share = reduction(pd, (s0, s1, s2), density, q2)
        gain_one(0, G, S, K, nn)
        shrink_one(code + d * place, P, K, share * s0, share * s1, share * s2, nn)


@kernel
def predict_codes(x, P, chirps, windows, radar, q2, M, worth, work, nn):
    """worth (code,): reduction of trace(M P) by each code's chirps; target with mean x (code, n), covariance P[0]."""
    sensors, base, codes = len(radar.sensors), len(chirps) + 1, len(worth)
    place = codes
    for i in range(sensors):
        stride, place = place, place // base
        for code in range(0, codes, stride):
            predict_chirps(i, code, place, x, P, chirps, windows, radar, q2, work, nn)
    for code in range(codes):
        worth[code] = 0.0
        for a in range(len(nn)):
            for b in range(len(nn)):
                worth[code] += M[a, b] * (P[0, a, b] - P[code, a, b])


@kernel
def gain(step, mean, covariance, visible, wait, ahead, code_of, codes, chirps, windows, M, F, Q, radar, q2, out, nn):
    """out (e, c): reduction of trace(M P) by joint action c after ``wait`` (e, c) steps without any measurement.

    visible (e, H, t). code_of (c, t): each action's code at each target, one of ``codes``; chirps (d, 2, 2) and
    windows (d, 11): see ``agile_clutter.kernels``.
    M (L, n, n): for 1, 2, ... L steps. ``ahead`` (e, t): steps that count, up to the end of the episode.
    Neighbouring candidates with equal waits share their work.
    """
    count_t, n, horizon = mean.shape[1], len(nn), visible.shape[1]
    present, worth = np.ones(count_t, np.bool_), np.empty((count_t, codes))
    x, P = np.empty((1, count_t, n)), np.empty((1, count_t, n, n))
    own, spread = np.empty((codes, n)), np.empty((codes, n, n))
    work = (np.empty((1, n, n)), np.empty((1, 2)), np.empty((1, 2, 2)), np.empty((1, n, 2)), np.empty((n, 2)))
    for e in range(len(step)):
        known = -1
        for c in range(wait.shape[1]):
            out[e, c] = 0.0
            k = step[e] + wait[e, c]
            if k >= horizon:
                continue
            if wait[e, c] != known:
                known = wait[e, c]
                copy_matrix(mean[e], x[0])
                copy_matrices(covariance[e], P[0])
                for _ in range(known + 1):
                    predict_targets(0, x, P, present, F, Q, x[0], P[0], nn)
                for t in range(count_t):
                    worth[t] = 0.0
                    if visible[e, k, t]:
                        for code in range(codes):
                            copy_vector(x[0, t], own[code])
                        copy_matrix(P[0, t], spread[0])
                        counted = M[min(ahead[e, t], horizon - k) - 1]
                        predict_codes(own, spread, chirps, windows, radar, q2, counted, worth[t], work, nn)
            for t in range(count_t):
                out[e, c] += worth[t, code_of[c, t]]
