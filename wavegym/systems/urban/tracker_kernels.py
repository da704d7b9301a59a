"""Kernels of the urban tracker: its arrays, predicted tracks and measurements, gates, and the update by measurements.

Arrays belong to one environment. Rows of x and P are ordered by track, then model, as in ``imm_kernels.py``. A
measurement is (range, range-rate), or (range, range-rate, direction cosine). ``ll`` has one zero for each quantity, so
that the compiler unrolls the loops. The direction cosine is ambiguous by multiples of 2.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import EchoLaw, detection_of, effective_snr
from wavegym.sensors.geometry_kernels import direction_variance, folded, noise, range_and_rate, snr_at
from wavegym.trackers.imm_kernels import mix_one
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one
from wavegym.trackers.ukf_kernels import predict_direction_one, predict_multistatic_one

EMPTY, TENTATIVE, CONFIRMED = 0, 1, 2
NEAR, ELSEWHERE = 0, 1  # sets of models: near a junction, elsewhere
HIDDEN = 0.02  # Pd of targets that the map hides: not 0, because maps and estimates are not exact
LOG_2PI = np.log(2.0 * np.pi)


class TrackerConstants(NamedTuple):
    """The tracker's constants of map, antennas and targets; see ``UrbanTracker`` for units and meaning."""

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
    out_images: Any  # (pair, image, 2): of the transmitter, padded with images that are not visible from anywhere
    out_order: Any  # (pair, image)
    out_reflected: Any
    out_visible: Any  # (pair, column, row, image)
    back_images: Any  # the same for the receiver
    back_order: Any
    back_reflected: Any
    back_visible: Any
    back_axes: Any  # (pair, image, 2)
    density: float  # of false returns, per unit of all measured quantities
    gate: float  # squared
    start_gate: float  # squared, of a new track
    gate_probability: float
    echo: EchoLaw
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
    """Predicted measurements of one pair, for each model (slot * model, ...), and detection of each track (slot,)."""

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
    """Room for predicted measurements, filled with 0 because empty slots read elements that nothing has written."""
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
def slots_of(e, x, P, mu, existence, status, age):
    """Tracks of environment e: views of arrays (env, slot, ...)."""
    rows, n = x.shape[1] * x.shape[2], x.shape[3]
    return Tracks(x[e].reshape(rows, n), P[e].reshape(rows, n, n), mu[e], existence[e], status[e], age[e])


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


@inlined
def covariance_at(eta, wave, rate_floor, constants, R, ll):
    """Error covariance R (m, m) of a detected echo with the mean SNR ``eta``.

    wave (2, 2): covariance of range and range-rate at unit SNR.
    """
    eta = effective_snr(eta, 0, constants.echo)
    R[0, 0], R[0, 1], R[1, 1] = noise(wave, eta, rate_floor)
    R[1, 0] = R[0, 1]
    if len(ll) == 3:
        R[0, 2] = R[2, 0] = R[1, 2] = R[2, 1] = 0.0
        R[2, 2] = direction_variance(eta, constants.elements)


@kernel
def direct_errors(z, count, wave, reference, constants, errors, ll):
    """Fill errors (env, pair, measurement, m, m): covariances at the SNR of a direct path of each measured range."""
    for e in range(len(z)):
        for pair in range(z.shape[1]):
            for i in range(count[e, pair]):
                eta = snr_at(z[e, pair, i, 0], reference[e, pair], 1.0)
                covariance_at(eta, wave[e, pair], 0.0, constants, errors[e, pair, i], ll)


@kernel
def add_rate_floor(given, count, constants, R, ll):
    """Fill R (measurement, m, m): the covariance that the receiver reports, plus the floor of range-rate."""
    for i in range(count):
        for j in range(len(ll)):
            for k in range(len(ll)):
                R[i, j, k] = given[i, j, k]
        R[i, 1, 1] += constants.rate_floor * constants.rate_floor


