"""A camera that has to turn, in compiled form: turn, measure, track, and predict the value of a look.

Shapes and arguments as in ``rf_eo/kernels.py``; c candidates. Only the camera on platform 0 measures azimuths, of
targets in its image: ``low`` and ``high`` (p, 3) have no azimuth in view at first.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.platform_kernels import bearing, wrapped
from wavegym.systems.rf_eo.kernels import gain_of, look_one, measure_one, move_one, track_one
from wavegym.systems.rf_eo.prediction_kernels import predict_ahead
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one
from wavegym.trackers.rank_one_kernels import shrink_one

AZIMUTH = 2  # of a platform's three quantities


class Mount(NamedTuple):
    """The camera's scalars."""

    half: float  # half the field of view, rad
    turn: float  # greatest turn in one step, rad
    settle: int  # steps
    detection: float  # probability that a target in view is found


@inlined
def turn_towards(azimuth, pointing, settling, mount):
    """One step towards ``azimuth``: the pointing after it, the settle steps left, and whether the camera sees."""
    off = wrapped(azimuth - pointing)
    after = wrapped(pointing + min(max(off, -mount.turn), mount.turn))
    if abs(off) > mount.half:
        return after, mount.settle, False
    return after, max(settling - 1, 0), settling == 0


@inlined
def in_image(azimuth, pointing, mount):
    """Whether ``azimuth`` is in the field of view."""
    return abs(wrapped(azimuth - pointing)) <= mount.half


@inlined
def share_of(e, k, t, visible, mount):
    """Probability that target t is found in step k if it is in the image: 0 behind cover."""
    return mount.detection if k < visible.shape[1] and visible[e, k, t] else 0.0


@inlined
def scaled(A, factor, out, nn):
    """out (n, n) = factor A."""
    for a in range(len(nn)):
        for b in range(len(nn)):
            out[a, b] = factor * A[a, b]


@kernel
def transition(
    step, mean, P, pointing, settling, density, visible, truth, unseen, process, error, found, action, F, Q, L, places,
    rules, mount, variance, low, high, x, P_out, pointing_out, settling_out, truth_out, received, unseen_out, seen, nn
):  # fmt: skip
    """One step of every environment; mean, truth (e, t, n), P (e, t, n, n), received, unseen, seen (e, t).

    Q and its factor L belong to a process noise density of 1; density (e, t): the targets' own.
    """
    (count, targets, n), rows, flat = mean.shape, 3 * places.shape[0], mean.shape[0] * mean.shape[1]
    T, H, h, z, R = np.empty((n, n)), np.empty((rows, n)), np.empty(rows), np.zeros(rows), np.empty(rows)
    own, factor = np.empty((1, n, n)), np.empty((n, n))
    y, d, v, places, low, fence = np.empty(rows), np.empty(n), np.empty(n), places.copy(), low.copy(), np.empty((2, 3))
    mean, truth, x, truth_out = (
        mean.reshape((flat, n)), truth.reshape((flat, n)), x.reshape((flat, n)), truth_out.reshape((flat, n))
    )  # fmt: skip
    P, P_out = P.reshape((flat, n, n)), P_out.reshape((flat, n, n))
    for e in range(count):
        k, aim = step[e], e * targets + action[e]
        for t in range(targets):
            predict_mean_one(e * targets + t, mean, F, 0, x, nn)
        towards = bearing(x[aim, 0] - places[0, 0], x[aim, 2] - places[0, 1])
        pointing_out[e], settling_out[e], sees = turn_towards(towards, pointing[e], settling[e], mount)
        places[0, 2] = pointing_out[e]
        for t in range(targets):
            i = e * targets + t
            scaled(L, np.sqrt(density[e, t]), factor, nn)
            move_one(e, k, t, i, truth, F, factor, process, truth_out, nn)
            scaled(Q[0], density[e, t], own[0], nn)
            predict_covariance_one(i, P, F, own, 0, T, P_out, nn)
            look_one(i, x, places, rules, h, H)
            low[0, AZIMUTH] = -mount.half if sees and found[e, k, t] < share_of(e, k, t, visible, mount) else np.inf
            got = measure_one(e, k, t, i, truth_out, h, error, places, variance, low, high, fence, rules, z, R)
            seen[e, t] = R[AZIMUTH] < np.inf
            received[e, t], unseen_out[e, t] = got, 0 if seen[e, t] else unseen[e, t] + 1
            track_one(i, x, P_out, z, R, h, H, places, rules, y, d, v, nn)


@inlined
def absorb_predicted(t, P, h, H, variance, low, high, rules, azimuth, v, nn):
    """Update P[t] with the radars' quantities of target t predicted in view, and with the camera's if ``azimuth``."""
    for a in range(h.shape[1]):
        j, q = a // 3, a % 3
        seen = azimuth if a == AZIMUTH else low[j, q] <= h[t, a] <= high[j, q]
        if seen and h[t, 3 * j] >= rules.nearest:
            s = gain_of(q, t, P, H[t], a, v, nn) + variance[j, q]
            shrink_one(t, P, v, s, nn)


