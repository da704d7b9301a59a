"""The life of tracks in a street, in compiled form: begun where two receivers agree, confirmed, merged and ended."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.trackers.multilateration_kernels import locate_one
from wavegym.trackers.rank_one_kernels import shrink_one
from wavegym.trackers.urban.kernels import (
    CONFIRMED,
    ELSEWHERE,
    EMPTY,
    NEAR,
    TENTATIVE,
    cell_of,
    noise,
    place_of,
    snr_at,
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
def astray(t, a, b, tracks, street, mm):
    """Whether a track is off the roads, by more than its own error may explain.

    What is a mirror image of the target wanders into a building when the target turns.
    """
    i, j = cell_of(a, b, street)
    if i < 0:
        return True
    variance = 0.0
    for m in range(len(mm)):
        row = t * len(mm) + m
        variance += tracks.mu[t, m] * (tracks.P[row, 0, 0] + tracks.P[row, 1, 1])
    return street.road[i, j] > street.slack + 2.0 * np.sqrt(variance)


@kernel
def settle(tracks, street, mm):
    """Confirm, end and merge: of two tracks in one place a tentative one, or of two alike the younger, gives way."""
    for t in range(len(tracks.mu)):
        if tracks.status[t] == EMPTY:
            continue
        least = street.drop_tentative if tracks.status[t] == TENTATIVE else street.drop_confirmed
        a, b, u, v = place_of(t, tracks.x, tracks.mu, len(mm))
        if (
            not tracks.existence[t] >= least
            or astray(t, a, b, tracks, street, mm)
            or not np.hypot(u, v) < 2.0 * street.fastest
        ):
            end(t, tracks, mm)
        elif tracks.existence[t] >= street.confirm and tracks.age[t] + 1 >= street.confirm_after:
            tracks.status[t] = CONFIRMED
        tracks.age[t] += tracks.status[t] != EMPTY
    for t in range(len(tracks.mu)):
        for s in range(t):
            if tracks.status[t] != EMPTY and tracks.status[s] != EMPTY:
                a, b, u, v = place_of(t, tracks.x, tracks.mu, len(mm))
                c, d, p, q = place_of(s, tracks.x, tracks.mu, len(mm))
                apart, faster = np.hypot(a - c, b - d), np.hypot(u - p, v - q)
                if apart < street.merge_distance and faster < street.merge_speed:
                    older = tracks.status[s] > tracks.status[t] or (
                        tracks.status[s] == tracks.status[t] and tracks.age[s] >= tracks.age[t]
                    )
                    end(t if older else s, tracks, mm)


@inlined
def slot_for(tracks):
    """An empty slot, or that of the tentative track least sure to exist; -1 where all are confirmed."""
    weakest = -1
    for t in range(len(tracks.mu)):
        if tracks.status[t] == EMPTY:
            return t
        if tracks.status[t] == TENTATIVE and (weakest < 0 or tracks.existence[t] < tracks.existence[weakest]):
            weakest = t
    return weakest


@inlined
def begin_track(t, state, P, tracks, street, mm):
    """A tentative track at state (4,) with covariance P (4, 4), at rest in acceleration, its possible models alike."""
    i, j = cell_of(state[0], state[1], street)
    place = NEAR if street.junction[i, j] else ELSEWHERE
    possible = 0
    for m in range(len(mm)):
        entered = 0.0
        for k in range(len(mm)):
            entered += street.transition[place, k, m]
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
                tracks.P[row, k, k] = street.first_acceleration * street.first_acceleration
    tracks.status[t], tracks.existence[t], tracks.age[t] = TENTATIVE, street.birth, 0


@inlined
def moderate(x, P, e, variance, v, nn):
    """x[e], P[e] after the prior knowledge that xdot and ydot are 0 give or take ``variance``; v (4,) is scratch."""
    for k in range(2, 4):
        total, own = P[e, k, k] + variance, x[e, k]
        for i in range(4):
            v[i] = P[e, i, k]
            x[e, i] -= v[i] / total * own
        shrink_one(e, P, v, total, nn)


@kernel
def initiate(tracks, street, z, count, taken, wave, reference, x, P, J, R, mm):
    """Begin tracks where measurements of the first two pairs, not taken, meet on a road in view.

    Returns how many tracks found no slot of their own. x (2, 4), P (2, 4, 4), J (4, 4), R (2, 2, 2): scratch space.
    """
    tx, rx, refused = street.transmitters[0], street.receivers, 0
    apart = 0.5 * np.hypot(rx[0, 0] - rx[1, 0], rx[0, 1] - rx[1, 1])
    for a in range(count[0]):
        for b in range(count[1]):
            if taken[0, a] or taken[1, b] or abs(z[0, a, 0] - z[1, b, 0]) > apart + street.slack:
                continue
            for m in range(2):
                r = z[0, a, 0] if m == 0 else z[1, b, 0]
                R[m, 0, 0], R[m, 0, 1], R[m, 1, 1] = noise(wave[0], snr_at(r, reference[0], 1.0), street)
                R[m, 1, 0] = R[m, 0, 1]
            for k in range(2):
                locate_one(
                    z[0, a], z[1, b], R[0], R[1], tx[0], tx[1], rx[0, 0], rx[0, 1], rx[1, 0], rx[1, 1],
                    2.0 * k - 1.0, k, x, P, J,
                )  # fmt: skip
                if may_begin(k, x, P, street):
                    moderate(x, P, k, street.usual_speed * street.usual_speed, J[0], (0, 0, 0, 0))
                    if np.hypot(x[k, 2], x[k, 3]) <= street.fastest:
                        t = slot_for(tracks)
                        if t >= 0:
                            refused += tracks.status[t] != EMPTY
                            begin_track(t, x[k], P[k], tracks, street, mm)
                        else:
                            refused += 1
    return refused


@inlined
def may_begin(k, x, P, street):
    """Whether x[k] is a place on a road that all antennas see, known well enough."""
    i, j = cell_of(x[k, 0], x[k, 1], street) if np.isfinite(x[k, 0]) else (-1, -1)
    if i < 0 or street.road[i, j] > 0.0 or not street.out_seen[0, i, j, 0]:
        return False
    seen = street.back_seen[0, i, j, 0] and street.back_seen[1, i, j, 0]
    return seen and P[k, 0, 0] + P[k, 1, 1] <= street.vaguest * street.vaguest
