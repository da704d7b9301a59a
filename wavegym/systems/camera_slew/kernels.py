"""A camera that has to turn, in compiled form: turn, measure, track, and predict the value of a look.

Shapes and arguments are those of ``rf_eo/kernels.py``; c candidates. Only the camera, on platform 0, measures azimuths,
of the targets in its image. Azimuths are therefore out of view in ``low`` and ``high`` (p, 3), until a kernel admits
them.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.array_kernels import copy_matrix, copy_vector
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.platform_kernels import bearing, wrapped
from wavegym.systems.rf_eo.kernels import iterate_one, move_one, receive_one, rows_of
from wavegym.systems.rf_eo.look_kernels import absorb_one, gain_of, look_one, look_polar, residual_one
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one, shrink_one
from wavegym.trackers.polar_kernels import (
    AZIMUTH,
    UNLIKELY,
    miss_one,
    normal_mass,
    predict_polar_one,
    to_cartesian_one,
)


class Mount(NamedTuple):
    """The camera's scalars."""

    half: float  # half the field of view, rad
    turn: float  # greatest turn in one step, rad
    settle: int  # steps to settle after a large turn
    detection: float  # probability that the camera finds a target in the image


@inlined
def turn_towards(azimuth, pointing, settling, mount):
    """One step towards ``azimuth``: the new pointing, the remaining settle steps, and whether the camera sees."""
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
    """Probability that the camera finds target t in step k if it is in the image: 0 if its line of sight is blocked."""
    return mount.detection if k < visible.shape[1] and visible[e, k, t] else 0.0


@inlined
def scaled(A, factor, out, nn):
    """out (n, n) = factor A."""
    for a in range(len(nn)):
        for b in range(len(nn)):
            out[a, b] = factor * A[a, b]


@inlined
def point_one(e, action, mean, F, pointing, settling, places, mount, x, nn):
    """Predict the means x (e t, n) of all targets of environment e and turn towards one; as ``turn_towards``."""
    targets = mean.shape[0] // action.shape[0]
    for i in range(e * targets, (e + 1) * targets):
        predict_mean_one(i, mean, F, 0, x, nn)
    aim = e * targets + action[e]
    azimuth = bearing(x[aim, 0] - places[0, 0], x[aim, 2] - places[0, 1])
    return turn_towards(azimuth, pointing[e], settling[e], mount)


@inlined
def sense_one(e, k, t, i, x, truth, error, found, searched, places, rules, world, view, h, H, z, R):
    """Measure truth[i]: fill z (a,) and the tracker's variances R (a,); returns the number of quantities received.

    x[i]: predicted state. ``searched``: whether the camera searches an image for the target. ``world``: rules, mount
    and view of the world. An azimuth is in view only if the camera finds the target.
    """
    true_rules, true_mount, true_view = world
    look_one(i, x, places, rules, h, H)
    seen = searched and found[e, k, t] < true_mount.detection
    true_view[1][0, AZIMUTH] = -true_mount.half if seen else np.inf
    fence = true_view[0]  # any array of this shape: there are no penalties, so nothing reads it
    return receive_one(t, i, truth, h, error[e, k], places, view, true_view, fence, rules, true_rules, z, R)


@inlined
def track_one(e, t, i, polar, S, density, z, R, searched, F, Q, places, rules, mount, x, P, p_out, S_out, scratch, nn):
    """One step of the tracker for polar[i], S[i]: fill p_out[i], S_out[i] and their Cartesian moments x[i], P[i].

    The measurements of platform 0 are linear in p. Those of other platforms need a few iterations.
    """
    A, T, points, h, H, y, d, v = scratch
    predict_polar_one(i, polar, S, F[0], Q[0], density[e, t], p_out, S_out, points, A, T, nn)
    look_polar(i, p_out, places, rules, h, H)
    missed = searched and h[0] >= rules.nearest and not R[AZIMUTH] < np.inf
    residual_one(z, h, y)
    if places.shape[0] > 1:
        iterate_one(i, p_out, S_out, z, R, h, H, places, rules, y, d, v, True, nn)
    else:
        absorb_one(i, S_out, H, y, R, d, v, nn)
        for a in range(len(nn)):
            p_out[i, a] += d[a]
    p_out[i, AZIMUTH] = wrapped(p_out[i, AZIMUTH])
    if missed:
        miss_image(i, p_out, S_out, places[0, 2], mount, v, nn)
    to_cartesian_one(i, p_out, S_out, places[0, 0], places[0, 1], x, P, nn)


@inlined
def miss_image(i, p, S, pointing, mount, g, nn):
    """Update p[i], S[i] with an image around ``pointing`` in which the camera did not find the target."""
    off = wrapped(pointing - p[i, AZIMUTH])
    miss_one(i, p, S, off - mount.half, off + mount.half, mount.detection, g, nn)


@inlined
def scratch_for(rows, nn):
    """Scratch space of ``track_one``."""
    n = len(nn)
    return (
        np.empty((n, n)), np.empty((n, n)), np.empty((2 * n, n)), np.empty(rows), np.empty((rows, n)), np.empty(rows),
        np.empty(n), np.empty(n)
    )  # fmt: skip


