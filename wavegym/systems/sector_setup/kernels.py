"""Kernels of the closed loop of one illuminator and its receivers: move, set up, measure, track.

Shapes: e environments, t targets, j receivers, a = 2 j measured quantities, (range, range-rate) receiver by receiver, n
= 4 states [x xdot y ydot]. ``visible`` (e, k, t): whether a target is visible in step k; no target is visible after the
last step. Visibility is either known in advance or predicted with the map (``visibility_kernels.py``); the tracker
reads ``visible`` only if it is known. Arrays are separate arguments, because Numba takes microseconds to unpack each
field of a NamedTuple.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wavegym.core.array_kernels import copy_matrix
from wavegym.core.counter_rng_kernels import stream
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import EchoLaw, detection_of, effective_snr, received_snr
from wavegym.sensors.geometry_kernels import range_and_rate
from wavegym.sensors.multipath_kernels import SightTable
from wavegym.sensors.trains import DECAY
from wavegym.systems.sector_setup.visibility_kernels import (
    DOUBT,
    condition_one,
    of_a_miss,
    sight_one,
    visibility_is_predicted,
)
from wavegym.trackers.kernels import absorb_rows_one
from wavegym.trackers.sigma_point_kernels import regress_one, sigma_points_one, update_from_one

PLACE = (0, 2)  # elements of [x xdot y ydot] on which a range depends
ALL = (0, 1, 2, 3)  # elements on which a range-rate depends
SECOND_ORDER = 0.2  # standard deviations: above this linearisation error the update iterates
CONVERGED = 0.1  # standard deviations: the iteration ends when the estimate moves by less


class Radar(NamedTuple):
    """Constants of the world, or those that the tracker assumes: scalars of ``SectorSetup``, and arrays."""

    sites: NDArray[np.float64]  # (1 + j, 2), the illuminator first
    accuracy: NDArray[np.float64]  # (waveform, 2) variances at unit SNR of the range, and of the second row
    coupling: NDArray[np.float64]  # (waveform,) 1/s: the second row is the range-rate minus this times the range
    energy: NDArray[np.float64]  # (waveform,) of the train over that of the train with eta = strength / (Rt^2 Rr^2)
    blur: NDArray[np.float64]  # (waveform,) s^3/m^2: see ``heard_one``
    restless: NDArray[np.float64]  # (waveform,) s: variance of the mean range-rate over the acceleration's density
    law: EchoLaw
    strength: float  # eta Rt^2 Rr^2
    nearest: float
    dt: float
    turn_rate: float
    dead_steps: int
    iterations: int
    table: SightTable  # of the places that buildings hide; without columns if the times of visibility are known
    places: NDArray[np.float64]  # (p, 2) of ``visibility_kernels``
    few: NDArray[np.float64]  # the same, fewer


@inlined
def turn(pointed, dead, target, dead_steps):
    """(target set up, remaining dead steps, whether a pulse is sent) after a step with the action ``target``."""
    if target != pointed:
        dead = dead_steps
    return target, max(dead - 1, 0), dead == 0


@inlined
def is_visible(e, k, t, visible):
    """Whether target t is visible in step k."""
    return k < visible.shape[1] and visible[e, k, t]


@inlined
def turning(tau, turn_rate):
    """Displacement along and across a unit velocity after tau seconds, and the cosine and sine of the angle turned.

    These are the elements of ``constant_turn``'s F. At a turn rate of 0 they equal those of ``constant_velocity`` bit
    for bit.
    """
    if turn_rate == 0.0:
        return tau, 0.0, 1.0, 0.0
    half = np.sin(0.5 * turn_rate * tau)
    sine = np.sin(turn_rate * tau)
    return sine / turn_rate, 2.0 * half * half / turn_rate, np.cos(turn_rate * tau), sine


@inlined
def coast_mean_one(i, x, tau, turn_rate, o, x_out):
    """x_out[o] = x[i] after tau seconds."""
    along, aside, c, s = turning(tau, turn_rate)
    u, v = x[i, 1], x[i, 3]
    x_out[o, 0], x_out[o, 1] = x[i, 0] + along * u - aside * v, c * u - s * v
    x_out[o, 2], x_out[o, 3] = x[i, 2] + aside * u + along * v, s * u + c * v


@inlined
def coast_one(i, P, tau, turn_rate, q, o, P_out):
    """P_out[o] = F P[i] F' + Q over tau seconds of white acceleration of density q.

    The motion model is ``constant_turn(tau, q, turn_rate)``. Its F only rotates a velocity and adds its displacement,
    so 64 products are enough instead of 128. P_out[o] may be P[i].
    """
    along, aside, c, s = turning(tau, turn_rate)
    for b in range(4):
        u, v = P[i, 1, b], P[i, 3, b]
        P_out[o, 0, b], P_out[o, 1, b] = P[i, 0, b] + along * u - aside * v, c * u - s * v
        P_out[o, 2, b], P_out[o, 3, b] = P[i, 2, b] + aside * u + along * v, s * u + c * v
    for a in range(4):
        u, v = P_out[o, a, 1], P_out[o, a, 3]
        P_out[o, a, 0] += along * u - aside * v
        P_out[o, a, 2] += aside * u + along * v
        P_out[o, a, 1], P_out[o, a, 3] = c * u - s * v, s * u + c * v
    speed = q * tau
    cross = 0.5 * speed * tau
    for a in PLACE:
        P_out[o, a, a] += cross * tau * (2.0 / 3.0)
        P_out[o, a + 1, a] += cross
        P_out[o, a + 1, a + 1] += speed
    for a in range(4):
        for b in range(a):
            P_out[o, b, a] = P_out[o, a, b]


@inlined
def look_one(i, x, j, radar, h, H):
    """Return eta of x[i] at receiver j; fill rows 2 j and 2 j + 1 of h (a,), H (a, n).

    The rows are half the path, its rate, and their gradients. A leg shorter than ``nearest`` counts as ``nearest`` in
    the SNR and in the turn rate of its direction.
    """
    for row in (2 * j, 2 * j + 1):
        h[row] = 0.0
        for b in range(4):
            H[row, b] = 0.0
    eta = radar.strength
    for s in (0, j + 1):
        sx, sy = radar.sites[s, 0], radar.sites[s, 1]
        r, v = range_and_rate(x[i, 0], x[i, 2], x[i, 1], x[i, 3], sx, sy)
        held = max(r, radar.nearest)
        ux, uy = (x[i, 0] - sx) / r, (x[i, 2] - sy) / r
        eta /= held * held
        h[2 * j] += 0.5 * r
        h[2 * j + 1] += 0.5 * v
        H[2 * j, 0] += 0.5 * ux
        H[2 * j, 2] += 0.5 * uy
        H[2 * j + 1, 0] += 0.5 * (x[i, 1] - v * ux) / held
        H[2 * j + 1, 1] += 0.5 * ux
        H[2 * j + 1, 2] += 0.5 * (x[i, 3] - v * uy) / held
        H[2 * j + 1, 3] += 0.5 * uy
    return eta


@inlined
def heard_one(eta, j, w, q, H, radar):
    """(mean eta of train w at receiver j, variance of its mean range-rate) by ``sensors.trains``.

    eta, H: of ``look_one``. The density of the acceleration along the bisector of the two legs is q times the square
    of the gradient of half the path.
    """
    density = q * (H[2 * j, 0] * H[2 * j, 0] + H[2 * j, 2] * H[2 * j, 2])
    return eta * radar.energy[w] * (1.0 + radar.blur[w] * density) ** -DECAY, radar.restless[w] * density


@inlined
def decouple(j, w, H, radar, row):
    """Write the second row of receiver j to ``row`` of H, which may be 2 j + 1.

    The range-rate minus ``coupling`` times the range has an error that is independent of that of the range, so that
    an update takes one row after the other.
    """
    for b in range(H.shape[1]):
        H[row, b] = H[2 * j + 1, b] - radar.coupling[w] * H[2 * j, b]


class Scratch(NamedTuple):
    """Arrays that an update overwrites."""

    h: NDArray[np.float64]  # (a,) predicted measurements
    H: NDArray[np.float64]  # (a, n) their Jacobian, or the slopes of their regression
    share: NDArray[np.float64]  # (j,) effective eta of the train over eta of ``look_one``
    mean_rate: NDArray[np.float64]  # (j,) variance of the mean range-rate
    z: NDArray[np.float64]  # (a,) measurements, decoupled
    R: NDArray[np.float64]  # (a,) variances, infinite for receivers without a detection
    y: NDArray[np.float64]  # (a,) innovations
    d: NDArray[np.float64]  # (n,) correction of the mean
    v: NDArray[np.float64]  # (n,) gain before division by the innovation variance
    at: NDArray[np.float64]  # (1, n) estimate around which the measurements are linearised
    prior: NDArray[np.float64]  # (n, n)
    A: NDArray[np.float64]  # (n, n) Cholesky factor
    points: NDArray[np.float64]  # (2 n, n)
    Z: NDArray[np.float64]  # (2 n, a) measurements of the points
    sight: NDArray[np.float64]  # (6,) moments of the visible places


@inlined
def scratch(receivers, n):
    """New ``Scratch`` for this number of receivers and n states."""
    rows = 2 * receivers
    return Scratch(
        np.empty(rows), np.empty((rows, n)), np.empty(receivers), np.empty(receivers), np.empty(rows), np.empty(rows),
        np.empty(rows), np.empty(n), np.empty(n), np.empty((1, n)), np.empty((n, n)), np.empty((n, n)),
        np.empty((2 * n, n)), np.empty((2 * n, rows)), np.empty(6)
    )  # fmt: skip


@inlined
def move_one(e, k, targets, q, process, L, radar, targets_out, nn):
    """One step of the targets of environment e; process (e, k, t, n), L L' = Q at unit density."""
    for t in range(targets_out.shape[1]):
        coast_mean_one(t, targets[e], radar.dt, radar.turn_rate, t, targets_out[e])
        root = np.sqrt(q[e, t])
        for a in range(len(nn)):
            for b in range(a + 1):
                targets_out[e, t, a] += root * L[a, b] * process[e, k, t, b]


