"""Kernels of ``tracker.py``: one scan of all tracks, the expected effect of a scan, and the ghosts of confirmed tracks.

A ghost is where the map predicts the returns of a track over walls.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import tabulated
from wavegym.sensors.geometry_kernels import snr_at
from wavegym.sensors.multipath_kernels import MOST_WALLS
from wavegym.systems.urban.track_management_kernels import initiate, update_status
from wavegym.systems.urban.tracker_kernels import (
    EMPTY,
    TENTATIVE,
    cell_of,
    covariance_at,
    factor_sum,
    linearise_path,
    log_density,
    predict_measurements,
    predict_tracks,
    shrink,
    update_one,
    weigh_scan,
    whiten,
    whiten_gain,
)
from wavegym.trackers.association_kernels import lmipda_one
from wavegym.trackers.imm_kernels import combine_one


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