@kernel
def predict(
    step, mean, P, pointing, settling, density, visible, actions, draws, sampled, F, Q, places, rules, mount, variance,
    low, high, x, P_out, pointing_out, settling_out, nn
):  # fmt: skip
    """Fill predicted means x (e, c, t, n), covariances P_out (e, c, t, n, n), and the camera's state (e, c).

    actions (e or 1, c); draws (e, c or 1, t), used where ``sampled``.
    """
    (count, candidates, targets), n = x.shape[:3], len(nn)
    ahead, v, known = np.empty((targets, n)), np.empty(n), np.empty(targets, np.bool_)
    without_camera, with_camera = np.empty((targets, n, n)), np.empty((targets, n, n))
    h, H = np.empty((targets, 3 * places.shape[0])), np.empty((targets, 3 * places.shape[0], n))
    for e in range(count):
        predict_ahead(mean[e], P[e], F, Q, places, rules, ahead, without_camera, h, H, nn)
        for t in range(targets):  # predict_ahead assumed a density of 1
            for a in range(n):
                for b in range(n):
                    without_camera[t, a, b] += (density[e, t] - 1.0) * Q[0, a, b]
        with_camera[:], known[:] = without_camera, False
        for t in range(targets):
            absorb_predicted(t, without_camera, h, H, variance, low, high, rules, False, v, nn)
        for c in range(candidates):
            aim = actions[e if actions.shape[0] > 1 else 0, c]
            after, left, sees = turn_towards(h[aim, AZIMUTH], pointing[e], settling[e], mount)
            pointing_out[e, c], settling_out[e, c] = after, left
            for t in range(targets):
                x[e, c, t], P_out[e, c, t] = ahead[t], without_camera[t]
                share = share_of(e, step[e], t, visible, mount)
                if not (sees and in_image(h[t, AZIMUTH], after, mount)):
                    continue
                if not known[t]:
                    absorb_predicted(t, with_camera, h, H, variance, low, high, rules, True, v, nn)
                    known[t] = True
                if not sampled:
                    P_out[e, c, t] = (1.0 - share) * without_camera[t] + share * with_camera[t]
                elif draws[e, c if draws.shape[1] > 1 else 0, t] < share:
                    P_out[e, c, t] = with_camera[t]


@kernel
def delay(step, mean, pointing, settling, visible, F, places, mount, out, off, nn):
    """Fill out (e, t), the steps without sight before the camera sees each target where it will be one step ahead.

    They last until the camera has turned and settled and the target has come out of cover. off (e, t): the turn needed.
    """
    x = np.empty((mean.shape[1], len(nn)))
    for e in range(mean.shape[0]):
        for t in range(mean.shape[1]):
            predict_mean_one(t, mean[e], F, 0, x, nn)
            towards = bearing(x[t, 0] - places[0, 0], x[t, 2] - places[0, 1])
            off[e, t] = wrapped(towards - pointing[e])
            beyond = abs(off[e, t]) - mount.half
            out[e, t] = settling[e] if beyond <= 0.0 else int(np.ceil(beyond / mount.turn)) + mount.settle
            while step[e] + out[e, t] < visible.shape[1] and not visible[e, step[e] + out[e, t], t]:
                out[e, t] += 1


@kernel
def gain(step, mean, P, density, visible, wait, F, Q, M, places, rules, mount, variance, low, high, out, nn):
    """Fill out (e, c), the reduction of the summed cost by one look at target c after ``wait`` (e, c) steps.

    F, Q (w, n, n): transition of 1, 2, ... steps and noise of a density of 1; M (l, n, n): weights summed over as many
    steps. All targets that will be in the image and in sight count. The radars' measurements up to the look count as if
    all were taken with the look.
    """
    targets, n = mean.shape[1], len(nn)
    x, V, T, v = np.empty((targets, n)), np.empty((targets, n, n)), np.empty((n, n)), np.empty(n)
    noise, step_on = np.empty((1, n, n)), np.empty((1, n, n))
    H, h = np.empty((3 * places.shape[0], n)), np.empty(3 * places.shape[0])
    for e in range(mean.shape[0]):
        for c in range(targets):
            out[e, c] = 0.0
            left, w = visible.shape[1] - step[e] - wait[e, c], wait[e, c]
            if left < 1:
                continue
            m = min(left, M.shape[0]) - 1
            predict_mean_one(c, mean[e], F, w, x, nn)
            pointing = bearing(x[c, 0] - places[0, 0], x[c, 2] - places[0, 1])
            for t in range(targets):
                predict_mean_one(t, mean[e], F, w, x, nn)
                look_one(t, x, places, rules, h, H)
                share = share_of(e, step[e] + w, t, visible, mount)
                if share == 0.0 or h[0] < rules.nearest or not in_image(h[AZIMUTH], pointing, mount):
                    continue
                scaled(Q[w], density[e, t], noise[0], nn)
                step_on[0] = F[w]
                predict_covariance_one(t, P[e], step_on, noise, 0, T, V, nn)
                for a in range(h.shape[0]):
                    j, q = a // 3, a % 3
                    if q != AZIMUTH and low[j, q] <= h[a] <= high[j, q] and h[3 * j] >= rules.nearest:
                        s = gain_of(q, t, V, H, a, v, nn) + variance[j, q] / (w + 1)
                        shrink_one(t, V, v, s, nn)
                s = gain_of(AZIMUTH, t, V, H, AZIMUTH, v, nn) + variance[0, AZIMUTH]
                total = 0.0
                for a in range(n):
                    for b in range(n):
                        total += v[a] * M[m, a, b] * v[b]
                out[e, c] += share * total / s
