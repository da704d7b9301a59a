"""The RF/EO loop in compiled form: move the targets, measure them, track them.

Shapes and arguments are those of ``look_kernels.py``. The parameters of the world may differ from those of the tracker:
``true_rules`` and the field of view ``true_view`` belong to the world. A view is the tuple of variance, low and high,
(p, 3) each. ``i`` is the index of a target in the means x (i, n) and covariances P (i, n, n). z and R (a,):
measurements and the variances that the tracker assumes, infinite for quantities that were not received.

The tracker is an extended Kalman filter. If the second-order terms of a measurement are small over the spread of the
prior, it linearises once. Otherwise the update iterates (Gauss-Newton). If the terms are not small over the spread of
the posterior either, as after a range alone, the posterior is curved. The tracker then linearises by regression over
the posterior's own spread.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.array_kernels import copy_matrix, copy_vector
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.folding_kernels import apparent
from wavegym.sensors.platform_kernels import penalty_one, polar, wrapped
from wavegym.systems.rf_eo.look_kernels import (
    ALL,
    absorb_one,
    aim_all,
    hidden_half,
    information_one,
    is_here,
    look_one,
    look_polar,
    noise_of,
    residual_one,
    spread_of,
    unfold_one,
    view_all,
    width_of,
)
from wavegym.trackers.kernels import (
    correct_one,
    gain_one,
    predict_covariance_one,
    predict_mean_one,
    shrink_one,
    squared_mahalanobis_one,
)
from wavegym.trackers.sigma_point_kernels import regression_one, sigma_points_one

FAINT = 1e-6  # least observed value of a quantity or its standard deviation: keeps log10 finite
SECOND_ORDER = 0.1  # standard deviations: above this linearisation error the update iterates
CONVERGED = 1e-3  # standard deviations: the iteration ends when the estimate moves by less


@kernel
def is_hidden(true, high, j, rules):
    """Whether platform j's radar misses a target, which is in a blind zone of range or in the clutter notch."""
    for q in range(2):
        W = width_of(q, high[j, q], rules)
        if abs(true[q] - W * np.rint(true[q] / W)) < hidden_half(q, W, rules):
            return True
    return False


@inlined
def receive_one(t, i, truth, h, error, places, view, true_view, fence, rules, true_rules, z, R):
    """Measure truth[i]: fill z (a,) and the tracker's variances R (a,), 0 and infinite for quantities out of view.

    h (a,): predicted quantities; error (p, t, 3): standard normal. Returns the number of quantities received. With
    folding, range and range-rate fold, and the radar receives both or neither.
    """
    received = 0
    variance, low, high = view
    true_variance, true_low, true_high = true_view
    for j in range(places.shape[0]):
        sx, sy = places[j, 0], places[j, 1]
        true = polar(truth[i, 0], truth[i, 1], truth[i, 2], truth[i, 3], sx, sy, places[j, 2], rules.printed)
        blind = true[0] < true_rules.nearest or h[3 * j] < rules.nearest
        hidden = true_rules.folding and is_hidden(true, true_high, j, true_rules)
        for q in range(3):
            a, lo, hi, drawn = 3 * j + q, true_low[j, q], true_high[j, q], true_variance[j, q]
            z[a], R[a] = 0.0, np.inf
            if true_rules.folding and q < 2:
                W = width_of(q, hi, true_rules)
                if not (blind or hidden):
                    R[a] = variance[j, q]
                    z[a] = apparent(true[q] + np.sqrt(drawn) * error[j, t, q], W, -0.5 * q * W)
                    received += 1
                continue
            if blind or not (rules.inflated or lo <= true[q] <= hi):
                continue
            R[a] = variance[j, q]
            if rules.inflated:
                R[a] += penalty_one(rules.penalty, h[a], low[j, q], high[j, q], fence[0, q], fence[1, q])
                drawn += penalty_one(rules.penalty, true[q], lo, hi, fence[0, q], fence[1, q])
            z[a] = true[q] + np.sqrt(drawn) * error[j, t, q]
            received += 1
    return received


@inlined
def move_one(i, truth, F, L, process, truth_out, nn):
    """Move a target: truth_out[i] = F truth[i] + L process, process (n,)."""
    predict_mean_one(i, truth, F, 0, truth_out, nn)
    for a in range(len(nn)):
        for b in range(a + 1):
            truth_out[i, a] += L[a, b] * process[b]


