"""Kernels of ``tracker.py``: one scan of all tracks, the expected effect of a scan, ghosts, and track management.

A ghost is a return of a track over walls, predicted with the map. A track starts where free measurements of the first
two receivers agree. A measurement is free if it lies in the gate of no track. Without direction of arrival, the track
starts where two range ellipses intersect (multilateration). With it, the track is the least-squares fit to both
measurements.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import detection_of
from wavegym.sensors.geometry_kernels import locate_one, snr_at
from wavegym.sensors.multipath_kernels import MOST_WALLS
from wavegym.systems.urban.tracker_kernels import (
    CONFIRMED,
    ELSEWHERE,
    EMPTY,
    NEAR,
    TENTATIVE,
    add_rate_floor,
    cell_of,
    covariance_at,
    factor_sum,
    linearise_path,
    log_density,
    place_of,
    predict_measurements,
    predict_tracks,
    predicted_for,
    project,
    scratch_for,
    shrink,
    slots_of,
    update_one,
    weigh_scan,
    whiten,
    whiten_gain,
)
from wavegym.trackers.association_kernels import lmipda_one
from wavegym.trackers.imm_kernels import combine_one
from wavegym.trackers.kernels import shrink_one
from wavegym.trackers.ukf_kernels import cholesky_columns_one

ROUNDS = 3  # Gauss-Newton steps of the fit of a new track


@kernel
def scan(x, P, mu, existence, status, age, constants, wave, reference, z, errors, count, refused, nn, mm, ll):
    """Update all tracks by one scan, in place: wave (env, pair, 2, 2), z (env, pair, measurement, m).

    errors (env, pair, measurement, m, m): covariances that the receivers report, without the floor of range-rate.
    refused (env,): number of new tracks that found no free slot.
    """
    slots, pairs, most = mu.shape[1], z.shape[1], z.shape[2]
    scratch, rows = scratch_for(slots, len(mm), len(nn), len(ll)), slots * len(mm)
    predicted = predicted_for(slots, len(mm), len(nn), len(ll))
    p, beta, R = np.empty((slots, len(mm), most)), np.empty((rows, most + 1)), np.empty((pairs, most, len(ll), len(ll)))
    density, own, claim = np.empty((slots, most)), np.empty((slots, most)), np.empty((slots, most))
    ghosts, claims, taken = np.empty(most), np.empty(most), np.empty((pairs, most), np.bool_)
    gated, ghosted = np.empty((pairs, most, slots), np.bool_), np.empty((pairs, most), np.bool_)
    for e in range(len(x)):
        tracks = slots_of(e, x, P, mu, existence, status, age)
        predict_tracks(tracks, constants, scratch.x, scratch.P, scratch.c, scratch.T, nn, mm)
        taken[:] = False
        for pair in range(pairs):
            number, own_wave, own_snr = count[e, pair], wave[e, pair], reference[e, pair]
            add_rate_floor(errors[e, pair], number, constants, R[pair], ll)
            predict_measurements(tracks, constants, pair, own_snr, predicted, scratch, nn, mm, ll)
            weigh_scan(tracks, constants, z[e, pair], R[pair], number, predicted, scratch, p, taken[pair], mm, ll)
            mark_gated(p, number, gated[pair])
            ghosts[:] = 0.0
            if constants.ghosts:
                claim_ghosts(
                    tracks, constants, pair, own_wave, own_snr, z[e, pair], number, ghosts, claims, scratch, nn, mm, ll
                )
            for i in range(number):
                taken[pair, i] |= ghosts[i] > constants.density
                ghosted[pair, i] = ghosts[i] > constants.density
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
        free_halves(gated, taken, ghosted, count[e], ll)
        refused[e] = initiate(tracks, constants, z[e], R, count[e], taken, scratch, mm, ll)


@kernel
def expect(x, P, mu, existence, status, age, constants, wave, reference, nn, mm, ll):
    """Apply the expected effect of a scan, in place: covariances shrink in proportion to the detection probability.

    Means, model probabilities and existence keep their predicted values.
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
    """Add to ghosts[i] the density of ghost returns at measurement i: paths of confirmed tracks over walls.

    A path counts as clutter around its predicted return, like another track in LMIPDA. Its detection probability
    includes the loss at its walls. The innovation covariance is linearised at the mean of the track. claims
    (measurement,) is scratch space.
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
    chance = detection_of(eta, 0, constants.echo)
    chance = constants.gate_probability * chance * existence
    for n in range(count):
        if claims[n] > 0.0:
            mine = chance * claims[n] / constants.density / total
            ghosts[n] += claims[n] * mine / (1.0 - mine)


@kernel
def end_ghosts(tracks, constants, wave, reference, scratch, nn, mm, ll):
    """Set the existence of a tentative track to 0 if it is a ghost of another track at all receivers.

    Existence probabilities alone react too slowly: if the target is found one scan after its ghost, both are about
    equally certain.
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
    """Whether the direct return of track s lies in the gate of a return of track t over walls."""
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
def mark_gated(p, count, gated):
    """Fill gated (measurement, track): whether p (track, model, measurement) is positive for any model."""
    for i in range(count):
        for t in range(p.shape[0]):
            gated[i, t] = False
            for m in range(p.shape[1]):
                gated[i, t] |= p[t, m, i] > 0.0


