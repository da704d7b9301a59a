"""Kernels of the urban tracker: predicted tracks, predicted measurements, and likelihoods inside gates.

Arrays belong to one environment; ``Tracks`` and ``TrackerConstants`` are those of ``scan_kernels.py``. Rows of x and P
are ordered by track, then model, as in ``imm_kernels.py``.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import detection
from wavegym.sensors.multistatic_kernels import noise, snr_at
from wavegym.trackers.imm_kernels import log_density_one, mix_one, squared_length
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one
from wavegym.trackers.ukf_kernels import predict_multistatic_one

EMPTY, TENTATIVE, CONFIRMED = 0, 1, 2
NEAR, ELSEWHERE = 0, 1  # sets of models: near a junction, elsewhere
HIDDEN = 0.02  # Pd where the map says that the target is hidden: maps and estimates are not exact


@inlined
def cell_of(x, y, constants):
    """Column and row of the cell of (x, y); -1, -1 beyond the edge."""
    i, j = (
        int(np.floor((x - constants.corner[0]) / constants.cell)),
        int(np.floor((y - constants.corner[1]) / constants.cell)),
    )
    inside = 0 <= i < constants.road.shape[0] and 0 <= j < constants.road.shape[1]
    return (i, j) if inside else (-1, -1)


@inlined
def place_of(t, x, mu, models):
    """Mean (x, y, xdot, ydot) of a track over its models."""
    a = b = c = d = 0.0
    for j in range(models):
        row = t * models + j
        a, b = a + mu[t, j] * x[row, 0], b + mu[t, j] * x[row, 1]
        c, d = c + mu[t, j] * x[row, 2], d + mu[t, j] * x[row, 3]
    return a, b, c, d


@kernel
def predict_tracks(tracks, constants, X, PP, c, T, nn, mm):
    """Predict to the next scan: mix and move the models allowed at the position of each track; multiply by survival."""
    x, P, mu = tracks.x, tracks.P, tracks.mu
    for t in range(len(mu)):
        if tracks.status[t] == EMPTY:
            continue
        a, b, _, _ = place_of(t, x, mu, len(mm))
        i, j = cell_of(a, b, constants)
        place = NEAR if i >= 0 and constants.junction[i, j] else ELSEWHERE
        mix_one(t, x, P, mu, place, constants.transition, c, X, PP, nn, mm)
        for m in range(len(mm)):
            row = t * len(mm) + m
            predict_mean_one(row, X, constants.F, m, x, nn)
            predict_covariance_one(row, PP, constants.F, constants.Q, m, T, P, nn)
            mu[t, m] = c[t, m]
        tracks.existence[t] *= constants.survival


@kernel
def predict_measurements(tracks, constants, pair, wave, reference, centre, S, G, A, whole, pd, nn, mm):
    """Predicted measurement of each model: centre, S, G (row, ...); of each track: whole (t, 5) = z, S; pd = Pd Pg."""
    x, P, mu, tx, rx = tracks.x, tracks.P, tracks.mu, constants.transmitters[pair], constants.receivers[pair]
    for t in range(len(mu)):
        pd[t] = 0.0
        if tracks.status[t] == EMPTY:
            continue
        first = t * len(mm)
        r = rate = 0.0
        for m in range(len(mm)):
            row = first + m
            predict_multistatic_one(row, row, x, P, tx[0], tx[1], rx[0], rx[1], A, centre, S, G, nn)
            r, rate = r + mu[t, m] * centre[row, 0], rate + mu[t, m] * centre[row, 1]
        eta = snr_at(r, reference, 1.0)
        R00, R01, R11 = noise(wave, eta, constants.rate_floor)
        s00 = s01 = s11 = 0.0
        for m in range(len(mm)):
            row = first + m
            S[row, 0, 0] += R00
            S[row, 0, 1] += R01
            S[row, 1, 0] += R01
            S[row, 1, 1] += R11
            d0, d1 = centre[row, 0] - r, centre[row, 1] - rate
            s00 += mu[t, m] * (S[row, 0, 0] + d0 * d0)
            s01 += mu[t, m] * (S[row, 0, 1] + d0 * d1)
            s11 += mu[t, m] * (S[row, 1, 1] + d1 * d1)
        whole[t, 0], whole[t, 1], whole[t, 2], whole[t, 3], whole[t, 4] = r, rate, s00, s01, s11
        a, b, _, _ = place_of(t, x, mu, len(mm))
        i, j = cell_of(a, b, constants)
        lit = (
            i >= 0
            and constants.out_visible[pair, i, j, 0]
            and constants.back_visible[pair, i, j, 0]
            and r <= constants.reach
        )
        pd[t] = constants.gate_probability * (detection(0.5 * eta, constants.log_false_alarm) if lit else HIDDEN)


@kernel
def weigh_scan(tracks, constants, z, count, centre, S, whole, p, taken, mm):
    """p (track, model, measurement): likelihood of each model inside the track's gate; taken: z lies in any gate."""
    for t in range(len(tracks.mu)):
        for i in range(count):
            for m in range(len(mm)):
                p[t, m, i] = 0.0
        if tracks.status[t] == EMPTY:
            continue
        for i in range(count):
            d0, d1 = z[i, 0] - whole[t, 0], z[i, 1] - whole[t, 1]
            squared, _ = squared_length(d0, d1, whole[t, 2], whole[t, 3], whole[t, 4])
            if squared <= constants.gate:
                taken[i] = True
                for m in range(len(mm)):
                    row = t * len(mm) + m
                    density = log_density_one(row, z[i, 0] - centre[row, 0], z[i, 1] - centre[row, 1], S)
                    p[t, m, i] = np.exp(density) / constants.gate_probability