@inlined
def measure_one(e, k, t, w, sent, targets, q, visible, key, error, radar, z, seen, G):
    """Fill z (e, a), and seen (e, j): whether a receiver detects target t; z is 0 if it does not.

    The realised SNR at the true position, ``targets`` (e, t, n), decides detection and errors. ``q`` (e, t): the true
    density. G (a, n) is scratch space.
    """
    shown = sent and is_visible(e, k, t, visible)
    for j in range(seen.shape[1]):
        seen[e, j], z[e, 2 * j], z[e, 2 * j + 1] = False, 0.0, 0.0
        if not shown:
            continue
        eta = look_one(t, targets[e], j, radar, z[e], G)
        eta, mean_rate = heard_one(eta, j, w, q[e, t], G, radar)
        own = stream(stream(key[e], k), t * seen.shape[1] + j)
        snr = received_snr(eta, 0, own, radar.law)
        if snr > 0.0:
            seen[e, j] = True
            off = np.sqrt(radar.accuracy[w, 0] / snr) * error[e, k, j, t, 0]
            z[e, 2 * j] += off
            z[e, 2 * j + 1] += radar.coupling[w] * off
            z[e, 2 * j + 1] += np.sqrt(radar.accuracy[w, 1] / snr + mean_rate) * error[e, k, j, t, 1]
        else:
            z[e, 2 * j], z[e, 2 * j + 1] = 0.0, 0.0


