"""What beams are worth to index rules, in compiled form: expected covariances of the targets they look at.

Axes and argument groups as in ``agile_clutter/prediction_kernels``. A target's covariance depends on who looks at it
and with what only, so it is predicted once for every way to look at it, not for every joint action. A way is a number
with one digit for every sensor, the last sensor's the lowest: 0 it looks elsewhere, d > 0 it looks with chirp d - 1.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import kernel
from wavegym.sensors.detection_kernels import detection
from wavegym.sensors.kernels import inverse_snr
from wavegym.systems.agile_clutter.kernels import predict_targets
from wavegym.systems.agile_clutter.prediction_kernels import reduction
from wavegym.trackers.jpda_kernels import gain_one, shrink_one
from wavegym.trackers.ukf_kernels import predict_measurement_one


@kernel
def foresee_chirps(i, way, apart, x, P, chirps, radar, q2, work, nn):
    """P[way + d apart], d = 1, 2, ...: as expected after sensor i's look with chirp d - 1 at the target of P[way].

    What does not depend on the chirp (the unscented transform, eta, Pd) is done once. work: scratch (A, z, S, G, K).
    """
    A, z, S, G, K = work
    sensors, reference, nearest, log_pf = radar[0], radar[1], radar[2], radar[3]
    predict_measurement_one(0, way, x, P, sensors[i, 0], sensors[i, 1], A, z, S, G, nn)
    weakness = inverse_snr(z[0, 0], reference, nearest)
    pd = detection(1.0 / weakness, log_pf)
    spread = (S[0, 0, 0], S[0, 0, 1], S[0, 1, 1])
    for d in range(1, len(chirps) + 1):
        C = chirps[d - 1]
        s0, s1, s2 = spread[0] + weakness * C[0, 0], spread[1] + weakness * C[0, 1], spread[2] + weakness * C[1, 1]
        S[0, 0, 0], S[0, 0, 1], S[0, 1, 0], S[0, 1, 1] = s0, s1, s1, s2
        share = reduction(pd, (s0, s1, s2), radar, q2)
        for a in range(len(nn)):
            for b in range(len(nn)):
                P[way + d * apart, a, b] = P[way, a, b]
        gain_one(0, G, S, K, nn)
        shrink_one(way + d * apart, P, K, share * s0, share * s1, share * s2, nn)


@kernel
def foresee_ways(x, P, chirps, radar, q2, M, worth, work, nn):
    """worth (way,): what each way to look takes off trace(M P) of a target with mean x (way, n), covariance P[0]."""
    sensors, base, ways = len(radar[0]), len(chirps) + 1, len(worth)
    apart = ways
    for i in range(sensors):
        stride, apart = apart, apart // base
        for way in range(0, ways, stride):
            foresee_chirps(i, way, apart, x, P, chirps, radar, q2, work, nn)
    for way in range(ways):
        worth[way] = 0.0
        for a in range(len(nn)):
            for b in range(len(nn)):
                worth[way] += M[a, b] * (P[0, a, b] - P[way, a, b])


@kernel
def gain(step, mean, covariance, visible, wait, ahead, ways_of, ways, chirps, M, F, Q, radar, q2, out, nn):
    """out (e, c): what joint action c takes off trace(M P) after ``wait`` (e, c) steps without any measurement.

    visible (e, H, t). ways_of (c, t): the way in which each action looks at each target, of ``ways``; chirps (d, 2, 2).
    M (L, n, n): of 1, 2, ... L steps; of ``ahead`` (e, t) steps those are counted that the episode still has.
    Candidates that wait for the same time share their work where they stand side by side.
    """
    count_t, n, horizon = mean.shape[1], len(nn), visible.shape[1]
    present, worth = np.ones(count_t, np.bool_), np.empty((count_t, ways))
    x, P = np.empty((1, count_t, n)), np.empty((1, count_t, n, n))
    own, spread = np.empty((ways, n)), np.empty((ways, n, n))
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
                x[0], P[0] = mean[e], covariance[e]
                for _ in range(known + 1):
                    predict_targets(0, x, P, present, F, Q, x[0], P[0], nn)
                for t in range(count_t):
                    worth[t] = 0.0
                    if visible[e, k, t]:
                        own[:], spread[0] = x[0, t], P[0, t]
                        counted = M[min(ahead[e, t], horizon - k) - 1]
                        foresee_ways(own, spread, chirps, radar, q2, counted, worth[t], work, nn)
            for t in range(count_t):
                out[e, c] += worth[t, ways_of[c, t]]