@kernel
def transition(
    step, mean, P, polar, S, pointing, settling, density, visible, truth, unseen, true_density, process, error, found,
    action, true_F, true_L, world, F, Q, places, rules, mount, view,
    x, P_out, polar_out, S_out, pointing_out, settling_out, truth_out, received, unseen_out, seen, nn
):  # fmt: skip
    """One step of every environment; mean, polar, truth (e, t, n), P, S (e, t, n, n), received, unseen, seen (e, t).

    Q and the world's noise factor belong to a process noise density of 1. density (e, t): the densities of the targets.
    """
    (count, targets, n), rows, places = mean.shape, 3 * places.shape[0], places.copy()
    factor, h, H, z, R = np.empty((n, n)), np.empty(rows), np.empty((rows, n)), np.empty(rows), np.empty(rows)
    scratch, (true_rules, true_mount, (true_variance, true_low, true_high)) = scratch_for(rows, nn), world
    world = (true_rules, true_mount, (true_variance, true_low.copy(), true_high))
    mean, polar, truth, x, polar_out, truth_out, S, P_out, S_out = (
        rows_of(mean), rows_of(polar), rows_of(truth), rows_of(x), rows_of(polar_out), rows_of(truth_out),
        rows_of(S), rows_of(P_out), rows_of(S_out)
    )  # fmt: skip
    for e in range(count):
        k = step[e]
        pointing_out[e], settling_out[e], sees = point_one(
            e, action, mean, F, pointing, settling, places, mount, x, nn
        )  # fmt: skip
        places[0, 2] = pointing_out[e]
        for t in range(targets):
            i = e * targets + t
            scaled(true_L, np.sqrt(true_density[e, t]), factor, nn)
            move_one(i, truth, true_F, factor, process[e, k, t], truth_out, nn)
            searched = sees and visible[e, k, t]
            got = sense_one(
                e, k, t, i, x, truth_out, error, found, searched, places, rules, world, view, h, H, z, R
            )  # fmt: skip
            seen[e, t] = R[AZIMUTH] < np.inf
            received[e, t], unseen_out[e, t] = got, 0 if seen[e, t] else unseen[e, t] + 1
            track_one(
                e, t, i, polar, S, density, z, R, searched, F, Q, places, rules, mount, x, P_out, polar_out, S_out,
                scratch, nn
            )  # fmt: skip


@kernel
def move(step, truth, density, process, F, L, truth_out, nn):
    """Fill truth_out (e, t, n): all targets one step on. L belongs to a density of 1; density (e, t): the targets'."""
    targets, factor = truth.shape[1], np.empty(L.shape)
    truth, truth_out = rows_of(truth), rows_of(truth_out)
    for i in range(truth.shape[0]):
        e, t = i // targets, i % targets
        scaled(L, np.sqrt(density[e, t]), factor, nn)
        move_one(i, truth, F, factor, process[e, step[e], t], truth_out, nn)


@kernel
def sense(
    step, mean, pointing, settling, visible, truth, error, found, action, world, F, places, rules, mount, view, z, R, nn
):  # fmt: skip
    """Fill z, R (e, t, a): measurements of truth (e, t, n) by radars and camera, after the camera has turned."""
    (count, targets, n), rows, places = mean.shape, 3 * places.shape[0], places.copy()
    h, H, x = np.empty(rows), np.empty((rows, n)), np.empty((count * targets, n))
    true_rules, true_mount, (true_variance, true_low, true_high) = world
    world = (true_rules, true_mount, (true_variance, true_low.copy(), true_high))
    mean, truth = rows_of(mean), rows_of(truth)
    for e in range(count):
        places[0, 2], _, sees = point_one(e, action, mean, F, pointing, settling, places, mount, x, nn)
        for t in range(targets):
            i, searched = e * targets + t, sees and visible[e, step[e], t]
            sense_one(
                e, step[e], t, i, x, truth, error, found, searched, places, rules, world, view, h, H, z[e, t], R[e, t]
            )  # fmt: skip


@kernel
def track(
    step, mean, P, polar, S, pointing, settling, density, visible, action, z, R, F, Q, places, rules, mount,
    x, P_out, polar_out, S_out, pointing_out, settling_out, nn
):  # fmt: skip
    """Turn the camera and track with measurements z of variances R (e, t, a), infinite for quantities not received."""
    (count, targets, _), places, scratch = mean.shape, places.copy(), scratch_for(z.shape[2], nn)
    mean, polar, x, polar_out, S, P_out, S_out = (
        rows_of(mean), rows_of(polar), rows_of(x), rows_of(polar_out), rows_of(S), rows_of(P_out), rows_of(S_out)
    )  # fmt: skip
    for e in range(count):
        pointing_out[e], settling_out[e], sees = point_one(
            e, action, mean, F, pointing, settling, places, mount, x, nn
        )  # fmt: skip
        places[0, 2] = pointing_out[e]
        for t in range(targets):
            searched = sees and visible[e, step[e], t]
            track_one(
                e, t, e * targets + t, polar, S, density, z[e, t], R[e, t], searched, F, Q, places, rules, mount,
                x, P_out, polar_out, S_out, scratch, nn
            )  # fmt: skip