@inlined
def curved_one(i, x, P, j, c, R, eta, radar):
    """Whether second-order terms of the rows of receiver j matter over the prior's spread; R (a,): variances.

    For a displacement d across the line of sight and a leg r, the second-order term of a range is d^2 / 2r. Those of
    its rate are d / r times the velocity's spread, and d^2 / 2r^2 times the speed. r is the geometric mean of the legs.
    The second row also has c times the term of the range, c = ``coupling``.
    """
    spread, restless = P[i, 0, 0] + P[i, 2, 2], P[i, 1, 1] + P[i, 3, 3]
    squared_speed = x[i, 1] * x[i, 1] + x[i, 3] * x[i, 3]
    inverse = np.sqrt(eta / radar.strength)  # 1 / r^2
    bend = 0.25 * spread * spread * inverse
    turn = spread * restless * inverse + squared_speed * bend * inverse + c * c * bend
    return max(bend / R[2 * j], turn / R[2 * j + 1]) > SECOND_ORDER * SECOND_ORDER


@kernel
def iterate_one(i, x, P, w, q, seen, radar, work, nn):
    """Posterior linearisation of the prediction x[i], ``work.prior``; it starts from the estimate ``work.at``, P[i].

    The iteration ends when the estimate moves by less than CONVERGED standard deviations, or after
    ``radar.iterations``. The first of these gave the estimate at the start. Error variances are also means over the
    estimate's spread. The effective SNR is taken at the estimate; from there it is proportional to eta.
    """
    h, H, share, mean_rate, z, R, y, d, v, at, prior, A, points, Z, _ = work
    for _ in range(1, radar.iterations):
        sigma_points_one(0, at, P[i : i + 1], A, points, nn)
        R[:] = 0.0
        for j in range(len(seen)):
            geometric = look_one(0, at, j, radar, h, H)
            eta, mean_rate[j] = heard_one(geometric, j, w, q, H, radar)
            share[j] = effective_snr(eta, 0, radar.law) / geometric
        for p in range(len(points)):
            for j in range(len(seen)):
                weakness = 1.0 / (look_one(p, points, j, radar, Z[p], H) * share[j] * len(points))
                Z[p, 2 * j + 1] -= radar.coupling[w] * Z[p, 2 * j]
                for a in range(2):
                    R[2 * j + a] += radar.accuracy[w, a] * weakness if seen[j] else np.inf
        for j in range(len(seen)):
            R[2 * j + 1] += mean_rate[j]
        regress_one(Z, A, h, H, R, nn)
        if update_from_one(i, x, P, prior, at, z, h, H, R, y, d, v, nn) < CONVERGED * CONVERGED:
            return


