"""Kernels of ``tracker.py``: one scan of all tracks, and the expected effect of a scan."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.kernels import kernel
from wavegym.trackers.jpda_kernels import gain_one, shrink_one, update_one
from wavegym.trackers.lmipda_kernels import lmipda_one
from wavegym.trackers.urban.ghost_kernels import claim_ghosts
from wavegym.trackers.urban.kernels import EMPTY, predict_measurements, predict_tracks, weigh_scan
from wavegym.trackers.urban.track_management_kernels import initiate, update_status


class TrackerConstants(NamedTuple):
    """What the tracker assumes about map, antennas and targets; see ``UrbanTracker`` for units and meaning."""

    transmitters: Any  # (pair, 2), of each pair of a transmitter and a receiver
    receivers: Any
    F: Any  # (model, 6, 6)
    Q: Any
    transition: Any  # (2, model, model): near junctions, elsewhere
    corner: Any  # (2,), south-western corner of the grid
    cell: float
    road: Any  # (column, row): distance to the nearest road, m
    junction: Any  # (column, row): whether the cell lies in a junction
    out_images: Any  # (pair, image, 2): of the transmitter, padded with images visible from nowhere
    out_order: Any  # (pair, image)
    out_reflected: Any
    out_visible: Any  # (pair, column, row, image)
    back_images: Any  # the same of the receiver
    back_order: Any
    back_reflected: Any
    back_visible: Any
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
    """Scratch space for one scan."""

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
def scratch_for(slots, models, n):
    """Scratch space; S and G start at 0 because empty slots read them unwritten."""
    rows = slots * models
    return Scratch(
        np.empty((rows, n)), np.empty((rows, n, n)), np.empty((slots, models)), np.empty((n, n)),
        np.empty((rows, n, n)), np.zeros((rows, 2)), np.zeros((rows, 2, 2)), np.zeros((rows, n, 2)), np.empty((n, 2)),
        np.empty((slots, 5)), np.empty(slots),
    )  # fmt: skip


@kernel
def slots_of(e, x, P, mu, existence, status, age):
    """Tracks of environment e: views of arrays (env, slot, ...)."""
    rows, n = x.shape[1] * x.shape[2], x.shape[3]
    return Tracks(x[e].reshape(rows, n), P[e].reshape(rows, n, n), mu[e], existence[e], status[e], age[e])


@kernel
def scan(x, P, mu, existence, status, age, constants, wave, reference, z, count, refused, nn, mm):
    """One scan of all environments, in place: wave (env, pair, 2, 2), z (env, pair, measurement, 2).

    refused (env,): tracks that found no free slot.
    """
    slots, pairs, most = mu.shape[1], z.shape[1], z.shape[2]
    scratch, rows = scratch_for(slots, len(mm), len(nn)), slots * len(mm)
    p, beta = np.empty((slots, len(mm), most)), np.empty((rows, most + 1))
    density, own, claim = np.empty((slots, most)), np.empty((slots, most)), np.empty((slots, most))
    ghosts, claims, taken = np.empty(most), np.empty(most), np.empty((pairs, most), np.bool_)
    state, spread, J, R = np.empty((2, 4)), np.empty((2, 4, 4)), np.empty((4, 4)), np.empty((2, 2, 2))
    for e in range(len(x)):
        tracks = slots_of(e, x, P, mu, existence, status, age)
        predict_tracks(tracks, constants, scratch.x, scratch.P, scratch.c, scratch.T, nn, mm)
        taken[:] = False
        for pair in range(pairs):
            measured, number = z[e, pair], count[e, pair]
            predict_measurements(
                tracks, constants, pair, wave[e, pair], reference[e, pair], scratch.centre, scratch.S, scratch.G,
                scratch.A, scratch.whole, scratch.pd, nn, mm,
            )  # fmt: skip
            weigh_scan(
                tracks, constants, measured, number, scratch.centre, scratch.S, scratch.whole, p, taken[pair], mm
            )
            ghosts[:] = 0.0
            if constants.ghosts:
                claim_ghosts(
                    tracks,
                    constants,
                    pair,
                    wave[e, pair],
                    reference[e, pair],
                    measured,
                    number,
                    scratch.x,
                    scratch.P,
                    ghosts,
                    claims,
                    nn,
                    mm,
                )
            for i in range(number):
                taken[pair, i] |= ghosts[i] > constants.density
                for t in range(slots):
                    density[t, i] = constants.density + ghosts[i]
            lmipda_one(p, tracks.mu, scratch.pd, tracks.existence, density, number, beta, own, claim)
            for row in range(rows):
                if tracks.status[row // len(mm)] != EMPTY:
                    update_one(
                        row,
                        tracks.x,
                        tracks.P,
                        measured,
                        number,
                        beta,
                        row,
                        scratch.centre,
                        scratch.S,
                        scratch.G,
                        scratch.K,
                        nn,
                    )
        update_status(tracks, constants, mm)
        refused[e] = initiate(tracks, constants, z[e], count[e], taken, wave[e], reference[e], state, spread, J, R, mm)


@kernel
def expect(x, P, mu, existence, status, age, constants, wave, reference, nn, mm):
    """Expected effect of a scan, in place: covariances shrink in proportion to the detection probability.

    Means, model probabilities and existence stay as predicted.
    """
    scratch = scratch_for(mu.shape[1], len(mm), len(nn))
    for e in range(len(x)):
        tracks = slots_of(e, x, P, mu, existence, status, age)
        predict_tracks(tracks, constants, scratch.x, scratch.P, scratch.c, scratch.T, nn, mm)
        for pair in range(len(constants.receivers)):
            predict_measurements(
                tracks, constants, pair, wave[e, pair], reference[e, pair], scratch.centre, scratch.S, scratch.G,
                scratch.A, scratch.whole, scratch.pd, nn, mm,
            )  # fmt: skip
            for row in range(mu.shape[1] * len(mm)):
                t = row // len(mm)
                if tracks.status[t] != EMPTY:
                    gain_one(row, scratch.G, scratch.S, scratch.K, nn)
                    s00, s01, s11 = scratch.S[row, 0, 0], scratch.S[row, 0, 1], scratch.S[row, 1, 1]
                    shrink_one(
                        row, tracks.P, scratch.K, scratch.pd[t] * s00, scratch.pd[t] * s01, scratch.pd[t] * s11, nn
                    )