@kernel
def free_halves(gated, taken, ghosted, count, ll):
    """With directions, free returns of the first two pairs that only tracks with no return at the other pair hold.

    A track at a mirror image may hold the return of one receiver, and never that of the other. Then the target starts a
    track of its own, which takes both. gated (pair, measurement, track): whether the measurement is in the gate.
    ghosted (pair, measurement): whether it is the ghost of a track.
    """
    for pair in range(2 if len(ll) == 3 else 0):
        other = 1 - pair
        for i in range(count[pair]):
            held = ghosted[pair, i]
            for t in range(gated.shape[2]):
                for k in range(count[other] if gated[pair, i, t] else 0):
                    held |= gated[other, k, t]
            taken[pair, i] = held


@kernel
def initiate(tracks, constants, z, R, count, taken, scratch, mm, ll):
    """Start tracks where free measurements of the first two pairs agree on a visible road.

    z (pair, measurement, m), R (pair, measurement, m, m). Returns the number of tracks that found no free slot.
    """
    rx, refused = constants.receivers, 0
    apart = 0.5 * np.hypot(rx[0, 0] - rx[1, 0], rx[0, 1] - rx[1, 1])
    for a in range(count[0]):
        for b in range(count[1]):
            if taken[0, a] or taken[1, b] or abs(z[0, a, 0] - z[1, b, 0]) > apart + constants.slack:
                continue
            for k in range(2):
                if len(ll) == 3:
                    found = fit_start(k, z[0, a], z[1, b], R[0, a], R[1, b], constants, scratch, ll)
                else:
                    found = cross_start(k, z[0, a], z[1, b], R[0, a], R[1, b], constants, scratch)
                if found and np.hypot(scratch.start[0, 2], scratch.start[0, 3]) <= constants.fastest:
                    t = slot_for(tracks)
                    if t >= 0:
                        refused += tracks.status[t] != EMPTY
                        begin_track(t, scratch.start[0], scratch.start_spread[0], tracks, constants, mm)
                    else:
                        refused += 1
    return refused


@inlined
def cross_start(k, za, zb, Ra, Rb, constants, scratch):
    """Fill start and start_spread with crossing k (0, 1) of two range ellipses; whether a track may start there."""
    x, P, J = scratch.start, scratch.start_spread, scratch.J[0]
    tx, rx = constants.transmitters[0], constants.receivers
    locate_one(za, zb, Ra, Rb, tx[0], tx[1], rx[0, 0], rx[0, 1], rx[1, 0], rx[1, 1], 2.0 * k - 1.0, 0, x, P, J)
    if not may_start(x, P, constants):
        return False
    apply_velocity_prior(x, P, 0, constants.usual_speed * constants.usual_speed, J[0], (0, 0, 0, 0))
    return True


@inlined
def locate_by_direction(z, pair, side, constants):
    """The point of z's range ellipse in its direction of arrival, left (side 1) or right (-1) of the array's axis.

    With d the unit vector of arrival, s the receiver, t the transmitter, c = s - t: |c + rho d| = 2 r - rho.
    """
    tx, rx, axis = constants.transmitters[pair], constants.receivers[pair], constants.axes[pair]
    across = side * np.sqrt(max(1.0 - z[2] * z[2], 0.0))
    dx, dy = z[2] * axis[0] - across * axis[1], z[2] * axis[1] + across * axis[0]
    cx, cy = rx[0] - tx[0], rx[1] - tx[1]
    rho = 0.5 * (4.0 * z[0] * z[0] - cx * cx - cy * cy) / (2.0 * z[0] + cx * dx + cy * dy)
    return rx[0] + rho * dx, rx[1] + rho * dy, rho > 0.0


