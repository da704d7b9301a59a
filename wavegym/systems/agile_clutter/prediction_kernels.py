"""Prediction of the agile-clutter loop for schedulers: unscented covariances, sensor after sensor.

Sira et al., eqs. (13) and (14) with the bracket corrected: P - q2 Pxz (Pzz + N)^-1 Pxz', N = C over the effective eta
at the predicted range, q2 the information reduction factor. Axes and argument groups as in ``kernels``; c candidate.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import kernel
from wavegym.sensors.detection_kernels import inverse_snr
from wavegym.systems.agile_clutter.kernels import (
    density_of,
    expected_echo,
    expected_echo_of,
    false_density,
    is_lit,
    is_present,
    predict_targets,
    row,
)
from wavegym.systems.agile_clutter.state import Pulse
from wavegym.trackers.jpda_kernels import GATE, gain_one, reduction_one, shrink_one
from wavegym.trackers.kernels import squared_mahalanobis_one
from wavegym.trackers.ukf_kernels import predict_measurement_one


@kernel
def reduction(pd, S, density, q2):
    """The factor q2 for the innovation covariance S, given as its three entries, and a density of false returns.

    The table was made for one gate. q2 depends on the clutter density, so every q2 is read at the area of that gate.
    """
    area = np.pi * GATE * GATE * np.sqrt(S[0] * S[2] - S[1] * S[1])
    return reduction_one(pd, np.log(density * area), q2[0], q2[1], q2[2])


@kernel
def information(pd, chance, S, density, q2, draw):
    """Predicted share of the full update.

    Expectation (draw < 0): q2 times the probability that the target is visible. With a uniform draw: q2 / Pd for a
    detection, 0 for a miss. Without clutter a detection counts as 1: q2 / Pd would include the average loss outside the
    gate.
    """
    if draw < 0.0:
        return chance * reduction(pd, S, density, q2)
    if draw >= chance * pd:
        return 0.0
    return reduction(pd, S, density, q2) / pd if density > 0.0 else 1.0


@kernel
def predict_sensor(e, i, x, P, lit, pulse, draws, radar, q2, A, z, S, G, K, nn):
    """Update P (t, n, n) by sensor i's pulse; draws[e, i, t]: uniform, or negative for the expected outcome."""
    sensors, chance, density = radar.sensors, pulse.chance, density_of(e, i, pulse, radar)
    for t in range(len(lit)):
        if lit[t]:
            predict_measurement_one(t, t, x, P, sensors[i, 0], sensors[i, 1], A, z, S, G, nn)
            pd, R00, R01, R11 = expected_echo_of(e, i, z[t, 0], z[t, 1], S[t, 1, 1], pulse, radar)
            if pd == 0.0:
                continue
            S[t, 0, 0] += R00
            S[t, 0, 1] += R01
            S[t, 1, 0] += R01
            S[t, 1, 1] += R11
            entries = (S[t, 0, 0], S[t, 0, 1], S[t, 1, 1])
            draw = draws[row(e, draws), i, t]
            share = information(pd, chance[row(e, chance), i, t], entries, density, q2, draw)
            gain_one(t, G, S, K, nn)
            shrink_one(t, P, K, share * entries[0], share * entries[1], share * entries[2], nn)


@kernel
def predict(step, mean, covariance, pulse, draws, targets, F, Q, radar, q2, x_out, P_out, nn):
    """One step ahead: predicted means, covariances after all sensors' pulses. All arrays with one flat axis e."""
    birth, lifetime = targets
    count_t, n = len(birth), len(nn)
    present, lit = np.empty(count_t, np.bool_), np.empty(count_t, np.bool_)
    x, P = np.empty((count_t, n)), np.empty((count_t, n, n))
    A, z, S = np.empty((count_t, n, n)), np.empty((count_t, 2)), np.empty((count_t, 2, 2))
    G, K = np.empty((count_t, n, 2)), np.empty((n, 2))
    for e in range(len(step)):
        is_present(step[e] + 1, birth, lifetime, present)
        predict_targets(e, mean, covariance, present, F, Q, x, P, nn)
        for i in range(len(radar.sensors)):
            is_lit(e, i, present, pulse.chance, lit)
            predict_sensor(e, i, x, P, lit, pulse, draws, radar, q2, A, z, S, G, K, nn)
        for t in range(count_t):
            for a in range(n):
                x_out[e, t, a] = x[t, a]
                for b in range(n):
                    P_out[e, t, a, b] = P[t, a, b]


