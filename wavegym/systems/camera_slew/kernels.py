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
from wavegym.systems.rf_eo.kernels import (
    CONVERGED,
    absorb_one,
    gain_of,
    look_one,
    measure_one,
    move_one,
    residual_one,
)
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one
from wavegym.trackers.polar_kernels import (
    ACROSS,
    AZIMUTH,
    RANGE,
    RATE,
    UNLIKELY,
    miss_one,
    normal_mass,
    predict_polar_one,
    state_gradient,
    state_point,
    to_cartesian_one,
)
from wavegym.trackers.rank_one_kernels import shrink_one


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


@inlined
def look_polar(i, p, places, rules, h, H, D, point, nn):
    """Predicted measurements h (a,) and their gradient H (a, n) in the polar state p[i] about platform 0.

    D (n, n) and point (1, n) are scratch space.
    """
    if places.shape[0] > 1:
        r, rdot, azimuth, v = p[i, RANGE], p[i, RATE], p[i, AZIMUTH], p[i, ACROSS]
        point[0, 0], point[0, 1], point[0, 2], point[0, 3] = state_point(r, rdot, azimuth, v)
        point[0, 0] += places[0, 0]
        point[0, 2] += places[0, 1]
        look_one(0, point, places, rules, h, H)
        state_gradient(i, p, D)
        for a in range(3, h.shape[0]):
            for k in range(len(nn)):
                total = 0.0
                for b in range(len(nn)):
                    total += H[a, b] * D[b, k]
                point[0, k] = total
            for k in range(len(nn)):
                H[a, k] = point[0, k]
    for q in range(3):
        h[q] = p[i, q]
        for k in range(len(nn)):
            H[q, k] = 1.0 if k == q else 0.0
    h[AZIMUTH] = wrapped(p[i, AZIMUTH] - places[0, 2])


@inlined
def track_one(i, p, S, z, R, places, rules, h, H, y, d, v, D, point, nn):
    """Update p[i], S[i] with measurements z of variances R (a,): linear for platform 0, Gauss-Newton for the others."""
    look_polar(i, p, places, rules, h, H, D, point, nn)
    residual_one(z, h, y)
    if places.shape[0] > 1 and rules.iterations > 1:
        iterate_polar(i, p, S, z, R, places, rules, h, H, y, d, v, D, point, nn)
    else:
        absorb_one(i, S, H, y, R, d, v, nn)
        for a in range(len(nn)):
            p[i, a] += d[a]
    p[i, AZIMUTH] = wrapped(p[i, AZIMUTH])


@kernel
def iterate_polar(i, p, S, z, R, places, rules, h, H, y, d, v, D, point, nn):
    """As ``rf_eo.kernels.iterate_one``, in polar coordinates."""
    n = len(nn)
    prior, at = S[i].copy(), p[i : i + 1].copy()
    for spent in range(1, rules.iterations + 1):
        S[i] = prior
        absorb_one(i, S, H, y, R, d, v, nn)
        moved = 0.0
        for k in range(n):
            step = p[i, k] + d[k] - at[0, k]
            moved = max(moved, step * step / S[i, k, k])
            at[0, k] = p[i, k] + d[k]
        if moved < CONVERGED * CONVERGED or spent == rules.iterations:
            break
        look_polar(0, at, places, rules, h, H, D, point, nn)
        residual_one(z, h, y)
        for a in range(h.shape[0]):
            for k in range(n):
                y[a] += H[a, k] * (at[0, k] - p[i, k])
    for k in range(n):
        p[i, k] = at[0, k]


@inlined
def miss_image(i, p, S, pointing, mount, g, nn):
    """Update with an image around ``pointing`` in which the target was not found."""
    off = wrapped(pointing - p[i, AZIMUTH])
    miss_one(i, p, S, off - mount.half, off + mount.half, mount.detection, g, nn)


@kernel
def transition(
    step, mean, P, polar, S, pointing, settling, density, visible, truth, unseen, process, error, found, action, F, Q,
    L, places, rules, mount, variance, low, high, x, P_out, polar_out, S_out, pointing_out, settling_out, truth_out,
    received, unseen_out, seen, nn
):  # fmt: skip
    """One step of every environment; mean, polar, truth (e, t, n), P, S (e, t, n, n), received, unseen, seen (e, t).

    Q and its factor L belong to a process noise density of 1; density (e, t): the targets' own.
    """
    (count, targets, n), rows, flat = mean.shape, 3 * places.shape[0], mean.shape[0] * mean.shape[1]
    A, T, factor, points = np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty((2 * n, n))
    H, h, z, R, y = np.empty((rows, n)), np.empty(rows), np.zeros(rows), np.empty(rows), np.empty(rows)
    d, v, point, places, low, fence = (
        np.empty(n),
        np.empty(n),
        np.empty((1, n)),
        places.copy(),
        low.copy(),
        np.empty((2, 3)),
    )
    mean, polar, truth, x, polar_out, truth_out = (
        mean.reshape((flat, n)), polar.reshape((flat, n)), truth.reshape((flat, n)), x.reshape((flat, n)),
        polar_out.reshape((flat, n)), truth_out.reshape((flat, n))
    )  # fmt: skip
    S, P_out, S_out = S.reshape((flat, n, n)), P_out.reshape((flat, n, n)), S_out.reshape((flat, n, n))
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
            look_one(i, x, places, rules, h, H)
            share = share_of(e, k, t, visible, mount)
            low[0, AZIMUTH] = -mount.half if sees and found[e, k, t] < share else np.inf
            got = measure_one(e, k, t, i, truth_out, h, error, places, variance, low, high, fence, rules, z, R)
            seen[e, t] = R[AZIMUTH] < np.inf
            received[e, t], unseen_out[e, t] = got, 0 if seen[e, t] else unseen[e, t] + 1
            predict_polar_one(i, polar, S, F[0], Q[0], density[e, t], polar_out, S_out, points, A, T, nn)
            track_one(i, polar_out, S_out, z, R, places, rules, h, H, y, d, v, A, point, nn)
            if sees and share > 0.0 and not seen[e, t]:
                miss_image(i, polar_out, S_out, pointing_out[e], mount, v, nn)
            to_cartesian_one(i, polar_out, S_out, places[0, 0], places[0, 1], x, P_out, nn)


