"""Kernels of the urban loop: measurements of a scan (targets over all paths, clutter), and the observation."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.counter_rng_kernels import exponential, normal, stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import detection
from wavegym.sensors.multistatic_kernels import noise, snr_at
from wavegym.trackers.urban.kernels import CONFIRMED, EMPTY

CLUTTER = 10_000  # number of the random stream of clutter, beyond those of all paths


@inlined
def folded(rate, limit):
    """Range-rate as a pulse train measures it: folded into [-limit, limit]."""
    return rate - 2.0 * limit * np.rint(rate / (2.0 * limit))


@kernel
def measure_targets(key, scan, pair, scene, constants, wave, reference, limit, z, count):
    """Append the detections of targets to z[: count]; return the new count."""
    targets, most = scene.z.shape[2], scene.z.shape[3]
    for g in range(targets):
        for w in range(scene.path_count[pair, scan, g]):
            r = scene.z[pair, scan, g, w, 0]
            if r > constants.reach or count >= len(z):
                continue
            own = stream(key, g * most + w)
            eta = snr_at(r, reference, scene.reflected[pair, scan, g, w])
            if uniform(own, 0) < detection(0.5 * eta, constants.log_false_alarm):
                R00, R01, R11 = noise(wave, eta, constants.rate_floor)
                a, n0, n1 = np.sqrt(R00), normal(own, 1), normal(own, 2)
                b = R01 / a
                z[count, 0] = r + a * n0
                z[count, 1] = folded(scene.z[pair, scan, g, w, 1] + b * n0 + np.sqrt(R11 - b * b) * n1, limit)
                count += 1
    return count


@kernel
def measure_clutter(key, constants, limit, z, count):
    """Append false returns, uniform in range and range-rate, to z[: count]; return the new count."""
    own, expected, sum_of_gaps, i = stream(key, CLUTTER), constants.density * constants.reach * 2.0 * limit, 0.0, 0
    while count < len(z):
        sum_of_gaps += exponential(own, 3 * i)
        if sum_of_gaps > expected:
            break
        z[count, 0] = constants.reach * uniform(own, 3 * i + 1)
        z[count, 1] = limit * (2.0 * uniform(own, 3 * i + 2) - 1.0)
        count, i = count + 1, i + 1
    return count


@kernel
def measure(keys, scans, scene, constants, wave, reference, limit, z, count):
    """Scan ``scans[e]`` of every environment e: z (env, pair, measurement, 2), count (env, pair).

    wave (env, pair, 2, 2), reference (env, pair): covariance at unit SNR, and SNR at 100 m, of each pair's waveform.
    """
    for e in range(len(keys)):
        for m in range(z.shape[1]):
            key = stream(stream(keys[e], scans[e]), m)
            found = measure_targets(key, scans[e], m, scene, constants, wave[e, m], reference[e, m], limit, z[e, m], 0)
            count[e, m] = measure_clutter(key, constants, limit, z[e, m], found)


@kernel
def observe(step, x, P, mu, existence, status, age, centre, horizon, out):
    """Write ``urban_fields`` of every environment to out, which holds zeros; positions relative to ``centre`` (2,)."""
    slots, models = mu.shape[1], mu.shape[2]
    mean, variance = np.empty(4), np.empty(4)
    for e in range(len(step)):
        out[e, 0] = 1.0 - step[e] / horizon
        for s in range(slots):
            if status[e, s] == EMPTY:
                continue
            for k in range(4):
                mean[k] = variance[k] = 0.0
                for j in range(models):
                    mean[k] += mu[e, s, j] * x[e, s, j, k]
                for j in range(models):
                    off = x[e, s, j, k] - mean[k]
                    variance[k] += mu[e, s, j] * (P[e, s, j, k, k] + off * off)
            first = 1 + s * (8 + models)
            out[e, first], out[e, first + 1] = existence[e, s], status[e, s] == CONFIRMED
            for k in range(4):
                out[e, first + 2 + k] = mean[k] - centre[k] if k < 2 else mean[k]
            out[e, first + 6] = np.sqrt(variance[0] + variance[1])
            out[e, first + 7] = np.sqrt(variance[2] + variance[3])
            for j in range(models):
                out[e, first + 8 + j] = mu[e, s, j]