@kernel
def predict_present(step, mean, covariance, targets, F, Q, x_out, P_out, present_out, nn):
    """The belief (e, t, ...) at the time of the next pulse, before any sensor measures."""
    birth, lifetime = targets
    for e in range(len(step)):
        is_present(step[e] + 1, birth, lifetime, present_out[e])
        predict_targets(e, mean, covariance, present_out[e], F, Q, x_out[e], P_out[e], nn)


@kernel
def sensor_costs(i, x, P, present, C, windows, alarm, weights, radar, q2, cost, nn):
    """cost (e, c) = trace(Lambda P) after sensor i's pulse with C (e or 1, c, 2, 2) at unit SNR, windows (same, c, 11)
    and row of its threshold alarm (c,).

    The unscented transform and eta do not depend on the pulse and are computed once.
    """
    sensors = radar.sensors
    count_t, n = present.shape[1], len(nn)
    A, z, S = np.empty((count_t, n, n)), np.empty((count_t, 2)), np.empty((count_t, 2, 2))
    G = np.empty((count_t, n, 2))
    for e in range(len(x)):
        row = e if len(C) > 1 else 0
        for c in range(C.shape[1]):
            cost[e, c] = 0.0
        for t in range(count_t):
            if not present[e, t]:
                continue
            predict_measurement_one(t, t, x[e], P[e], sensors[i, 0], sensors[i, 1], A, z, S, G, nn)
            weakness = inverse_snr(z[t, 0], radar.reference, radar.nearest)
            before = g00 = g01 = g11 = 0.0
            for a in range(n):
                before += weights[a] * P[e, t, a, a]
                g00 += weights[a] * G[t, a, 0] * G[t, a, 0]
                g01 += weights[a] * G[t, a, 0] * G[t, a, 1]
                g11 += weights[a] * G[t, a, 1] * G[t, a, 1]
            for c in range(C.shape[1]):
                C00, C01, C11 = C[row, c, 0, 0], C[row, c, 0, 1], C[row, c, 1, 1]
                pd, R00, R01, R11 = expected_echo(
                    z[t, 0], z[t, 1], S[t, 1, 1], weakness, C00, C01, C11, c, windows[row], alarm[c], radar
                )  # fmt: skip
                if pd == 0.0:
                    cost[e, c] += before
                    continue
                s0, s1, s2 = S[t, 0, 0] + R00, S[t, 0, 1] + R01, S[t, 1, 1] + R11
                density = false_density(C00, C01, C11, alarm[c], radar)
                gained = (g00 * s2 - 2.0 * g01 * s1 + g11 * s0) / (s0 * s2 - s1 * s1)
                cost[e, c] += before - reduction(pd, (s0, s1, s2), density, q2) * gained


@kernel
def after_sensor(i, x, P, present, C, windows, alarm, radar, q2, P_out, nn):
    """P_out (e, t, n, n) after sensor i's pulse with C (e, 2, 2), windows (e, 11) and row of its threshold alarm (e,),
    before the next sensor's pulse.
    """
    count_t, n = present.shape[1], len(nn)
    A, z, S = np.empty((count_t, n, n)), np.empty((count_t, 2)), np.empty((count_t, 2, 2))
    G, K = np.empty((count_t, n, 2)), np.empty((n, 2))
    draws = np.full((1, i + 1, count_t), -1.0)
    own, window, threshold = np.empty((1, i + 1, 2, 2)), np.zeros((1, i + 1), np.int64), np.zeros((1, i + 1), np.int64)
    pulse = Pulse(own, np.ones((1, i + 1)), np.ones((1, i + 1, count_t)), threshold, window, windows)
    for e in range(len(x)):
        window[0, i], threshold[0, i] = e, alarm[e]
        for a in range(2):
            for b in range(2):
                own[0, i, a, b] = C[e, a, b]
        for t in range(count_t):
            for a in range(n):
                for b in range(n):
                    P_out[e, t, a, b] = P[e, t, a, b]
        predict_sensor(0, i, x[e], P_out[e], present[e], pulse, draws, radar, q2, A, z, S, G, K, nn)