@inlined
def absorb_predicted(t, S, h, H, variance, low, high, rules, azimuth, v, nn):
    """Update S[t] with the radars' quantities predicted in view, or with the camera's azimuth alone if ``azimuth``."""
    for a in range(h.shape[1]):
        j, q = a // 3, a % 3
        seen = a == AZIMUTH if azimuth else low[j, q] <= h[t, a] <= high[j, q]
        if seen and h[t, 3 * j] >= rules.nearest:
            s = gain_of(q, t, S, H[t], a, v, nn) + variance[j, q]
            shrink_one(t, S, v, s, nn)


@inlined
def mass_in_image(i, p, S, pointing, mount):
    """Probability that target i is in the image."""
    off, sigma = wrapped(pointing - p[i, AZIMUTH]), np.sqrt(S[i, AZIMUTH, AZIMUTH])
    return normal_mass((off - mount.half) / sigma, (off + mount.half) / sigma)


@inlined
def blended(first, second, weight, out, nn):
    """out (n, n) = (1 - weight) first + weight second; out may be one of them."""
    for a in range(len(nn)):
        for b in range(len(nn)):
            out[a, b] = (1.0 - weight) * first[a, b] + weight * second[a, b]


@kernel
def predict(
    step, mean, P, polar, S, pointing, settling, density, visible, actions, draws, sampled, F, Q, places, rules, mount,
    variance, low, high, x, P_out, polar_out, S_out, pointing_out, settling_out, nn
):  # fmt: skip
    """Fill predicted beliefs x, polar_out (e, c, t, n), P_out, S_out (e, c, t, n, n), and the camera's state (e, c).

    actions (e or 1, c); draws (e, c or 1, t), used where ``sampled``.
    """
    (count, candidates, targets), n, sx, sy = x.shape[:3], len(nn), places[0, 0], places[0, 1]
    A, T, D, points = np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty((2 * n, n))
    ahead, p, v, point = np.empty((targets, n)), np.empty((targets, n)), np.empty(n), np.empty((1, n))
    unseen, found, known = np.empty((targets, n, n)), np.empty((targets, n, n)), np.empty(targets, np.bool_)
    x_unseen, x_found = np.empty((targets, n)), np.empty((targets, n))
    P_unseen, P_found = np.empty((targets, n, n)), np.empty((targets, n, n))
    h, H = np.empty((targets, 3 * places.shape[0])), np.empty((targets, 3 * places.shape[0], n))
    for e in range(count):
        known[:] = False
        for t in range(targets):
            predict_mean_one(t, mean[e], F, 0, ahead, nn)
            predict_polar_one(t, polar[e], S[e], F[0], Q[0], density[e, t], p, unseen, points, A, T, nn)
            look_polar(t, p, places, rules, h[t], H[t], D, point, nn)
            absorb_predicted(t, unseen, h, H, variance, low, high, rules, False, v, nn)
            to_cartesian_one(t, p, unseen, sx, sy, x_unseen, P_unseen, nn)
        for c in range(candidates):
            aim = actions[e if actions.shape[0] > 1 else 0, c]
            towards = bearing(ahead[aim, 0] - sx, ahead[aim, 2] - sy)
            after, left, sees = turn_towards(towards, pointing[e], settling[e], mount)
            pointing_out[e, c], settling_out[e, c] = after, left
            for t in range(targets):
                polar_out[e, c, t], S_out[e, c, t] = p[t], unseen[t]
                x[e, c, t], P_out[e, c, t] = x_unseen[t], P_unseen[t]
                share = share_of(e, step[e], t, visible, mount)
                if not sees or share == 0.0 or h[t, 0] < rules.nearest:
                    continue
                chance = share * mass_in_image(t, p, unseen, after, mount)
                if chance < UNLIKELY:
                    continue
                if not known[t]:
                    known[t], found[t] = True, unseen[t]
                    absorb_predicted(t, found, h, H, variance, low, high, rules, True, v, nn)
                    to_cartesian_one(t, p, found, sx, sy, x_found, P_found, nn)
                if sampled and draws[e, c if draws.shape[1] > 1 else 0, t] < chance:
                    x[e, c, t], P_out[e, c, t], S_out[e, c, t] = x_found[t], P_found[t], found[t]
                    continue
                miss_image(t, polar_out[e, c], S_out[e, c], after, mount, v, nn)
                to_cartesian_one(t, polar_out[e, c], S_out[e, c], sx, sy, x[e, c], P_out[e, c], nn)
                if not sampled:
                    polar_out[e, c, t], x[e, c, t] = p[t], x_unseen[t]
                    blended(S_out[e, c, t], found[t], chance, S_out[e, c, t], nn)
                    blended(P_out[e, c, t], P_found[t], chance, P_out[e, c, t], nn)


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