@inlined
def update_one(i, x, P, w, q, z, seen, radar, work, nn):
    """Update the prediction x[i], P[i] with the measurements z (a,) of the receivers that detect, seen (j,).

    This is an extended Kalman filter with the effective SNR at the prediction. If the measurements are curved,
    posterior linearisation iterates from its estimate. q: density of the target's acceleration.
    """
    curved = False
    for j in range(len(seen)):
        first, second, c = 2 * j, 2 * j + 1, radar.coupling[w]
        geometric = look_one(i, x, j, radar, work.h, work.H)
        eta, mean_rate = heard_one(geometric, j, w, q, work.H, radar)
        eta = effective_snr(eta, 0, radar.law)
        work.R[first] = radar.accuracy[w, 0] / eta if seen[j] else np.inf
        work.R[second] = radar.accuracy[w, 1] / eta + mean_rate if seen[j] else np.inf
        work.z[first], work.z[second] = z[first], z[second] - c * z[first]
        decouple(j, w, work.H, radar, second)
        work.y[first] = work.z[first] - work.h[first]
        work.y[second] = work.z[second] - (work.h[second] - c * work.h[first])
        curved |= seen[j] and curved_one(i, x, P, j, c, work.R, geometric, radar)
    if curved:
        copy_matrix(P[i], work.prior)
    absorb_rows_one(i, P, work.H, work.y, work.R, work.d, work.v, nn)
    for a in range(len(nn)):
        work.at[0, a] = x[i, a] + work.d[a]
    if curved:
        iterate_one(i, x, P, w, q, seen, radar, work, nn)
    for a in range(len(nn)):
        x[i, a] = work.at[0, a]


@kernel
def notice_one(i, x, P, w, q, found, last, radar, work, nn):
    """Update x[i], P[i] with the visibility that a look indicates.

    If the target was ``found``, it is in sight of all sites. If not, it may be hidden: the likelihood is 1 - Pd v. Pd
    is the probability that any receiver detects a target at the predicted place. ``last``: 1 if the look of the last
    step at this target found it, -1 if it found nothing, 0 without a look.
    """
    sight_one(i, x, P, 0 if found else last, radar, work.sight)
    if found:
        condition_one(i, x, P, work.sight, DOUBT, 1.0 - DOUBT, nn)
        return
    missed = 1.0
    for j in range(len(radar.sites) - 1):
        eta, _ = heard_one(look_one(i, x, j, radar, work.h, work.H), j, w, q, work.H, radar)
        missed *= 1.0 - detection_of(eta, 0, radar.law)
    condition_one(i, x, P, work.sight, 1.0, of_a_miss(missed), nn)


