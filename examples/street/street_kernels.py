"""Kernels of ``street.py``: vehicles of drawn routes, their measurements, and forecasts of tracks."""

from __future__ import annotations

import numpy as np

from wavegym.core.counter_rng_kernels import normal, stream
from wavegym.core.kernels import kernel
from wavegym.sensors.detection_kernels import detection_of, received_snr
from wavegym.sensors.geometry_kernels import (
    direction_cosine,
    direction_variance,
    folded,
    multistatic_range_and_rate,
    noise,
    snr_at,
)
from wavegym.systems.urban.kernels import DRIVERS, ERRORS, measure_clutter, report_one
from wavegym.systems.urban.tracker_kernels import (
    EMPTY,
    HIDDEN,
    cell_of,
    covariance_at,
    factor_sum,
    place_of,
    predict_measurements,
    predict_tracks,
    predicted_for,
    scratch_for,
    shrink,
    slots_of,
    whiten_gain,
)

SPACING = 0.6  # standard deviations between places of ``share_lit`` along the first axis


@kernel
def move(keys, scans, before, places, route, F, g, sigma, after):
    """after (env, vehicle, 6) in scan ``scans[e]``; places (scan, route, 6), route (env, vehicle).

    As ``wavegym.systems.urban.kernels.move_targets``, for vehicles that are there from scan 0 on.
    """
    for e in range(len(keys)):
        own, k = stream(stream(keys[e], scans[e]), DRIVERS), scans[e]
        for t in range(route.shape[1]):
            now, last = places[k, route[e, t]], places[k - 1, route[e, t]]
            for axis in range(2):
                p, v = before[e, t, axis] - last[axis], before[e, t, axis + 2] - last[axis + 2]
                push = sigma * normal(own, 2 * t + axis)
                after[e, t, axis] = now[axis] + F[0, 0] * p + F[0, 1] * v + g[0] * push
                after[e, t, axis + 2] = now[axis + 2] + F[1, 0] * p + F[1, 1] * v + g[1] * push
                after[e, t, axis + 4] = now[axis + 4] + push


@kernel
def measure(keys, scans, targets, route, lit, scene, law, wave, snr, z, R, count):
    """Fill z, R (env, pair, most, ...), count (env, pair): detections of vehicles in lit streets, and clutter.

    lit (env, vehicle) bool; snr (env,): 0 where nothing is sent; wave (env, 2, 2). As
    ``wavegym.systems.urban.kernels.measure_targets``.
    """
    most = scene.path_index.shape[3]
    for e in range(len(keys)):
        for m in range(z.shape[1] if snr[e] > 0.0 else 0):
            key, found = stream(stream(keys[e], scans[e]), m), 0
            for t in range(route.shape[1]):
                x, y, u, v = targets[e, t, 0], targets[e, t, 1], targets[e, t, 2], targets[e, t, 3]
                for w in range(scene.path_count[m, scans[e], route[e, t]] if lit[e, t] else 0):
                    tx, ty, sx, sy, ax, ay = scene.images[m, scene.path_index[m, scans[e], route[e, t], w]]
                    r, rate = multistatic_range_and_rate(x, y, u, v, tx, ty, sx, sy)
                    own = stream(key, t * most + w)
                    eta = snr_at(r, snr[e], scene.reflected[m, scans[e], route[e, t], w])
                    eta, errors = received_snr(eta, 0, own, law.echo), stream(own, ERRORS)
                    if eta > 0.0 and r < law.reach:
                        R00, R01, R11 = noise(wave[e], eta, law.rate_floor)
                        a, n0, n1 = np.sqrt(R00), normal(errors, 0), normal(errors, 1)
                        b = R01 / a
                        off = np.sqrt(direction_variance(eta, law.elements)) * normal(errors, 2)
                        z[e, m, found, 0] = r + a * n0
                        z[e, m, found, 1] = folded(rate + b * n0 + np.sqrt(R11 - b * b) * n1, law.limit)
                        z[e, m, found, 2] = folded(direction_cosine(x, y, sx, sy, ax, ay) + off, 1.0)
                        report_one(wave[e], eta, law, R[e, m, found])
                        found += 1
            count[e, m] = measure_clutter(key, law, wave[e], z[e, m], R[e, m], found)


@kernel
def share_lit(t, x, P, mu, pair, constants, models):
    """Share of the places within two standard deviations of a track that are visible, given the map and the beam."""
    a, b, _, _ = place_of(t, x, mu, models)
    u = v = w = 0.0
    for j in range(models):
        row = t * models + j
        dx, dy = x[row, 0] - a, x[row, 1] - b
        u += mu[t, j] * (P[row, 0, 0] + dx * dx)
        v += mu[t, j] * (P[row, 0, 1] + dx * dy)
        w += mu[t, j] * (P[row, 1, 1] + dy * dy)
    along = np.sqrt(u)
    aside, across = v / along, np.sqrt(max(w - v * v / u, 0.0))
    seen = 0
    for p in range(-3, 4):
        for q in range(-1, 2):
            i, j = cell_of(a + along * SPACING * p, b + aside * SPACING * p + across * q, constants)
            seen += i >= 0 and constants.out_visible[pair, i, j, 0] and constants.back_visible[pair, i, j, 0]
    return seen / 21.0


@kernel
def foresee(x, P, mu, existence, status, age, constants, wave, snr, draws, nn, mm, ll):
    """Predict the tracks a scan later, in place: expected for draws (env, 0), sampled for draws (env, pair * slot).

    As ``scan_kernels.expect``, but a track is visible with the probability ``share_lit``. A drawn detection shows that
    the track exists; a drawn miss lowers its existence by Bayes's rule.
    """
    scratch = scratch_for(mu.shape[1], len(mm), len(nn), len(ll))
    predicted = predicted_for(mu.shape[1], len(mm), len(nn), len(ll))
    for e in range(len(x)):
        tracks = slots_of(e, x, P, mu, existence, status, age)
        predict_tracks(tracks, constants, scratch.x, scratch.P, scratch.c, scratch.T, nn, mm)
        for pair in range(len(constants.receivers)):
            predict_measurements(tracks, constants, pair, snr, predicted, scratch, nn, mm, ll)
            for t in range(mu.shape[1]):
                if tracks.status[t] == EMPTY:
                    continue
                share = share_lit(t, tracks.x, tracks.P, tracks.mu, pair, constants, len(mm))
                chance = detection_of(predicted.eta[t], 0, constants.echo)
                pd = constants.gate_probability * (share * chance + (1.0 - share) * HIDDEN)
                if draws.shape[1] > 0:
                    r = tracks.existence[t]
                    found = draws[e, pair * mu.shape[1] + t] < r * pd
                    tracks.existence[t] = 1.0 if found else r * (1.0 - pd) / (1.0 - r * pd)
                    pd = 1.0 if found else 0.0
                for row in range(t * len(mm), (t + 1) * len(mm) if pd > 0.0 else 0):
                    covariance_at(predicted.eta[t], wave, constants.rate_floor, constants, scratch.R, ll)
                    factor_sum(predicted.S[row], scratch.R, scratch.L, ll)
                    whiten_gain(row, predicted.G, scratch.L, scratch.W, nn, ll)
                    shrink(row, tracks.P, scratch.W, pd, nn, ll)
