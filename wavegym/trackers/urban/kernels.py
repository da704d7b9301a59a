"""Tracks in a street, in compiled form: predicted, what they expect to be measured, and what fits that.

Arrays are those of one environment, ``Tracks`` and ``Street`` of ``street_scan_kernels.py``. Rows of x, P are track
after track, model after model, as in ``interacting_kernels.py``.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import detection
from wavegym.trackers.imm_kernels import log_density_one, mix_one, squared_length
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one
from wavegym.trackers.ukf_kernels import predict_multistatic_one

EMPTY, TENTATIVE, CONFIRMED = 0, 1, 2
NEAR, ELSEWHERE = 0, 1  # sets of models
REFERENCE_RANGE = 100.0  # m, where the waveforms' SNR is given
UNSEEN = 0.02  # Pd where the map says that the target is hidden: maps, and places, are not exact


@inlined
def cell_of(x, y, street):
    """Column and row of a place; -1, -1 beyond the edge."""
    i, j = int(np.floor((x - street.corner[0]) / street.cell)), int(np.floor((y - street.corner[1]) / street.cell))
    inside = 0 <= i < street.road.shape[0] and 0 <= j < street.road.shape[1]
    return (i, j) if inside else (-1, -1)


@inlined
def snr_at(r, reference, reflected):
    """eta at half path r [m] of a waveform that has ``reference`` at 100 m, after walls."""
    near = REFERENCE_RANGE / r
    return reference * reflected * (near * near) * (near * near)


@inlined
def noise(wave, eta, street):
    """(R00, R01, R11) of range and range-rate, the latter's variance held above its floor."""
    return wave[0, 0] / eta, wave[0, 1] / eta, wave[1, 1] / eta + street.rate_floor * street.rate_floor


@inlined
def place_of(t, x, mu, models):
    """(x, y, xdot, ydot) of a track, over its models."""
    a = b = c = d = 0.0
    for j in range(models):
        row = t * models + j
        a, b = a + mu[t, j] * x[row, 0], b + mu[t, j] * x[row, 1]
        c, d = c + mu[t, j] * x[row, 2], d + mu[t, j] * x[row, 3]
    return a, b, c, d


@kernel
def predict_tracks(tracks, street, X, PP, c, T, nn, mm):
    """To the next scan: the models possible where the track is are mixed and moved; existence survives or not."""
    x, P, mu = tracks.x, tracks.P, tracks.mu
    for t in range(len(mu)):
        if tracks.status[t] == EMPTY:
            continue
        a, b, _, _ = place_of(t, x, mu, len(mm))
        i, j = cell_of(a, b, street)
        place = NEAR if i >= 0 and street.junction[i, j] else ELSEWHERE
        mix_one(t, x, P, mu, place, street.transition, c, X, PP, nn, mm)
        for m in range(len(mm)):
            row = t * len(mm) + m
            predict_mean_one(row, X, street.F, m, x, nn)
            predict_covariance_one(row, PP, street.F, street.Q, m, T, P, nn)
            mu[t, m] = c[t, m]
        tracks.existence[t] *= street.survival


@kernel
def foresee_tracks(tracks, street, pair, wave, reference, centre, S, G, A, whole, pd, nn, mm):
    """Each model's predicted measurement centre, S, G (row, ...), each track's, whole (t, 5) = z, S, and pd = Pd Pg."""
    x, P, mu, tx, rx = tracks.x, tracks.P, tracks.mu, street.transmitters[pair], street.receivers[pair]
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
        R00, R01, R11 = noise(wave, eta, street)
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
        i, j = cell_of(a, b, street)
        lit = i >= 0 and street.out_seen[pair, i, j, 0] and street.back_seen[pair, i, j, 0] and r <= street.reach
        pd[t] = street.gate_probability * (detection(0.5 * eta, street.log_false_alarm) if lit else UNSEEN)


@kernel
def weigh_scan(tracks, street, z, count, centre, S, whole, p, taken, mm):
    """p (track, model, measurement): each model's likelihood inside the track's gate; taken where any gate holds z."""
    for t in range(len(tracks.mu)):
        for i in range(count):
            for m in range(len(mm)):
                p[t, m, i] = 0.0
        if tracks.status[t] == EMPTY:
            continue
        for i in range(count):
            d0, d1 = z[i, 0] - whole[t, 0], z[i, 1] - whole[t, 1]
            squared, _ = squared_length(d0, d1, whole[t, 2], whole[t, 3], whole[t, 4])
            if squared <= street.gate:
                taken[i] = True
                for m in range(len(mm)):
                    row = t * len(mm) + m
                    density = log_density_one(row, z[i, 0] - centre[row, 0], z[i, 1] - centre[row, 1], S)
                    p[t, m, i] = np.exp(density) / street.gate_probability
