"""Kernels of the urban tracker: predicted tracks, predicted measurements, and likelihoods inside gates.

Arrays belong to one environment; ``Tracks`` and ``TrackerConstants`` are those of ``scan_kernels.py``. Rows of x and P
are ordered by track, then model, as in ``imm_kernels.py``.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import tabulated
from wavegym.sensors.multistatic_kernels import snr_at
from wavegym.trackers.imm_kernels import mix_one
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one
from wavegym.trackers.ukf_kernels import predict_direction_one, predict_multistatic_one
from wavegym.trackers.urban.update_kernels import factor_sum, log_density, whiten

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
def predict_measurements(tracks, constants, pair, reference, predicted, scratch, nn, mm, ll):
    """Predicted measurement of each model, and SNR and pd = Pd Pg of each track: fills ``predicted``."""
    x, P, mu, tx, rx = tracks.x, tracks.P, tracks.mu, constants.transmitters[pair], constants.receivers[pair]
    axis, centre, S, G = constants.axes[pair], predicted.centre, predicted.S, predicted.G
    for t in range(len(mu)):
        predicted.pd[t] = 0.0
        if tracks.status[t] == EMPTY:
            continue
        for m in range(len(mm)):
            row = t * len(mm) + m
            predict_multistatic_one(row, row, x, P, tx[0], tx[1], rx[0], rx[1], scratch.A, centre, S, G, nn)
            if len(ll) == 3:
                predict_direction_one(
                    row, row, x, P, tx[0], tx[1], rx[0], rx[1], axis[0], axis[1], scratch.A, centre, S, G, nn
                )
        r = 0.0
        for m in range(len(mm)):
            r += mu[t, m] * centre[t * len(mm) + m, 0]
        predicted.eta[t] = snr_at(r, reference, 1.0)
        a, b, _, _ = place_of(t, x, mu, len(mm))
        i, j = cell_of(a, b, constants)
        lit = (
            i >= 0
            and constants.out_visible[pair, i, j, 0]
            and constants.back_visible[pair, i, j, 0]
            and r <= constants.reach
        )
        chance = tabulated(predicted.eta[t], constants.log_false_alarm, constants.detection_table) if lit else HIDDEN
        predicted.pd[t] = constants.gate_probability * chance


@inlined
def near_in_range(t, z, R, predicted, constants, mm):
    """Whether the range of z alone lies in the gate of a model; where it does not, z lies in none: the quick test."""
    near = False
    for m in range(len(mm)):
        row = t * len(mm) + m
        d = z[0] - predicted.centre[row, 0]
        near |= d * d <= constants.gate * (predicted.S[row, 0, 0] + R[0, 0])
    return near


@kernel
def weigh_scan(tracks, constants, z, R, count, predicted, scratch, p, taken, mm, ll):
    """p (track, model, measurement): likelihood of each model inside the track's gate; taken: z lies in any gate.

    The gate of a track is the union of the gates of its models: at the start of a manoeuvre the model that explains it
    is still improbable, and a gate of the mixture would leave the measurement out.
    """
    L, w = scratch.L, scratch.w
    for t in range(len(tracks.mu)):
        for i in range(count):
            for m in range(len(mm)):
                p[t, m, i] = 0.0
        if tracks.status[t] == EMPTY:
            continue
        for i in range(count):
            inside = False
            for m in range(len(mm) if near_in_range(t, z[i], R[i], predicted, constants, mm) else 0):
                row = t * len(mm) + m
                log_determinant = factor_sum(predicted.S[row], R[i], L, ll)
                squared = whiten(z[i], predicted.centre[row], L, w, ll)
                p[t, m, i] = np.exp(log_density(squared, log_determinant, ll)) / constants.gate_probability
                inside |= squared <= constants.gate and tracks.mu[t, m] > 0.0
            taken[i] |= inside
            for m in range(0 if inside else len(mm)):
                p[t, m, i] = 0.0