@kernel
def fit_start(k, za, zb, Ra, Rb, constants, scratch, ll):
    """Fill start, start_spread by least squares of two measurements and the prior velocity; whether a track may start.

    Gauss-Newton steps begin at a place left or right of an array (k = 0, 1). The array is that of the receiver whose
    direction of arrival is nearer to broadside. The other receiver tells the target from its mirror image. A fit whose
    residuals exceed their chi-square gate (6 measured quantities, 2 prior ones, 4 unknowns) starts no track.
    """
    x, P, J = scratch.start, scratch.start_spread, scratch.J
    x[0, 2] = x[0, 3] = 0.0
    if abs(za[2]) <= abs(zb[2]):
        x[0, 0], x[0, 1], ahead = locate_by_direction(za, 0, 1.0 - 2.0 * k, constants)
    else:
        x[0, 0], x[0, 1], ahead = locate_by_direction(zb, 1, 1.0 - 2.0 * k, constants)
    if not (ahead and near_road(x, constants.vaguest, constants)):
        return False
    misfit = 0.0
    for _ in range(ROUNDS):
        variance = constants.usual_speed * constants.usual_speed
        for i in range(4):
            scratch.shift[i] = -x[0, i] / variance if i >= 2 else 0.0
            for j in range(4):
                J[0, i, j] = 1.0 / variance if i == j and i >= 2 else 0.0
        misfit = (x[0, 2] * x[0, 2] + x[0, 3] * x[0, 3]) / variance
        misfit += add_information(za, Ra, 0, x, constants, scratch, ll)
        misfit += add_information(zb, Rb, 1, x, constants, scratch, ll)
        invert(J, P, scratch.A)
        for i in range(4):
            for j in range(4):
                x[0, i] += P[0, i, j] * scratch.shift[j]
    return misfit <= constants.start_gate and may_start(x, P, constants)


@inlined
def add_information(z, R, pair, x, constants, scratch, ll):
    """Add H' R^-1 H of one measurement to J[0] and H' R^-1 (z - h) to shift; returns the squared residual."""
    h, H, W, w, L = scratch.h, scratch.H, scratch.W, scratch.w, scratch.L
    linearise_path(x[0], constants.transmitters[pair], constants.receivers[pair], constants.axes[pair], h, H, ll)
    factor_sum(scratch.none, R, L, ll)
    squared = whiten(z, h, L, w, ll)
    for i in range(len(ll)):
        for j in range(4):
            total = H[i, j]
            for k in range(i):
                total -= L[i, k] * W[k, j]
            W[i, j] = total / L[i, i]
            scratch.shift[j] += W[i, j] * w[i]
    for j in range(4):
        for k in range(4):
            for i in range(len(ll)):
                scratch.J[0, j, k] += W[i, j] * W[i, k]
    return squared


@inlined
def invert(J, P, A):
    """Fill P[0] = J[0]^-1 for a positive definite J[0] (4, 4); NaN if J[0] is not positive definite."""
    cholesky_columns_one(0, 0, J, A, (0, 0, 0, 0), (0, 0, 0, 0))
    for k in range(4):  # A[0]^-1 in place of the columns of the upper triangle of A[1]
        for i in range(4):
            total = 1.0 if i == k else 0.0
            for j in range(k, i):
                total -= A[0, i, j] * A[1, j, k]
            A[1, i, k] = total / A[0, i, i] if i >= k else 0.0
    for i in range(4):
        for j in range(4):
            P[0, i, j] = 0.0
            for k in range(max(i, j), 4):
                P[0, i, j] += A[1, k, i] * A[1, k, j]


@inlined
def apply_velocity_prior(x, P, e, variance, v, nn):
    """Update x[e], P[e] with the prior of xdot and ydot: mean 0 and ``variance``; v (4,) is scratch space."""
    for k in range(2, 4):
        total, own = P[e, k, k] + variance, x[e, k]
        for i in range(4):
            v[i] = P[e, i, k]
            x[e, i] -= v[i] / total * own
        shrink_one(e, P, v, total, nn)


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
    """Start a tentative track: state (4,), covariance P (4, 4), acceleration 0 and equally likely allowed models."""
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
def near_road(x, distance, constants):
    """Whether x[0] is at most ``distance`` m from a road, on the map."""
    i, j = cell_of(x[0, 0], x[0, 1], constants) if np.isfinite(x[0, 0]) else (-1, -1)
    return i >= 0 and constants.road[i, j] <= distance


@inlined
def may_start(x, P, constants):
    """Whether x[0] is on a road, visible to all antennas, and its covariance is small enough."""
    if not near_road(x, 0.0, constants):
        return False
    i, j = cell_of(x[0, 0], x[0, 1], constants)
    visible = constants.back_visible[0, i, j, 0] and constants.back_visible[1, i, j, 0]
    known = P[0, 0, 0] + P[0, 1, 1] <= constants.vaguest * constants.vaguest
    return constants.out_visible[0, i, j, 0] and visible and known


@inlined
def end(t, tracks, mm):
    """End a track: empty its slot."""
    tracks.status[t] = EMPTY
    tracks.existence[t] = 0.0
    tracks.age[t] = 0
    for m in range(len(mm)):
        tracks.mu[t, m] = 1.0 / len(mm)


@inlined
def off_road(t, a, b, tracks, constants, mm):
    """Whether a track is farther from all roads than its own uncertainty explains.

    Such a track is a mirror image: when a target turns, its mirror image moves into a building.
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
    """Confirm, end and merge tracks. Of two tracks at one place the tentative one ends; of equal status the younger."""
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
