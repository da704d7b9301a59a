"""Kernels of track management: tracks are initiated where two receivers agree, confirmed, merged and ended."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.multistatic_kernels import noise, snr_at
from wavegym.trackers.multilateration_kernels import locate_one
from wavegym.trackers.rank_one_kernels import shrink_one
from wavegym.trackers.urban.kernels import (
    CONFIRMED,
    ELSEWHERE,
    EMPTY,
    NEAR,
    TENTATIVE,
    cell_of,
    place_of,
)


@inlined
def end(t, tracks, mm):
    """Empty a slot."""
    tracks.status[t] = EMPTY
    tracks.existence[t] = 0.0
    tracks.age[t] = 0
    for m in range(len(mm)):
        tracks.mu[t, m] = 1.0 / len(mm)


@inlined
def off_road(t, a, b, tracks, constants, mm):
    """Whether a track is farther from all roads than its own uncertainty explains.

    The mirror image of a target moves into a building when the target turns.
    """
    i, j = cell_of(a, b, constants)
    if i < 0:
        return True
    variance = 0.0
    for m in range(len(mm)):
        row = t * len(mm) + m
        variance += tracks.mu[t, m] * (tracks.P[row, 0, 0] + tracks.P[row, 1, 1])
    return constants.road[i, j] > constants.slack + 2.0 * np.sqrt(variance)


@kernel
def update_status(tracks, constants, mm):
    """Confirm, end and merge tracks: of two at one place the tentative one ends, of equal status the younger one."""
    for t in range(len(tracks.mu)):
        if tracks.status[t] == EMPTY:
            continue
        least = constants.drop_tentative if tracks.status[t] == TENTATIVE else constants.drop_confirmed
        a, b, u, v = place_of(t, tracks.x, tracks.mu, len(mm))
        if (
            not tracks.existence[t] >= least
            or off_road(t, a, b, tracks, constants, mm)
            or not np.hypot(u, v) < 2.0 * constants.fastest
        ):
            end(t, tracks, mm)
        elif tracks.existence[t] >= constants.confirm and tracks.age[t] + 1 >= constants.confirm_after:
            tracks.status[t] = CONFIRMED
        tracks.age[t] += tracks.status[t] != EMPTY
    for t in range(len(tracks.mu)):
        for s in range(t):
            if tracks.status[t] != EMPTY and tracks.status[s] != EMPTY:
                a, b, u, v = place_of(t, tracks.x, tracks.mu, len(mm))
                c, d, p, q = place_of(s, tracks.x, tracks.mu, len(mm))
                apart, faster = np.hypot(a - c, b - d), np.hypot(u - p, v - q)
                if apart < constants.merge_distance and faster < constants.merge_speed:
                    older = tracks.status[s] > tracks.status[t] or (
                        tracks.status[s] == tracks.status[t] and tracks.age[s] >= tracks.age[t]
                    )
                    end(t if older else s, tracks, mm)


@inlined
def slot_for(tracks):
    """An empty slot, or the slot of the tentative track of least existence; -1 if all tracks are confirmed."""
    weakest = -1
    for t in range(len(tracks.mu)):
        if tracks.status[t] == EMPTY:
            return t
        if tracks.status[t] == TENTATIVE and (weakest < 0 or tracks.existence[t] < tracks.existence[weakest]):
            weakest = t
    return weakest


@inlined
def begin_track(t, state, P, tracks, constants, mm):
    """Start a tentative track at state (4,), covariance P (4, 4), acceleration 0 and equally likely allowed models."""
    i, j = cell_of(state[0], state[1], constants)
    place = NEAR if constants.junction[i, j] else ELSEWHERE
    possible = 0
    for m in range(len(mm)):
        entered = 0.0
        for k in range(len(mm)):
            entered += constants.transition[place, k, m]
        tracks.mu[t, m] = 1.0 if entered > 0.0 else 0.0
        possible += entered > 0.0
    for m in range(len(mm)):
        row = t * len(mm) + m
        tracks.mu[t, m] /= possible
        for k in range(6):
            tracks.x[row, k] = state[k] if k < 4 else 0.0
            for n in range(6):
                tracks.P[row, k, n] = P[k, n] if k < 4 and n < 4 else 0.0
            if k >= 4:
                tracks.P[row, k, k] = constants.first_acceleration * constants.first_acceleration
    tracks.status[t], tracks.existence[t], tracks.age[t] = TENTATIVE, constants.birth, 0


@inlined
def apply_velocity_prior(x, P, e, variance, v, nn):
    """Update x[e], P[e] with the prior that xdot and ydot have mean 0 and ``variance``; v (4,) is scratch space."""
    for k in range(2, 4):
        total, own = P[e, k, k] + variance, x[e, k]
        for i in range(4):
            v[i] = P[e, i, k]
            x[e, i] -= v[i] / total * own
        shrink_one(e, P, v, total, nn)


@kernel
def initiate(tracks, constants, z, count, taken, wave, reference, x, P, J, R, mm):
    """Start tracks where free measurements of the first two pairs intersect on a visible road.

    Returns the number of tracks that found no free slot. x (2, 4), P (2, 4, 4), J (4, 4), R (2, 2, 2): scratch space.
    """
    tx, rx, refused = constants.transmitters[0], constants.receivers, 0
    apart = 0.5 * np.hypot(rx[0, 0] - rx[1, 0], rx[0, 1] - rx[1, 1])
    for a in range(count[0]):
        for b in range(count[1]):
            if taken[0, a] or taken[1, b] or abs(z[0, a, 0] - z[1, b, 0]) > apart + constants.slack:
                continue
            for m in range(2):
                r = z[0, a, 0] if m == 0 else z[1, b, 0]
                R[m, 0, 0], R[m, 0, 1], R[m, 1, 1] = noise(wave[0], snr_at(r, reference[0], 1.0), constants.rate_floor)
                R[m, 1, 0] = R[m, 0, 1]
            for k in range(2):
                locate_one(
                    z[0, a], z[1, b], R[0], R[1], tx[0], tx[1], rx[0, 0], rx[0, 1], rx[1, 0], rx[1, 1],
                    2.0 * k - 1.0, k, x, P, J,
                )  # fmt: skip
                if may_start(k, x, P, constants):
                    apply_velocity_prior(x, P, k, constants.usual_speed * constants.usual_speed, J[0], (0, 0, 0, 0))
                    if np.hypot(x[k, 2], x[k, 3]) <= constants.fastest:
                        t = slot_for(tracks)
                        if t >= 0:
                            refused += tracks.status[t] != EMPTY
                            begin_track(t, x[k], P[k], tracks, constants, mm)
                        else:
                            refused += 1
    return refused


@inlined
def may_start(k, x, P, constants):
    """Whether x[k] is on a road visible to all antennas, and known well enough."""
    i, j = cell_of(x[k, 0], x[k, 1], constants) if np.isfinite(x[k, 0]) else (-1, -1)
    if i < 0 or constants.road[i, j] > 0.0 or not constants.out_visible[0, i, j, 0]:
        return False
    visible = constants.back_visible[0, i, j, 0] and constants.back_visible[1, i, j, 0]
    return visible and P[k, 0, 0] + P[k, 1, 1] <= constants.vaguest * constants.vaguest