@inlined
def factor_sum(S, R, L, ll):
    """Fill the lower triangular L (m, m) with L L' = S + R; returns the log of the determinant of S + R."""
    determinant = 1.0
    for i in range(len(ll)):
        for j in range(i + 1):
            total = S[i, j] + R[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = np.sqrt(total) if i == j else total / L[j, j]
        determinant *= L[i, i] * L[i, i]
    return np.log(determinant)


@inlined
def whiten(z, centre, L, w, ll):
    """Fill w (m,) = L^-1 (z - centre); returns its squared length, the squared Mahalanobis distance."""
    squared = 0.0
    for i in range(len(ll)):
        total = z[i] - centre[i]
        if i == 2:
            total = folded(total, 1.0)
        for k in range(i):
            total -= L[i, k] * w[k]
        w[i] = total / L[i, i]
        squared += w[i] * w[i]
    return squared


@inlined
def log_density(squared, log_determinant, ll):
    """Log of the normal density at a squared Mahalanobis distance."""
    return -0.5 * (squared + log_determinant + len(ll) * LOG_2PI)


@inlined
def whiten_gain(row, G, L, W, nn, ll):
    """Fill W (m, n) = L^-1 G[row]': the gain is W' L^-1, and the covariance shrinks by W' W."""
    for j in range(len(nn)):
        for i in range(len(ll)):
            total = G[row, j, i]
            for k in range(i):
                total -= L[i, k] * W[k, j]
            W[i, j] = total / L[i, i]


@kernel
def shrink(row, P, W, share, nn, ll):
    """P[row] -= share W' W, exactly symmetric."""
    for j in range(len(nn)):
        for k in range(j + 1):
            total = 0.0
            for i in range(len(ll)):
                total += W[i, j] * W[i, k]
            P[row, j, k] -= share * total
            P[row, k, j] = P[row, j, k]


@kernel
def update_one(row, x, P, z, R, count, beta, centre, S, G, scratch, nn, ll):
    """Replace x[row], P[row] by the moments of a mixture: the updates by each measurement, and by none.

    beta[row] (1 + count): probabilities, column 0 = missed. Each measurement i has its own covariance R[i] and hence
    its own gain K_i. The covariance becomes
    P - sum beta_i K_i S_i K_i' + sum beta_i d_i d_i' - d d', d_i = K_i v_i, d = sum beta_i d_i.
    With equal R this is the update of probabilistic data association (Bar-Shalom and Fortmann 1988).
    """
    L, W, w, shift, total = scratch.L, scratch.W, scratch.w, scratch.shift, scratch.total
    n = len(nn)
    for j in range(n):
        total[j] = 0.0
    for i in range(count):
        b = beta[row, i + 1]
        if not b > 0.0:
            continue
        factor_sum(S[row], R[i], L, ll)
        whiten(z[i], centre[row], L, w, ll)
        whiten_gain(row, G, L, W, nn, ll)
        shrink(row, P, W, b, nn, ll)
        for j in range(n):
            shift[j] = 0.0
            for k in range(len(ll)):
                shift[j] += W[k, j] * w[k]
            total[j] += b * shift[j]
        for j in range(n):
            for k in range(j + 1):
                P[row, j, k] += b * shift[j] * shift[k]
                P[row, k, j] = P[row, j, k]
    for j in range(n):
        x[row, j] += total[j]
        for k in range(j + 1):
            P[row, j, k] -= total[j] * total[k]
            P[row, k, j] = P[row, j, k]


@inlined
def cell_of(x, y, constants):
    """Column and row of the cell of (x, y); (-1, -1) outside the grid."""
    i, j = (
        int(np.floor((x - constants.corner[0]) / constants.cell)),
        int(np.floor((y - constants.corner[1]) / constants.cell)),
    )
    inside = 0 <= i < constants.road.shape[0] and 0 <= j < constants.road.shape[1]
    return (i, j) if inside else (-1, -1)


@inlined
def place_of(t, x, mu, models):
    """Mean (x, y, xdot, ydot) of a track over its models."""
    a = b = c = d = 0.0
    for j in range(models):
        row = t * models + j
        a, b = a + mu[t, j] * x[row, 0], b + mu[t, j] * x[row, 1]
        c, d = c + mu[t, j] * x[row, 2], d + mu[t, j] * x[row, 3]
    return a, b, c, d


@kernel
def predict_tracks(tracks, constants, X, PP, c, T, nn, mm):
    """Predict to the next scan: mix and move the models allowed at each track's place; existence times survival."""
    x, P, mu = tracks.x, tracks.P, tracks.mu
    for t in range(len(mu)):
        if tracks.status[t] == EMPTY:
            continue
        a, b, _, _ = place_of(t, x, mu, len(mm))
        i, j = cell_of(a, b, constants)
        place = NEAR if i >= 0 and constants.junction[i, j] else ELSEWHERE
        mix_one(t, x, P, mu, place, constants.transition, c, X, PP, nn, mm)
        for m in range(len(mm)):
            row = t * len(mm) + m
            predict_mean_one(row, X, constants.F, m, x, nn)
            predict_covariance_one(row, PP, constants.F, constants.Q, m, T, P, nn)
            mu[t, m] = c[t, m]
        tracks.existence[t] *= constants.survival


@kernel
def predict_measurements(tracks, constants, pair, reference, predicted, scratch, nn, mm, ll):
    """Fill ``predicted``: the predicted measurement of each model, and the SNR and pd = Pd Pg of each track."""
    x, P, mu, tx, rx = tracks.x, tracks.P, tracks.mu, constants.transmitters[pair], constants.receivers[pair]
    axis, centre, S, G = constants.axes[pair], predicted.centre, predicted.S, predicted.G
    for t in range(len(mu)):
        predicted.pd[t] = 0.0
        if tracks.status[t] == EMPTY:
            continue
        for m in range(len(mm)):
            row = t * len(mm) + m
            predict_multistatic_one(row, row, x, P, tx[0], tx[1], rx[0], rx[1], scratch.A, centre, S, G, nn)
            if len(ll) == 3:
                predict_direction_one(
                    row, row, x, P, tx[0], tx[1], rx[0], rx[1], axis[0], axis[1], scratch.A, centre, S, G, nn
                )
        r = 0.0
        for m in range(len(mm)):
            r += mu[t, m] * centre[t * len(mm) + m, 0]
        predicted.eta[t] = snr_at(r, reference, 1.0)
        a, b, _, _ = place_of(t, x, mu, len(mm))
        i, j = cell_of(a, b, constants)
        lit = (
            i >= 0
            and constants.out_visible[pair, i, j, 0]
            and constants.back_visible[pair, i, j, 0]
            and r <= constants.reach
        )
        chance = detection_of(predicted.eta[t], 0, constants.echo) if lit else HIDDEN
        predicted.pd[t] = constants.gate_probability * chance


@inlined
def near_in_range(t, z, R, predicted, constants, mm):
    """Whether the range of z lies in the range gate of any model: a fast test. If not, z lies in no gate."""
    near = False
    for m in range(len(mm)):
        row = t * len(mm) + m
        d = z[0] - predicted.centre[row, 0]
        near |= d * d <= constants.gate * (predicted.S[row, 0, 0] + R[0, 0])
    return near


@kernel
def weigh_scan(tracks, constants, z, R, count, predicted, scratch, p, taken, mm, ll):
    """Fill p (track, model, measurement): each model's likelihood in the track's gate; taken: z lies in any gate.

    The gate of a track is the union of the gates of its models. At the start of a manoeuvre the right model is still
    improbable, so a gate of the mixture would exclude the measurement.
    """
    L, w = scratch.L, scratch.w
    for t in range(len(tracks.mu)):
        for i in range(count):
            for m in range(len(mm)):
                p[t, m, i] = 0.0
        if tracks.status[t] == EMPTY:
            continue
        for i in range(count):
            inside = False
            for m in range(len(mm) if near_in_range(t, z[i], R[i], predicted, constants, mm) else 0):
                row = t * len(mm) + m
                log_determinant = factor_sum(predicted.S[row], R[i], L, ll)
                squared = whiten(z[i], predicted.centre[row], L, w, ll)
                p[t, m, i] = np.exp(log_density(squared, log_determinant, ll)) / constants.gate_probability
                inside |= squared <= constants.gate and tracks.mu[t, m] > 0.0
            taken[i] |= inside
            for m in range(0 if inside else len(mm)):
                p[t, m, i] = 0.0


@inlined
def linearise_path(state, out, back, axis, h, H, ll):
    """Fill h (m,): (x, y, xdot, ydot, ...) measured over the path between two images; H (m, 4): its Jacobian."""
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


@inlined
def project(P, H, S, ll):
    """Fill S (m, m) = H P H', H (m, 4): the covariance of a predicted measurement without measurement errors."""
    for i in range(len(ll)):
        for j in range(i + 1):
            total = 0.0
            for k in range(4):
                for m in range(4):
                    total += H[i, k] * P[k, m] * H[j, m]
            S[i, j] = S[j, i] = total
