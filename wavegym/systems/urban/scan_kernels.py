"""Kernels of ``tracker.py``: one scan of all tracks, and the expected effect of a scan."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.kernels import kernel
from wavegym.sensors.geometry_kernels import snr_at
from wavegym.systems.urban.ghost_kernels import claim_ghosts, end_ghosts
from wavegym.systems.urban.track_management_kernels import initiate, update_status
from wavegym.systems.urban.tracker_kernels import (
    EMPTY,
    covariance_at,
    factor_sum,
    predict_measurements,
    predict_tracks,
    shrink,
    update_one,
    weigh_scan,
    whiten_gain,
)
from wavegym.trackers.lmipda_kernels import lmipda_one


class TrackerConstants(NamedTuple):
    """What the tracker assumes about map, antennas and targets; see ``UrbanTracker`` for units and meaning."""

    transmitters: Any  # (pair, 2), of each pair of a transmitter and a receiver
    receivers: Any
    axes: Any  # (pair, 2), unit vectors along the elements of each receiver
    elements: int
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
    back_axes: Any  # (pair, image, 2)
    density: float  # of false returns, per unit of all measured quantities
    gate: float  # squared
    start_gate: float  # squared, of a new track
    gate_probability: float
    log_false_alarm: float
    detection_table: Any  # of detection.detection_table
    effective_table: Any  # of detection.effective_snr_table; empty: covariances at the mean SNR
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


class Predicted(NamedTuple):
    """Predicted measurements of one pair, of each model (slot * model, ...), and detection of each track (slot,)."""

    centre: Any  # (slot * model, m)
    S: Any  # (slot * model, m, m), without measurement errors
    G: Any  # (slot * model, 6, m), covariance of state and measurement
    eta: Any  # (slot,): SNR
    pd: Any  # (slot,): Pd Pg


class Scratch(NamedTuple):
    """Scratch space for one scan; n = 6 states, m quantities of a measurement."""

    x: Any  # (slot * model, n)
    P: Any  # (slot * model, n, n)
    c: Any  # (slot, model)
    T: Any  # (n, n)
    A: Any  # (slot * model, n, n)
    R: Any  # (m, m)
    none: Any  # (m, m), zeros
    L: Any  # (m, m)
    spread: Any  # (m, m)
    w: Any  # (m,)
    W: Any  # (m, n)
    shift: Any  # (n,)
    total: Any  # (n,)
    h: Any  # (m,)
    H: Any  # (m, 4)
    start: Any  # (1, 4), of a new track
    start_spread: Any  # (1, 4, 4)
    J: Any  # (1, 4, 4)


@kernel
def predicted_for(slots, models, n, m):
    """Room for predicted measurements; 0 at first because empty slots read them unwritten."""
    rows = slots * models
    return Predicted(
        np.zeros((rows, m)), np.zeros((rows, m, m)), np.zeros((rows, n, m)), np.empty(slots), np.empty(slots),
    )  # fmt: skip


@kernel
def scratch_for(slots, models, n, m):
    """Scratch space; the fit of a new track needs two rows of A."""
    rows = max(slots * models, 2)
    return Scratch(
        np.empty((rows, n)), np.empty((rows, n, n)), np.empty((slots, models)), np.empty((n, n)),
        np.empty((rows, n, n)), np.empty((m, m)), np.zeros((m, m)), np.empty((m, m)), np.empty((m, m)),
        np.empty(m), np.empty((m, n)), np.empty(n), np.empty(n), np.empty(m), np.empty((m, 4)),
        np.empty((1, 4)), np.empty((1, 4, 4)), np.empty((1, 4, 4)),
    )  # fmt: skip


@kernel
def are_counts(count, most):
    """Whether all of count (env, pair) are integers from 0 to ``most``."""
    fine = True
    for number in count.flat:
        fine = fine and 0 <= number <= most and number == np.floor(number)
    return fine


@kernel
def are_waves(R, snr):
    """Whether all of R (env, pair, 2, 2) are positive definite and all of snr (env, pair) finite and positive."""
    fine = True
    for e in range(snr.shape[0]):
        for pair in range(snr.shape[1]):
            S = R[e, pair]
            fine = fine and S[0, 0] > 0.0 and S[0, 0] * S[1, 1] > S[0, 1] * S[1, 0] and 0.0 < snr[e, pair] < np.inf
    return fine


@kernel
def direct_errors(z, count, wave, reference, constants, errors, ll):
    """errors (env, pair, measurement, m, m): covariances at the SNR of a direct path of each measured range."""
    for e in range(len(z)):
        for pair in range(z.shape[1]):
            for i in range(count[e, pair]):
                eta = snr_at(z[e, pair, i, 0], reference[e, pair], 1.0)
                covariance_at(eta, wave[e, pair], 0.0, constants, errors[e, pair, i], ll)


@kernel
def add_rate_floor(given, count, constants, R, ll):
    """R (measurement, m, m): the covariance that the receiver gives, and the floor of range-rate."""
    for i in range(count):
        for j in range(len(ll)):
            for k in range(len(ll)):
                R[i, j, k] = given[i, j, k]
        R[i, 1, 1] += constants.rate_floor * constants.rate_floor


@kernel
def slots_of(e, x, P, mu, existence, status, age):
    """Tracks of environment e: views of arrays (env, slot, ...)."""
    rows, n = x.shape[1] * x.shape[2], x.shape[3]
    return Tracks(x[e].reshape(rows, n), P[e].reshape(rows, n, n), mu[e], existence[e], status[e], age[e])


@kernel
def scan(x, P, mu, existence, status, age, constants, wave, reference, z, errors, count, refused, nn, mm, ll):
    """One scan of all environments, in place: wave (env, pair, 2, 2), z (env, pair, measurement, m).

    errors (env, pair, measurement, m, m): covariances that the receivers give, without the floor of range-rate.
    refused (env,): tracks that found no free slot.
    """
    slots, pairs, most = mu.shape[1], z.shape[1], z.shape[2]
    scratch, rows = scratch_for(slots, len(mm), len(nn), len(ll)), slots * len(mm)
    predicted = predicted_for(slots, len(mm), len(nn), len(ll))
    p, beta, R = np.empty((slots, len(mm), most)), np.empty((rows, most + 1)), np.empty((pairs, most, len(ll), len(ll)))
    density, own, claim = np.empty((slots, most)), np.empty((slots, most)), np.empty((slots, most))
    ghosts, claims, taken = np.empty(most), np.empty(most), np.empty((pairs, most), np.bool_)
    for e in range(len(x)):
        tracks = slots_of(e, x, P, mu, existence, status, age)
        predict_tracks(tracks, constants, scratch.x, scratch.P, scratch.c, scratch.T, nn, mm)
        taken[:] = False
        for pair in range(pairs):
            number, own_wave, own_snr = count[e, pair], wave[e, pair], reference[e, pair]
            add_rate_floor(errors[e, pair], number, constants, R[pair], ll)
            predict_measurements(tracks, constants, pair, own_snr, predicted, scratch, nn, mm, ll)
            weigh_scan(tracks, constants, z[e, pair], R[pair], number, predicted, scratch, p, taken[pair], mm, ll)
            ghosts[:] = 0.0
            if constants.ghosts:
                claim_ghosts(
                    tracks, constants, pair, own_wave, own_snr, z[e, pair], number, ghosts, claims, scratch, nn, mm, ll
                )
            for i in range(number):
                taken[pair, i] |= ghosts[i] > constants.density
                for t in range(slots):
                    density[t, i] = constants.density + ghosts[i]
            lmipda_one(p, tracks.mu, predicted.pd, tracks.existence, density, number, beta, own, claim)
            for row in range(rows):
                if tracks.status[row // len(mm)] != EMPTY:
                    update_one(
                        row, tracks.x, tracks.P, z[e, pair], R[pair], number, beta, predicted.centre, predicted.S,
                        predicted.G, scratch, nn, ll,
                    )  # fmt: skip
        if constants.ghosts:
            end_ghosts(tracks, constants, wave[e], reference[e], scratch, nn, mm, ll)
        update_status(tracks, constants, mm)
        refused[e] = initiate(tracks, constants, z[e], R, count[e], taken, scratch, mm, ll)


@kernel
def expect(x, P, mu, existence, status, age, constants, wave, reference, nn, mm, ll):
    """Expected effect of a scan, in place: covariances shrink in proportion to the detection probability.

    Means, model probabilities and existence stay as predicted.
    """
    scratch = scratch_for(mu.shape[1], len(mm), len(nn), len(ll))
    predicted = predicted_for(mu.shape[1], len(mm), len(nn), len(ll))
    for e in range(len(x)):
        tracks = slots_of(e, x, P, mu, existence, status, age)
        predict_tracks(tracks, constants, scratch.x, scratch.P, scratch.c, scratch.T, nn, mm)
        for pair in range(len(constants.receivers)):
            predict_measurements(tracks, constants, pair, reference[e, pair], predicted, scratch, nn, mm, ll)
            for row in range(mu.shape[1] * len(mm)):
                t = row // len(mm)
                if tracks.status[t] != EMPTY:
                    eta, floor = predicted.eta[t], constants.rate_floor
                    covariance_at(eta, wave[e, pair], floor, constants, scratch.R, ll)
                    factor_sum(predicted.S[row], scratch.R, scratch.L, ll)
                    whiten_gain(row, predicted.G, scratch.L, scratch.W, nn, ll)
                    shrink(row, tracks.P, scratch.W, predicted.pd[t], nn, ll)
