"""Where the ghosts of confirmed tracks are to be expected, in compiled form: their ways by walls, from the map."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import detection
from wavegym.sensors.geometry_kernels import multistatic_range_and_rate, range_and_rate
from wavegym.sensors.multipath_kernels import MOST_WALLS
from wavegym.trackers.imm_kernels import combine_one, squared_length
from wavegym.trackers.urban.kernels import CONFIRMED, cell_of, noise, snr_at


@kernel
def claim_ghosts(tracks, street, pair, wave, reference, z, count, mean, P, ghosts, claims, nn, mm):
    """ghosts[i] += how densely confirmed tracks' ways by walls are expected to fall on measurement i.

    A way is to other tracks what another track is in LMIPDA: clutter where its return is expected, with the detection
    probability that its walls leave. Its innovation covariance is linearised at the track's mean. mean (t, n), P (t, n,
    n) and claims (measurement,) are scratch space.
    """
    tx_images, rx_images = street.out_images[pair], street.back_images[pair]
    for t in range(len(tracks.mu)):
        if tracks.status[t] != CONFIRMED:
            continue
        combine_one(t, tracks.x, tracks.P, tracks.mu, mean, P, nn, mm)
        i, j = cell_of(mean[t, 0], mean[t, 1], street)
        if i < 0:
            continue
        for a in range(len(tx_images)):
            if not street.out_seen[pair, i, j, a]:
                continue
            for b in range(len(rx_images)):
                walls = street.out_order[pair, a] + street.back_order[pair, b]
                if 1 <= walls <= MOST_WALLS and street.back_seen[pair, i, j, b]:
                    reflected = street.out_reflected[pair, a] * street.back_reflected[pair, b]
                    claim_way(
                        t, mean, P, tx_images[a], rx_images[b], reflected, tracks.existence[t], street, wave, reference,
                        z, count, ghosts, claims,
                    )  # fmt: skip


@inlined
def claim_way(t, mean, P, out, back, reflected, existence, street, wave, reference, z, count, ghosts, claims):
    """``claim_ghosts`` for one way, between the images ``out`` and ``back``."""
    x, y, u, v = mean[t, 0], mean[t, 1], mean[t, 2], mean[t, 3]
    r, rate = multistatic_range_and_rate(x, y, u, v, out[0], out[1], back[0], back[1])
    if r > street.reach:
        return
    eta = snr_at(r, reference, reflected)
    h, g = way_gradient(x, y, u, v, out, back)
    s00, s01, s11 = noise(wave, eta, street)
    for k in range(4):
        for m in range(4):
            s00 += h[k] * P[t, k, m] * h[m]
            s01 += h[k] * P[t, k, m] * g[m]
            s11 += g[k] * P[t, k, m] * g[m]
    total = 0.0
    for n in range(count):
        d0, d1 = z[n, 0] - r, z[n, 1] - rate
        squared, determinant = squared_length(d0, d1, s00, s01, s11)
        near = np.exp(-0.5 * squared) / (2.0 * np.pi * np.sqrt(determinant) * street.gate_probability)
        claims[n] = near if squared <= street.gate else 0.0
        total += claims[n] / street.density
    chance = street.gate_probability * detection(0.5 * eta, street.log_false_alarm) * existence
    for n in range(count):
        if claims[n] > 0.0:
            mine = chance * claims[n] / street.density / total
            ghosts[n] += claims[n] * mine / (1.0 - mine)


@inlined
def way_gradient(x, y, u, v, out, back):
    """d r and d rdot by (x, y, xdot, ydot) of the way between two images: two tuples of four."""
    r0, v0 = range_and_rate(x, y, u, v, out[0], out[1])
    r1, v1 = range_and_rate(x, y, u, v, back[0], back[1])
    a0, b0, a1, b1 = (x - out[0]) / r0, (y - out[1]) / r0, (x - back[0]) / r1, (y - back[1]) / r1
    hx, hy = 0.5 * (a0 + a1), 0.5 * (b0 + b1)
    gx, gy = 0.5 * ((u - v0 * a0) / r0 + (u - v1 * a1) / r1), 0.5 * ((v - v0 * b0) / r0 + (v - v1 * b1) / r1)
    return (hx, hy, 0.0, 0.0), (gx, gy, hx, hy)
