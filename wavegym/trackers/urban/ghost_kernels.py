"""Kernels for ghosts of confirmed tracks: where the map predicts their returns over walls."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import detection
from wavegym.sensors.geometry_kernels import multistatic_range_and_rate, range_and_rate
from wavegym.sensors.multipath_kernels import MOST_WALLS
from wavegym.sensors.multistatic_kernels import noise, snr_at
from wavegym.trackers.imm_kernels import combine_one, squared_length
from wavegym.trackers.urban.kernels import CONFIRMED, cell_of


@kernel
def claim_ghosts(tracks, constants, pair, wave, reference, z, count, mean, P, ghosts, claims, nn, mm):
    """ghosts[i] += density of ghost returns at measurement i: paths of confirmed tracks over walls.

    As another track does in LMIPDA, a path acts as clutter around its predicted return, with the detection probability
    that its walls leave. The innovation covariance is linearised at the mean of the track. mean (t, n), P (t, n, n) and
    claims (measurement,) are scratch space.
    """
    tx_images, rx_images = constants.out_images[pair], constants.back_images[pair]
    for t in range(len(tracks.mu)):
        if tracks.status[t] != CONFIRMED:
            continue
        combine_one(t, tracks.x, tracks.P, tracks.mu, mean, P, nn, mm)
        i, j = cell_of(mean[t, 0], mean[t, 1], constants)
        if i < 0:
            continue
        for a in range(len(tx_images)):
            if not constants.out_visible[pair, i, j, a]:
                continue
            for b in range(len(rx_images)):
                walls = constants.out_order[pair, a] + constants.back_order[pair, b]
                if 1 <= walls <= MOST_WALLS and constants.back_visible[pair, i, j, b]:
                    reflected = constants.out_reflected[pair, a] * constants.back_reflected[pair, b]
                    claim_path(
                        t, mean, P, tx_images[a], rx_images[b], reflected, tracks.existence[t], constants, wave,
                        reference, z, count, ghosts, claims,
                    )  # fmt: skip


@inlined
def claim_path(t, mean, P, out, back, reflected, existence, constants, wave, reference, z, count, ghosts, claims):
    """``claim_ghosts`` for one path, between the images ``out`` and ``back``."""
    x, y, u, v = mean[t, 0], mean[t, 1], mean[t, 2], mean[t, 3]
    r, rate = multistatic_range_and_rate(x, y, u, v, out[0], out[1], back[0], back[1])
    if r > constants.reach:
        return
    eta = snr_at(r, reference, reflected)
    h, g = path_gradient(x, y, u, v, out, back)
    s00, s01, s11 = noise(wave, eta, constants.rate_floor)
    for k in range(4):
        for m in range(4):
            s00 += h[k] * P[t, k, m] * h[m]
            s01 += h[k] * P[t, k, m] * g[m]
            s11 += g[k] * P[t, k, m] * g[m]
    total = 0.0
    for n in range(count):
        d0, d1 = z[n, 0] - r, z[n, 1] - rate
        squared, determinant = squared_length(d0, d1, s00, s01, s11)
        near = np.exp(-0.5 * squared) / (2.0 * np.pi * np.sqrt(determinant) * constants.gate_probability)
        claims[n] = near if squared <= constants.gate else 0.0
        total += claims[n] / constants.density
    chance = constants.gate_probability * detection(0.5 * eta, constants.log_false_alarm) * existence
    for n in range(count):
        if claims[n] > 0.0:
            mine = chance * claims[n] / constants.density / total
            ghosts[n] += claims[n] * mine / (1.0 - mine)


@inlined
def path_gradient(x, y, u, v, out, back):
    """Gradients of r and rdot by (x, y, xdot, ydot) for the path between two images: two tuples of four."""
    r0, v0 = range_and_rate(x, y, u, v, out[0], out[1])
    r1, v1 = range_and_rate(x, y, u, v, back[0], back[1])
    a0, b0, a1, b1 = (x - out[0]) / r0, (y - out[1]) / r0, (x - back[0]) / r1, (y - back[1]) / r1
    hx, hy = 0.5 * (a0 + a1), 0.5 * (b0 + b1)
    gx, gy = 0.5 * ((u - v0 * a0) / r0 + (u - v1 * a1) / r1), 0.5 * ((v - v0 * b0) / r0 + (v - v1 * b1) / r1)
    return (hx, hy, 0.0, 0.0), (gx, gy, hx, hy)
