"""Kernels for ghosts of confirmed tracks: where the map predicts their returns over walls."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import tabulated
from wavegym.sensors.geometry_kernels import range_and_rate, snr_at
from wavegym.sensors.multipath_kernels import MOST_WALLS
from wavegym.systems.urban.tracker_kernels import (
    EMPTY,
    TENTATIVE,
    cell_of,
    covariance_at,
    factor_sum,
    log_density,
    whiten,
)
from wavegym.trackers.imm_kernels import combine_one


@kernel
def claim_ghosts(tracks, constants, pair, wave, reference, z, count, ghosts, claims, scratch, nn, mm, ll):
    """ghosts[i] += density of ghost returns at measurement i: paths of confirmed tracks over walls.

    As another track does in LMIPDA, a path acts as clutter around its predicted return, with the detection probability
    that its walls leave. The innovation covariance is linearised at the mean of the track. claims (measurement,) is
    scratch space.
    """
    mean, P = scratch.x, scratch.P
    for t in range(len(tracks.mu)):
        if tracks.status[t] == EMPTY:
            continue
        combine_one(t, tracks.x, tracks.P, tracks.mu, mean, P, nn, mm)
        i, j = cell_of(mean[t, 0], mean[t, 1], constants)
        if i < 0:
            continue
        for a in range(len(constants.out_images[pair])):
            if not constants.out_visible[pair, i, j, a]:
                continue
            for b in range(len(constants.back_images[pair])):
                walls = constants.out_order[pair, a] + constants.back_order[pair, b]
                if 1 <= walls <= MOST_WALLS and constants.back_visible[pair, i, j, b]:
                    claim_path(
                        t, mean, P, pair, a, b, tracks.existence[t], constants, wave, reference, z, count, ghosts,
                        claims, scratch, ll,
                    )  # fmt: skip


@inlined
def claim_path(
    t, mean, P, pair, a, b, existence, constants, wave, reference, z, count, ghosts, claims, scratch, ll
):  # fmt: skip
    """``claim_ghosts`` for the path from image a of the transmitter to image b of the receiver."""
    reflected = constants.out_reflected[pair, a] * constants.back_reflected[pair, b]
    h, H, R, S, L = scratch.h, scratch.H, scratch.R, scratch.spread, scratch.L
    linearise_path(
        mean[t], constants.out_images[pair, a], constants.back_images[pair, b], constants.back_axes[pair, b], h, H, ll
    )
    if h[0] > constants.reach:
        return
    eta = snr_at(h[0], reference, reflected)
    covariance_at(eta, wave, constants.rate_floor, constants, R, ll)
    project(P[t], H, S, ll)
    log_determinant = factor_sum(S, R, L, ll)
    total = 0.0
    for n in range(count):
        squared = whiten(z[n], h, L, scratch.w, ll)
        near = np.exp(log_density(squared, log_determinant, ll)) / constants.gate_probability
        claims[n] = near if squared <= constants.gate else 0.0
        total += claims[n] / constants.density
    chance = tabulated(eta, constants.log_false_alarm, constants.detection_table)
    chance = constants.gate_probability * chance * existence
    for n in range(count):
        if claims[n] > 0.0:
            mine = chance * claims[n] / constants.density / total
            ghosts[n] += claims[n] * mine / (1.0 - mine)


@inlined
def project(P, H, S, ll):
    """S (m, m) = H P H', H (m, 4): the covariance of a predicted measurement without its errors."""
    for i in range(len(ll)):
        for j in range(i + 1):
            total = 0.0
            for k in range(4):
                for m in range(4):
                    total += H[i, k] * P[k, m] * H[j, m]
            S[i, j] = S[j, i] = total


@kernel
def end_ghosts(tracks, constants, wave, reference, scratch, nn, mm, ll):
    """Set the existence of each tentative track to 0 that all receivers would see as a ghost of another track.

    Existence probabilities alone are slow: a ghost whose target is found a scan later is as certain as its target.
    """
    for s in range(len(tracks.mu)):
        if tracks.status[s] == TENTATIVE:
            combine_one(s, tracks.x, tracks.P, tracks.mu, scratch.x, scratch.P, nn, mm)
            for t in range(len(tracks.mu)):
                if t != s and tracks.existence[t] > 0.0:
                    combine_one(t, tracks.x, tracks.P, tracks.mu, scratch.x, scratch.P, nn, mm)
                    seen = True
                    for pair in range(len(constants.receivers)):
                        seen = seen and is_ghost(s, t, pair, constants, wave[pair], reference[pair], scratch, ll)
                    if seen:
                        tracks.existence[s] = 0.0


@inlined
def is_ghost(s, t, pair, constants, wave, reference, scratch, ll):
    """Whether the direct return of track s lies within the gate of a return of track t over walls."""
    mean, P, h, H, L = scratch.x, scratch.P, scratch.h, scratch.H, scratch.L
    i, j = cell_of(mean[t, 0], mean[t, 1], constants)
    if i < 0:
        return False
    direct = scratch.total
    linearise_path(mean[s], constants.transmitters[pair], constants.receivers[pair], constants.axes[pair], h, H, ll)
    for k in range(len(ll)):
        direct[k] = h[k]
    project(P[s], H, scratch.spread, ll)
    covariance_at(snr_at(h[0], reference, 1.0), wave, constants.rate_floor, constants, scratch.R, ll)
    for k in range(len(ll)):
        for m in range(len(ll)):
            scratch.R[k, m] += scratch.spread[k, m]
    for a in range(len(constants.out_images[pair])):
        for b in range(len(constants.back_images[pair])):
            walls = constants.out_order[pair, a] + constants.back_order[pair, b]
            visible = constants.out_visible[pair, i, j, a] and constants.back_visible[pair, i, j, b]
            if visible and 1 <= walls <= MOST_WALLS:
                linearise_path(
                    mean[t], constants.out_images[pair, a], constants.back_images[pair, b],
                    constants.back_axes[pair, b], h, H, ll,
                )  # fmt: skip
                project(P[t], H, scratch.spread, ll)
                factor_sum(scratch.spread, scratch.R, L, ll)
                if whiten(direct, h, L, scratch.w, ll) <= constants.gate:
                    return True
    return False


@inlined
def linearise_path(state, out, back, axis, h, H, ll):
    """Measurement h (m,) of (x, y, xdot, ydot, ...) over the path between two images, and its Jacobian H (m, 4)."""
    x, y, u, v = state[0], state[1], state[2], state[3]
    r0, v0 = range_and_rate(x, y, u, v, out[0], out[1])
    r1, v1 = range_and_rate(x, y, u, v, back[0], back[1])
    a0, b0, a1, b1 = (x - out[0]) / r0, (y - out[1]) / r0, (x - back[0]) / r1, (y - back[1]) / r1
    h[0], h[1] = 0.5 * (r0 + r1), 0.5 * (v0 + v1)
    H[0, 0], H[0, 1], H[0, 2], H[0, 3] = 0.5 * (a0 + a1), 0.5 * (b0 + b1), 0.0, 0.0
    H[1, 0], H[1, 2] = 0.5 * ((u - v0 * a0) / r0 + (u - v1 * a1) / r1), H[0, 0]
    H[1, 1], H[1, 3] = 0.5 * ((v - v0 * b0) / r0 + (v - v1 * b1) / r1), H[0, 1]
    if len(ll) == 3:
        h[2] = axis[0] * a1 + axis[1] * b1
        H[2, 0], H[2, 1], H[2, 2], H[2, 3] = (axis[0] - h[2] * a1) / r1, (axis[1] - h[2] * b1) / r1, 0.0, 0.0