@kernel
def weighted_trace(step, covariance, targets, weights, cost):
    """cost (e,) = trace(Lambda P) summed over the targets present at ``step`` (e,)."""
    birth, lifetime = targets
    for e in range(len(step)):
        cost[e] = 0.0
        for t in range(len(birth)):
            if birth[t] < step[e] <= birth[t] + lifetime:
                for a in range(len(weights)):
                    cost[e] += weights[a] * covariance[e, t, a, a]


@kernel
def observe(step, mean, covariance, horizon, targets, F, Q, radar, out, nn):
    """out (e, field): ``AgileClutter.observation_fields`` of the belief at the time of the next pulse.

    The fields of a slot without a target at that time are 0.
    """
    birth, lifetime = targets
    sensors, reference, nearest = radar.sensors, radar.reference, radar.nearest
    count_t, n = len(birth), len(nn)
    present = np.empty(count_t, np.bool_)
    x, P = np.empty((count_t, n)), np.empty((count_t, n, n))
    A, z, S, G = np.empty((count_t, n, n)), np.empty((count_t, 2)), np.empty((count_t, 2, 2)), np.empty((count_t, n, 2))
    for e in range(len(step)):
        is_present(step[e] + 1, birth, lifetime, present)
        predict_targets(e, mean, covariance, present, F, Q, x, P, nn)
        out[e, 0] = 1.0 - step[e] / horizon
        column = 1
        for t in range(count_t):
            out[e, column] = present[t]
            for c in range(1, 3 + 4 * len(sensors)):
                out[e, column + c] = 0.0
            if present[t]:
                out[e, column + 1] = 0.5 * np.log10(P[t, 0, 0] + P[t, 1, 1])
                out[e, column + 2] = 0.5 * np.log10(P[t, 2, 2] + P[t, 3, 3])
                for i in range(len(sensors)):
                    predict_measurement_one(t, t, x, P, sensors[i, 0], sensors[i, 1], A, z, S, G, nn)
                    c = column + 3 + 4 * i
                    out[e, c] = -10.0 * np.log10(inverse_snr(z[t, 0], reference, nearest))
                    out[e, c + 1], out[e, c + 2] = 0.5 * np.log10(S[t, 0, 0]), 0.5 * np.log10(S[t, 1, 1])
                    out[e, c + 3] = S[t, 0, 1] / np.sqrt(S[t, 0, 0] * S[t, 1, 1])
            column += 3 + 4 * len(sensors)


@kernel
def track_errors(step, mean, covariance, truth, weight, targets, weights, values, present, components):
    """Key figures of the present targets (else 0), and the number of components of their mixtures, (e, t) each.

    values (4, e, t): position error, position variance, squared error (weighted) and NEES. present (e, t): whether a
    target is present. weight (e, t, c): of the components of mixtures.
    """
    birth, lifetime = targets
    n = len(weights)
    L, d = np.empty((n, n)), np.empty(n)
    values[:], components[:] = 0.0, 0
    for e in range(len(step)):
        is_present(step[e], birth, lifetime, present[e])
        for t in range(len(birth)):
            if present[e, t]:
                for a in range(n):
                    d[a] = mean[e, t, a] - truth[e, t, a]
                    values[2, e, t] += weights[a] * d[a] * d[a]
                values[0, e, t] = np.sqrt(d[0] * d[0] + d[1] * d[1])
                values[1, e, t] = covariance[e, t, 0, 0] + covariance[e, t, 1, 1]
                values[3, e, t] = squared_mahalanobis_one(t, d, covariance[e], L, (0, 0, 0, 0))
                for c in range(weight.shape[2]):
                    components[e, t] += weight[e, t, c] > 0.0