@inlined
def curved_one(i, x, P, h, R):
    """Whether second-order terms of the measurement matter over the prior's spread, so that the update must iterate.

    For a displacement d across the line of sight, the second-order term of the range is d^2 / 2r, that of the azimuth
    d^2 / 2r^2, those of the range-rate d / r times the velocity's spread and d^2 / 2r^2 times the speed.
    """
    spread = P[i, 0, 0] + P[i, 2, 2]
    restless = P[i, 1, 1] + P[i, 3, 3]
    squared_speed = x[i, 1] * x[i, 1] + x[i, 3] * x[i, 3]
    most = SECOND_ORDER * SECOND_ORDER
    for j in range(h.shape[0] // 3):
        r = h[3 * j]
        bend = 0.5 * spread / r
        turn = bend / r
        if bend * bend > most * R[3 * j] or turn * turn > most * R[3 * j + 2]:
            return True
        if spread * restless / (r * r) + squared_speed * turn * turn > most * R[3 * j + 1]:
            return True
    return False


@kernel
def iterate_one(i, x, P, z, R, h, H, places, rules, y, d, v, is_polar, nn):
    """Gauss-Newton update: linearise again at each new estimate, starting from the prediction x[i], P[i] with h, H.

    ``is_polar``: x[i] is the polar state about the first platform. The iteration ends when the estimate moves by less
    than CONVERGED standard deviations, or after ``rules.iterations``.
    """
    n = len(nn)
    prior, at = P[i].copy(), x[i : i + 1].copy()
    for spent in range(1, rules.iterations + 1):
        copy_matrix(prior, P[i])
        absorb_one(i, P, H, y, R, d, v, nn)
        moved = 0.0
        for k in range(n):
            step = x[i, k] + d[k] - at[0, k]
            moved = max(moved, step * step / P[i, k, k])
            at[0, k] = x[i, k] + d[k]
        if moved < CONVERGED * CONVERGED or spent == rules.iterations:
            break
        if is_polar:
            look_polar(0, at, places, rules, h, H)
        else:
            look_one(0, at, places, rules, h, H)
        residual_one(z, h, y)
        for a in range(h.shape[0]):
            for k in range(n):
                y[a] += H[a, k] * (at[0, k] - x[i, k])
    for k in range(n):
        x[i, k] = at[0, k]


@inlined
def values_one(points, h, places, rules, values):
    """Fill values (2 n, a): quantities of all platforms at the points (2 n, n), azimuths within pi of h (a,)."""
    for k in range(points.shape[0]):
        for j in range(places.shape[0]):
            r, rdot, azimuth = polar(
                points[k, 0], points[k, 1], points[k, 2], points[k, 3],
                places[j, 0], places[j, 1], places[j, 2], rules.printed,
            )  # fmt: skip
            values[k, 3 * j], values[k, 3 * j + 1] = r, rdot
            values[k, 3 * j + 2] = h[3 * j + 2] + wrapped(azimuth - h[3 * j + 2])


@inlined
def whiten_one(values, R, C, H, y, rows):
    """Replace H (a, n) and y (a,) by C^-1 H and C^-1 y, where C C' = diag(R) + the covariance of linearisation errors.

    C (a, a) is scratch space. Rows of infinite R do not change.
    """
    half = values.shape[0] // 2
    for a in range(rows):
        if R[a] < np.inf:
            for b in range(a + 1):
                if R[b] < np.inf:
                    total = R[a] if a == b else 0.0
                    for k in range(half):
                        total += values[2 * k, a] * values[2 * k, b] / half
                    for k in range(b):
                        if R[k] < np.inf:
                            total -= C[a, k] * C[b, k]
                    C[a, b] = np.sqrt(total) if a == b else total / C[b, b]
            for b in range(a):
                if R[b] < np.inf:
                    y[a] -= C[a, b] * y[b]
                    for k in range(H.shape[1]):
                        H[a, k] -= C[a, b] * H[b, k]
            y[a] /= C[a, a]
            for k in range(H.shape[1]):
                H[a, k] /= C[a, a]


@kernel
def regress_one(i, x, P, prior_x, prior, z, R, h, H, places, rules, y, d, v, nn):
    """Posterior linearisation: improve the estimate x[i], P[i] of a posterior that is too wide for one linearisation.

    Each pass replaces the measurement by its statistical linear regression over the current posterior. The errors of
    the regression count as measurement noise. The pass then updates the prior again: prior_x (1, n), prior (n, n).
    Garcia-Fernandez, Svensson, Morelande and Sarkka (2015), "Posterior linearization filter". Other arguments as in
    ``iterate_one``.
    """
    n, rows = len(nn), h.shape[0]
    A, C, points, values = np.empty((n, n)), np.empty((rows, rows)), np.empty((2 * n, n)), np.empty((2 * n, rows))
    for _ in range(rules.iterations):
        sigma_points_one(i, x, P, A, points, nn)
        values_one(points, h, places, rules, values)
        for a in range(rows):
            h[a] = regression_one(a, values, A, H, nn)
        residual_one(z, h, y)
        for a in range(rows):
            for k in range(n):
                y[a] += H[a, k] * (x[i, k] - prior_x[0, k])
        whiten_one(values, R, C, H, y, rows)
        copy_matrix(prior, P[i])
        for k in range(n):
            d[k] = 0.0
        for a in range(rows):
            if R[a] < np.inf:
                s = gain_one(i, P, H, a, v, nn, ALL) + 1.0
                correct_one(d, H, a, v, s, y[a], nn)
                shrink_one(i, P, v, s, nn)
        moved = 0.0
        for k in range(n):
            step = prior_x[0, k] + d[k] - x[i, k]
            moved = max(moved, step * step / P[i, k, k])
            x[i, k] = prior_x[0, k] + d[k]
        if moved < CONVERGED * CONVERGED:
            break


@inlined
def update_one(i, x, P, z, R, h, H, y, d, v, nn):
    """Update the prediction x[i], P[i] with measurements z, variances R (a,); h, H: predicted z and its Jacobian."""
    residual_one(z, h, y)
    absorb_one(i, P, H, y, R, d, v, nn)
    for a in range(len(nn)):
        x[i, a] += d[a]


@kernel
def refine_one(i, x, P, z, R, h, H, places, rules, y, d, v, nn):
    """``update_one`` for measurements for which one linearisation is not enough."""
    prior_x, prior = x[i : i + 1].copy(), P[i].copy()
    residual_one(z, h, y)
    iterate_one(i, x, P, z, R, h, H, places, rules, y, d, v, False, nn)
    if curved_one(i, x, P, h, R):
        regress_one(i, x, P, prior_x, prior, z, R, h, H, places, rules, y, d, v, nn)


@inlined
def empty_view(platforms):
    """Variance, low and high, to be filled by ``view_all``."""
    return np.empty((platforms, 3)), np.empty((platforms, 3)), np.empty((platforms, 3))


@inlined
def rows_of(array):
    """array (e, t, ...) as (e t, ...)."""
    return array.reshape((array.shape[0] * array.shape[1], *array.shape[2:]))


@kernel
def transition(
    step, mean, P, truth, unseen, process, error, settings, true_motion, true_rules, scene, x, P_out, truth_out,
    received, unseen_out, share, nn
):  # fmt: skip
    """One step of every environment; mean, truth (e, t, n), P (e, t, n, n), received, unseen (e, t), share (e,).

    Targets outside the scene do not change.
    """
    (F, noise, places, fence, rules, stay), (true_F, true_L) = scene, true_motion
    (count, targets, n), platforms = mean.shape, places.shape[0]
    rows, view, true_view = 3 * platforms, empty_view(platforms), empty_view(platforms)
    T, H, h, z, R = np.empty((n, n)), np.empty((rows, n)), np.empty(rows), np.empty(rows), np.empty(rows)
    y, d, v, u, part = np.empty(rows), np.empty(n), np.empty(n), np.empty(rows), np.empty(rows)
    aimed, Q = np.empty(places.shape), noise[0]
    mean, P, truth, x, P_out, truth_out = (
        rows_of(mean), rows_of(P), rows_of(truth), rows_of(x), rows_of(P_out), rows_of(truth_out)
    )  # fmt: skip
    for e in range(count):
        k, share[e] = step[e], np.inf
        view_all(e, settings, rules, *view)
        view_all(e, settings, true_rules, *true_view)
        aim_all(settings[e, :, 3], places, aimed)
        for t in range(targets):
            i = e * targets + t
            if not is_here(t, k + 1, stay):
                copy_vector(truth[i], truth_out[i])
                copy_vector(mean[i], x[i])
                copy_matrix(P[i], P_out[i])
                received[e, t], unseen_out[e, t] = 0, 0
                continue
            move_one(i, truth, true_F, true_L, process[e, k, t], truth_out, nn)
            predict_mean_one(i, mean, F, t, x, nn)
            predict_covariance_one(i, P, F, Q, t, T, P_out, nn)
            look_one(i, x, aimed, rules, h, H)
            share[e] = min(share[e], information_one(i, P_out, h, H, *view, fence, rules))
            got = receive_one(
                t, i, truth_out, h, error[e, k], aimed, view, true_view, fence, rules, true_rules, z, R
            )  # fmt: skip
            received[e, t], unseen_out[e, t] = got, 0 if got > 0 else unseen[e, t] + 1
            if rules.folding:
                unfold_one(i, P_out, z, R, h, H, view[2], rules, u, part, y, d, v, nn)
                copy_vector(u, z)
                copy_vector(part, R)
            if rules.iterations > 1 and curved_one(i, x, P_out, h, R):
                refine_one(i, x, P_out, z, R, h, H, aimed, rules, y, d, v, nn)
            else:
                update_one(i, x, P_out, z, R, h, H, y, d, v, nn)
        share[e] = share[e] if share[e] < np.inf else 0.0  # infinite: the scene is empty


@kernel
def move(step, truth, process, F, L, stay, truth_out, nn):
    """Fill truth_out (e, t, n): all targets in the scene one step on."""
    targets = truth.shape[1]
    truth, truth_out = rows_of(truth), rows_of(truth_out)
    for i in range(truth.shape[0]):
        e, t = i // targets, i % targets
        if is_here(t, step[e] + 1, stay):
            move_one(i, truth, F, L, process[e, step[e], t], truth_out, nn)
        else:
            copy_vector(truth[i], truth_out[i])


@kernel
def receive(step, mean, P, truth, error, settings, true_rules, scene, z, R, share, nn):
    """Fill z, R (e, t, a) with the measurements of truth (e, t, n), and share (e,) with the least information."""
    F, _, places, fence, rules, stay = scene
    (count, targets, n), platforms = mean.shape, places.shape[0]
    view, true_view = empty_view(platforms), empty_view(platforms)
    x, V, T = np.empty((1, n)), np.empty((1, n, n)), np.empty((n, n))
    H, h, truth = np.empty((3 * platforms, n)), np.empty(3 * platforms), rows_of(truth)
    aimed = np.empty(places.shape)
    for e in range(count):
        Q, share[e] = noise_of(e, scene), np.inf
        view_all(e, settings, rules, *view)
        view_all(e, settings, true_rules, *true_view)
        aim_all(settings[e, :, 3], places, aimed)
        for t in range(targets):
            i = e * targets + t
            if not is_here(t, step[e] + 1, stay):
                z[e, t], R[e, t] = 0.0, np.inf
                continue
            predict_mean_one(0, mean[e, t : t + 1], F, t, x, nn)
            predict_covariance_one(0, P[e, t : t + 1], F, Q, t, T, V, nn)
            look_one(0, x, aimed, rules, h, H)
            share[e] = min(share[e], information_one(0, V, h, H, *view, fence, rules))
            receive_one(
                t, i, truth, h, error[e, step[e]], aimed, view, true_view, fence, rules, true_rules, z[e, t], R[e, t]
            )  # fmt: skip
        share[e] = share[e] if share[e] < np.inf else 0.0


@kernel
def track(step, mean, P, z, R, settings, scene, x, P_out, nn):
    """Fill x (e, t, n), P_out (e, t, n, n): one step of the tracker with measurements z of variances R (e, t, a).

    settings (e, p, 4): the settings of these measurements.
    """
    F, noise, places, _, rules, stay = scene
    rows, n, Q = z.shape[2], len(nn), noise[0]
    T, H, h, y, d, v = (
        np.empty((n, n)), np.empty((rows, n)), np.empty(rows), np.empty(rows), np.empty(n), np.empty(n)
    )  # fmt: skip
    view, targets, u, part = empty_view(places.shape[0]), mean.shape[1], np.empty(rows), np.empty(rows)
    aimed = np.empty(places.shape)
    mean, P, z, R, x, P_out = rows_of(mean), rows_of(P), rows_of(z), rows_of(R), rows_of(x), rows_of(P_out)
    for i in range(mean.shape[0]):
        if i % targets == 0:
            view_all(i // targets, settings, rules, *view)
            aim_all(settings[i // targets, :, 3], places, aimed)
        if not is_here(i % targets, step[i // targets] + 1, stay):
            copy_vector(mean[i], x[i])
            copy_matrix(P[i], P_out[i])
            continue
        predict_mean_one(i, mean, F, i % targets, x, nn)
        predict_covariance_one(i, P, F, Q, i % targets, T, P_out, nn)
        look_one(i, x, aimed, rules, h, H)
        copy_vector(z[i], u)
        copy_vector(R[i], part)
        if rules.folding:
            unfold_one(i, P_out, z[i], R[i], h, H, view[2], rules, u, part, y, d, v, nn)
        if rules.iterations > 1 and curved_one(i, x, P_out, h, part):
            refine_one(i, x, P_out, u, part, h, H, aimed, rules, y, d, v, nn)
        else:
            update_one(i, x, P_out, u, part, h, H, y, d, v, nn)


@kernel
def observe(mean, P, looks, scene, out, nn):
    """Fill out (e, elements): the observation before the logarithm, with variances in place of standard deviations.

    For every target, predicted one step ahead: variances of position and velocity, then for each platform
    |(r, rdot, azimuth)|, each followed by its variance.
    """
    places, rules = scene.places, scene.rules
    n, rows = len(nn), 3 * places.shape[0]
    T, H, h = np.empty((n, n)), np.empty((rows, n)), np.empty(rows)
    x, V = np.empty((mean.shape[1], n)), np.empty((mean.shape[1], n, n))
    aimed = np.empty(places.shape)
    for e in range(mean.shape[0]):
        column = 0
        aim_all(looks[e], places, aimed)
        Q = noise_of(e, scene)
        for t in range(mean.shape[1]):
            predict_mean_one(t, mean[e], scene.F, t, x, nn)
            predict_covariance_one(t, P[e], scene.F, Q, t, T, V, nn)
            look_one(t, x, aimed, rules, h, H)
            out[e, column] = V[t, 0, 0] + V[t, 2, 2]
            out[e, column + 1] = V[t, 1, 1] + V[t, 3, 3]
            column += 2
            for j in range(places.shape[0]):
                for q in range(3):
                    a = 3 * j + q
                    out[e, column] = max(abs(h[a]), FAINT)
                    out[e, column + 1] = max(spread_of(q, t, V, H, a), FAINT * FAINT)
                    column += 2


@inlined
def track_errors_one(e, t, mean, P, truth, L, d, values, nn):
    """Fill position error, position variance and NEES e' P^-1 e of a target, values[:, e, t]."""
    for a in range(len(nn)):
        d[a] = mean[e, t, a] - truth[e, t, a]
    values[0, e, t] = np.sqrt(d[0] * d[0] + d[2] * d[2])
    values[1, e, t] = P[e, t, 0, 0] + P[e, t, 2, 2]
    values[2, e, t] = squared_mahalanobis_one(t, d, P[e], L, nn)


@kernel
def track_errors(mean, P, truth, values, nn):
    """``track_errors_one`` of every target, values (3, e, t)."""
    L, d = np.empty((len(nn), len(nn))), np.empty(len(nn))
    for e in range(mean.shape[0]):
        for t in range(mean.shape[1]):
            track_errors_one(e, t, mean, P, truth, L, d, values, nn)


@kernel
def unfold(x, P, z, R, settings, scene, u, part, nn):
    """Fill u, part (e, t, a): the measurements z of variances R, unfolded; see ``unfold_one``.

    x (e, t, n), P (e, t, n, n): predicted states. settings (e, p, 4): the settings of these measurements.
    """
    places, rules = scene.places, scene.rules
    rows, n = z.shape[2], len(nn)
    H, h, y, d, v = np.empty((rows, n)), np.empty(rows), np.empty(rows), np.empty(n), np.empty(n)
    view, aimed = empty_view(places.shape[0]), np.empty(places.shape)
    for e in range(x.shape[0]):
        view_all(e, settings, rules, *view)
        aim_all(settings[e, :, 3], places, aimed)
        for t in range(x.shape[1]):
            look_one(t, x[e], aimed, rules, h, H)
            unfold_one(t, P[e], z[e, t], R[e, t], h, H, view[2], rules, u[e, t], part[e, t], y, d, v, nn)


@kernel
def figures(step, mean, P, truth, share, stay, come_and_go, threshold, values, present, below, nn):
    """The figures of a state: values (3, e, t) of ``track_errors_one``, 0 for a target that is not in the scene.

    present (e, t): whether a target is in the scene, as all are unless they ``come_and_go``. below (e,): whether
    ``share``, the least information of any target in the scene, is below the threshold.
    """
    L, d = np.empty((len(nn), len(nn))), np.empty(len(nn))
    for e in range(mean.shape[0]):
        some = False
        for t in range(mean.shape[1]):
            track_errors_one(e, t, mean, P, truth, L, d, values, nn)
            here = not come_and_go or is_here(t, step[e], stay)
            present[e, t], some = here, some or here
            if not here:
                values[:, e, t] = 0.0
        below[e] = some and step[e] > 0 and share[e] < threshold
