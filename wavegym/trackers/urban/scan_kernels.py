"""A scan of tracks in a street, in compiled form, and what may be expected of one; ``street.py`` is its public face."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.kernels import kernel
from wavegym.trackers.jpda_kernels import gain_one, shrink_one, update_one
from wavegym.trackers.lmipda_kernels import lmipda_one
from wavegym.trackers.urban.ghost_kernels import claim_ghosts
from wavegym.trackers.urban.kernels import EMPTY, foresee_tracks, predict_tracks, weigh_scan
from wavegym.trackers.urban.track_management_kernels import initiate, settle


class Street(NamedTuple):
    """What a tracker knows of a street and of targets; see ``street.StreetTracker`` for units and meaning."""

    transmitters: Any  # (pair, 2), of each pair of a transmitter and a receiver
    receivers: Any
    F: Any  # (model, 6, 6)
    Q: Any
    transition: Any  # (2, model, model): near junctions, elsewhere
    corner: Any  # (2,), of the grid
    cell: float
    road: Any  # (column, row): metres to the nearest road, 0 on one
    junction: Any  # (column, row)
    out_images: Any  # (pair, image, 2): the transmitter's, filled up with images that are seen from nowhere
    out_order: Any  # (pair, image)
    out_reflected: Any
    out_seen: Any  # (pair, column, row, image)
    back_images: Any  # and the receiver's
    back_order: Any
    back_reflected: Any
    back_seen: Any
    density: float
    gate: float  # squared
    gate_probability: float
    log_false_alarm: float
    rate_floor: float
    reach: float
    survival: float
    birth: float
    confirm: float
    confirm_after: int
    drop_tentative: float
    drop_confirmed: float
    merge_distance: float
    merge_speed: float
    slack: float
    vaguest: float
    fastest: float
    usual_speed: float
    first_acceleration: float
    ghosts: bool


class Tracks(NamedTuple):
    """The slots of one environment, as rows: x (slot * model, 6), P (slot * model, 6, 6), mu (slot, model), (slot,)."""

    x: Any
    P: Any
    mu: Any
    existence: Any
    status: Any
    age: Any


class Scratch(NamedTuple):
    """Room for one scan."""

    x: Any
    P: Any
    c: Any
    T: Any
    A: Any
    centre: Any
    S: Any
    G: Any
    K: Any
    whole: Any
    pd: Any


@kernel
def room_for(slots, models, n):
    """Scratch space; S and G are read before they are written where a slot is empty."""
    rows = slots * models
    return Scratch(
        np.empty((rows, n)), np.empty((rows, n, n)), np.empty((slots, models)), np.empty((n, n)),
        np.empty((rows, n, n)), np.zeros((rows, 2)), np.zeros((rows, 2, 2)), np.zeros((rows, n, 2)), np.empty((n, 2)),
        np.empty((slots, 5)), np.empty(slots),
    )  # fmt: skip


@kernel
def slots_of(e, x, P, mu, existence, status, age):
    """The tracks of environment e: views of arrays (env, slot, ...)."""
    rows, n = x.shape[1] * x.shape[2], x.shape[3]
    return Tracks(x[e].reshape(rows, n), P[e].reshape(rows, n, n), mu[e], existence[e], status[e], age[e])


@kernel
def scan(x, P, mu, existence, status, age, street, wave, reference, z, count, refused, nn, mm):
    """One scan in place, arrays with one leading axis: waves (env, pair, 2, 2), z (env, pair, measurement, 2).

    refused (env,): tracks that found no slot of their own.
    """
    slots, pairs, most = mu.shape[1], z.shape[1], z.shape[2]
    room, rows = room_for(slots, len(mm), len(nn)), slots * len(mm)
    p, beta = np.empty((slots, len(mm), most)), np.empty((rows, most + 1))
    density, own, claim = np.empty((slots, most)), np.empty((slots, most)), np.empty((slots, most))
    ghosts, claims, taken = np.empty(most), np.empty(most), np.empty((pairs, most), np.bool_)
    state, spread, J, R = np.empty((2, 4)), np.empty((2, 4, 4)), np.empty((4, 4)), np.empty((2, 2, 2))
    for e in range(len(x)):
        tracks = slots_of(e, x, P, mu, existence, status, age)
        predict_tracks(tracks, street, room.x, room.P, room.c, room.T, nn, mm)
        taken[:] = False
        for pair in range(pairs):
            seen, number = z[e, pair], count[e, pair]
            foresee_tracks(
                tracks, street, pair, wave[e, pair], reference[e, pair], room.centre, room.S, room.G, room.A,
                room.whole, room.pd, nn, mm,
            )  # fmt: skip
            weigh_scan(tracks, street, seen, number, room.centre, room.S, room.whole, p, taken[pair], mm)
            ghosts[:] = 0.0
            if street.ghosts:
                claim_ghosts(
                    tracks,
                    street,
                    pair,
                    wave[e, pair],
                    reference[e, pair],
                    seen,
                    number,
                    room.x,
                    room.P,
                    ghosts,
                    claims,
                    nn,
                    mm,
                )
            for i in range(number):
                taken[pair, i] |= ghosts[i] > street.density
                for t in range(slots):
                    density[t, i] = street.density + ghosts[i]
            lmipda_one(p, tracks.mu, room.pd, tracks.existence, density, number, beta, own, claim)
            for row in range(rows):
                if tracks.status[row // len(mm)] != EMPTY:
                    update_one(
                        row, tracks.x, tracks.P, seen, number, beta, row, room.centre, room.S, room.G, room.K, nn
                    )
        settle(tracks, street, mm)
        refused[e] = initiate(tracks, street, z[e], count[e], taken, wave[e], reference[e], state, spread, J, R, mm)


@kernel
def expect(x, P, mu, existence, status, age, street, wave, reference, nn, mm):
    """What a scan may be expected to leave, in place: covariances shrink by the share that detections are likely.

    An expected measurement moves no mean, makes no model likelier and no track surer to exist.
    """
    room = room_for(mu.shape[1], len(mm), len(nn))
    for e in range(len(x)):
        tracks = slots_of(e, x, P, mu, existence, status, age)
        predict_tracks(tracks, street, room.x, room.P, room.c, room.T, nn, mm)
        for pair in range(len(street.receivers)):
            foresee_tracks(
                tracks, street, pair, wave[e, pair], reference[e, pair], room.centre, room.S, room.G, room.A,
                room.whole, room.pd, nn, mm,
            )  # fmt: skip
            for row in range(mu.shape[1] * len(mm)):
                t = row // len(mm)
                if tracks.status[t] != EMPTY:
                    gain_one(row, room.G, room.S, room.K, nn)
                    s00, s01, s11 = room.S[row, 0, 0], room.S[row, 0, 1], room.S[row, 1, 1]
                    shrink_one(row, tracks.P, room.K, room.pd[t] * s00, room.pd[t] * s01, room.pd[t] * s11, nn)