@inlined
def track_one(e, t, w, sent, last, mean, P, q, z, seen, radar, x, P_out, work, nn):
    """Fill x[e], P_out[e]: all targets of environment e one step on, and target t updated if a receiver detects it.

    ``sent``: whether target t was illuminated. If visibility is predicted, such a look changes the estimate even
    without a detection. ``last``: see ``notice_one``. Returns this value for the look of this step.
    """
    for i in range(x.shape[1]):
        coast_mean_one(i, mean[e], radar.dt, radar.turn_rate, i, x[e])
        coast_one(i, P[e], radar.dt, radar.turn_rate, q[e, i], i, P_out[e])
    detections = 0
    for j in range(seen.shape[1]):
        detections += seen[e, j]
    if detections > 0:
        update_one(t, x[e], P_out[e], w, q[e, t], z[e], seen[e], radar, work, nn)
    if sent and visibility_is_predicted(radar):
        notice_one(t, x[e], P_out[e], w, q[e, t], detections > 0, last, radar, work, nn)
    return 0 if not sent else (1 if detections > 0 else -1)


@kernel
def move(step, targets, q, process, L, radar, targets_out, nn):
    """Fill targets_out (e, t, n): the targets one step later."""
    for e in range(len(step)):
        move_one(e, step[e], targets, q, process, L, radar, targets_out, nn)


@kernel
def measure(
    step, pointed, dead, targets, q, visible, target, waveform, key, error, radar, z, seen, silent, nn
):  # fmt: skip
    """Fill z (e, a), seen (e, j) and silent (e,): whether no pulse was sent. ``radar`` is the world's."""
    G = np.empty((z.shape[1], len(nn)))
    for e in range(len(step)):
        t, w = target[e], waveform[e]
        _, _, sent = turn(pointed[e], dead[e], t, radar.dead_steps)
        silent[e] = not sent
        measure_one(e, step[e], t, w, sent, targets, q, visible, key, error, radar, z, seen, G)


@kernel
def track(
    mean, P, pointed, dead, q, looked, target, waveform, z, seen, radar, x, P_out, pointed_out, dead_out, looked_out, nn
):  # fmt: skip
    """Fill the belief one step later from z (e, a) and seen (e, j). ``radar`` is the tracker's."""
    work = scratch(seen.shape[1], len(nn))
    for e in range(len(target)):
        t, w = target[e], waveform[e]
        pointed_out[e], dead_out[e], sent = turn(pointed[e], dead[e], t, radar.dead_steps)
        last = looked[e] if pointed[e] == t else 0
        looked_out[e] = track_one(e, t, w, sent, last, mean, P, q, z, seen, radar, x, P_out, work, nn)


@kernel
def assume(x, waveform, q, radar, R, nn):
    """Fill R (e, j, 2, 2): the mean covariance of a detection of a target at x (e, 1, n), of density q (e,)."""
    work = scratch(R.shape[1], len(nn))
    for e in range(len(R)):
        w = waveform[e]
        for j in range(R.shape[1]):
            eta, mean_rate = heard_one(look_one(0, x[e], j, radar, work.h, work.H), j, w, q[e], work.H, radar)
            far = radar.accuracy[w, 0] / effective_snr(eta, 0, radar.law)
            near = radar.accuracy[w, 1] / effective_snr(eta, 0, radar.law) + mean_rate
            c = radar.coupling[w]
            R[e, j, 0, 0], R[e, j, 0, 1], R[e, j, 1, 0], R[e, j, 1, 1] = far, c * far, c * far, c * c * far + near


@kernel
def transition(
    step, mean, P, pointed, dead, q, looked, targets, true_q, visible, target, waveform, process, key, error, L,
    radar, assumed, targets_out, z, seen, silent, x, P_out, pointed_out, dead_out, looked_out, nn
):  # fmt: skip
    """``move``, ``measure`` and ``track`` in one pass; ``radar`` is the world's, ``assumed`` the tracker's."""
    work = scratch(seen.shape[1], len(nn))
    for e in range(len(step)):
        k, t, w = step[e], target[e], waveform[e]
        move_one(e, k, targets, true_q, process, L, radar, targets_out, nn)
        pointed_out[e], dead_out[e], sent = turn(pointed[e], dead[e], t, radar.dead_steps)
        silent[e] = not sent
        measure_one(e, k, t, w, sent, targets_out, true_q, visible, key, error, radar, z, seen, work.H)
        last = looked[e] if pointed[e] == t else 0
        looked_out[e] = track_one(e, t, w, sent, last, mean, P, q, z, seen, assumed, x, P_out, work, nn)