@inlined
def absorb_predicted(t, S, h, H, variance, low, high, rules, azimuth, v, nn):
    """Update S[t] with the radars' quantities predicted in view, or only with the camera's azimuth if ``azimuth``."""
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
    view, x, P_out, polar_out, S_out, pointing_out, settling_out, nn
):  # fmt: skip
    """Fill predicted beliefs x, polar_out (e, c, t, n), P_out, S_out (e, c, t, n, n), and the camera's state (e, c).

    actions (e or 1, c); draws (e, c or 1, t), used if ``sampled``.
    """
    (count, candidates, targets), n, sx, sy = x.shape[:3], len(nn), places[0, 0], places[0, 1]
    A, T, points = np.empty((n, n)), np.empty((n, n)), np.empty((2 * n, n))
    ahead, p, v, (variance, low, high) = np.empty((targets, n)), np.empty((targets, n)), np.empty(n), view
    unseen, found, known = np.empty((targets, n, n)), np.empty((targets, n, n)), np.empty(targets, np.bool_)
    x_unseen, x_found = np.empty((targets, n)), np.empty((targets, n))
    P_unseen, P_found = np.empty((targets, n, n)), np.empty((targets, n, n))
    h, H = np.empty((targets, 3 * places.shape[0])), np.empty((targets, 3 * places.shape[0], n))
    for e in range(count):
        known[:] = False
        for t in range(targets):
            predict_mean_one(t, mean[e], F, 0, ahead, nn)
            predict_polar_one(t, polar[e], S[e], F[0], Q[0], density[e, t], p, unseen, points, A, T, nn)
            look_polar(t, p, places, rules, h[t], H[t])
            absorb_predicted(t, unseen, h, H, variance, low, high, rules, False, v, nn)
            to_cartesian_one(t, p, unseen, sx, sy, x_unseen, P_unseen, nn)
        for c in range(candidates):
            aim = actions[e if actions.shape[0] > 1 else 0, c]
            towards = bearing(ahead[aim, 0] - sx, ahead[aim, 2] - sy)
            after, left, sees = turn_towards(towards, pointing[e], settling[e], mount)
            pointing_out[e, c], settling_out[e, c] = after, left
            for t in range(targets):
                copy_vector(p[t], polar_out[e, c, t])
                copy_matrix(unseen[t], S_out[e, c, t])
                copy_vector(x_unseen[t], x[e, c, t])
                copy_matrix(P_unseen[t], P_out[e, c, t])
                share = share_of(e, step[e], t, visible, mount)
                if not sees or share == 0.0 or h[t, 0] < rules.nearest:
                    continue
                chance = share * mass_in_image(t, p, unseen, after, mount)
                if chance < UNLIKELY:
                    continue
                if not known[t]:
                    known[t] = True
                    copy_matrix(unseen[t], found[t])
                    absorb_predicted(t, found, h, H, variance, low, high, rules, True, v, nn)
                    to_cartesian_one(t, p, found, sx, sy, x_found, P_found, nn)
                if sampled and draws[e, c if draws.shape[1] > 1 else 0, t] < chance:
                    copy_vector(x_found[t], x[e, c, t])
                    copy_matrix(P_found[t], P_out[e, c, t])
                    copy_matrix(found[t], S_out[e, c, t])
                    continue
                miss_image(t, polar_out[e, c], S_out[e, c], after, mount, v, nn)
                to_cartesian_one(t, polar_out[e, c], S_out[e, c], sx, sy, x[e, c], P_out[e, c], nn)
                if not sampled:
                    copy_vector(p[t], polar_out[e, c, t])
                    copy_vector(x_unseen[t], x[e, c, t])
                    blended(S_out[e, c, t], found[t], chance, S_out[e, c, t], nn)
                    blended(P_out[e, c, t], P_found[t], chance, P_out[e, c, t], nn)


@kernel
def delay(step, mean, pointing, settling, visible, F, places, mount, out, off, nn):
    """Fill out (e, t): the steps before the camera can see each target at its predicted place one step ahead.

    By then the camera has turned and settled, and the line of sight is free. off (e, t): the turn that it needs.
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
def gain(step, mean, P, density, visible, wait, F, Q, M, places, rules, mount, view, out, nn):
    """Fill out (e, c), the reduction of the summed cost by one look at target c after ``wait`` (e, c) steps.

    F, Q (w, n, n): transition of 1, 2, ... steps, and their noise at a density of 1. M (l, n, n): weights summed over
    1, 2, ... steps. All targets that will be visible in the image count. The radars' measurements before the look count
    as if they were taken with the look.
    """
    targets, n, (variance, low, high) = mean.shape[1], len(nn), view
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
                copy_matrix(F[w], step_on[0])
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
