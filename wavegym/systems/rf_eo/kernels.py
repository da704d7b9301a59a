"""The RF/EO loop in compiled form: move the targets, measure them, track them.

Shapes: e environments, t targets, p platforms, a = 3 p measured quantities, (r, rdot, azimuth) of platform after
platform. ``settings`` (e, p, 3): PRF, bandwidth and pixel angle; variance, low and high (p, 3): measurement variances
and field of view of one environment's settings. ``places`` (p, 3): positions and look directions; ``fence`` (2, 3):
sharpness and height of the penalties; ``rules``: the scalars of ``Rules``.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.platform_kernels import penalty_one, polar, polar_rows, view_one, wrapped
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one, squared_mahalanobis_one
from wavegym.trackers.rank_one_kernels import correct_one, gain_one, shrink_one, spread_one
from wavegym.trackers.sigma_point_kernels import regression_one, sigma_points_one

SECOND_ORDER = 0.1  # standard deviations: a greater linearisation error makes the update iterate
CONVERGED = 1e-3  # standard deviations: the iteration ends when the estimate moves by less
PLACE = (0, 2)  # elements of [x xdot y ydot] that range and azimuth depend on
ALL = (0, 1, 2, 3)  # elements that the range-rate depends on
FAINT = 1e-6  # least observed value of a quantity or its standard deviation: keeps log10 finite


class Rules(NamedTuple):
    """Scalars of the scenario; see ``RfEo``."""

    penalty: int
    nearest: float
    margin: float
    printed: bool
    wavelength: float
    fft_length: int
    pixels: int
    inflated: bool
    iterations: int


@inlined
def view_all(e, settings, rules, variance, low, high):
    """Fill variance, low and high for the settings of environment e."""
    for j in range(settings.shape[1]):
        view_one(
            settings[e, j, 0], settings[e, j, 1], settings[e, j, 2], rules.wavelength, rules.fft_length, rules.pixels,
            rules.printed, j, variance, low, high
        )  # fmt: skip


@inlined
def look_one(i, x, places, rules, h, H):
    """Predicted measurements h (a,) and Jacobian H (a, n) of x[i] at all platforms."""
    for j in range(places.shape[0]):
        sx, sy = places[j, 0], places[j, 1]
        r, rdot, azimuth = polar(x[i, 0], x[i, 1], x[i, 2], x[i, 3], sx, sy, places[j, 2], rules.printed)
        polar_rows(x[i, 0], x[i, 1], x[i, 2], x[i, 3], sx, sy, r, rdot, rules.printed, 3 * j, H)
        h[3 * j], h[3 * j + 1], h[3 * j + 2] = r, rdot, azimuth


@inlined
def spread_of(q, i, P, H, a):
    """h'P[i] h for row h of H, number a; q: range, range-rate or azimuth."""
    return spread_one(i, P, H, a, ALL) if q == 1 else spread_one(i, P, H, a, PLACE)


@inlined
def gain_of(q, i, P, H, a, v, nn):
    """As ``spread_of``; fills v (n,) = P[i] h."""
    return gain_one(i, P, H, a, v, nn, ALL) if q == 1 else gain_one(i, P, H, a, v, nn, PLACE)


@inlined
def predicted_variance(value, spread, variance, low, high, q, fence, rules):
    """R~ of quantity q: variance plus penalty at the predicted value, moved ``margin`` deviations towards the edge."""
    if rules.margin == 0.0:
        return variance + penalty_one(rules.penalty, value, low, high, fence[0, q], fence[1, q])
    reach = rules.margin * np.sqrt(spread)
    upper = penalty_one(rules.penalty, value + reach, low, high, fence[0, q], fence[1, q])
    lower = penalty_one(rules.penalty, value - reach, low, high, fence[0, q], fence[1, q])
    return variance + max(upper, lower)


@inlined
def information_one(i, P, h, H, variance, low, high, fence, rules):
    """tr(P C' R~^-1 C) of target i as predicted: the information of the settings, weighted with P[i]."""
    total = 0.0
    for j in range(variance.shape[0]):
        if h[3 * j] >= rules.nearest:
            for q in range(3):
                a = 3 * j + q
                g = spread_of(q, i, P, H, a)
                total += g / predicted_variance(h[a], g, variance[j, q], low[j, q], high[j, q], q, fence, rules)
    return total


@inlined
def measure_one(e, k, t, i, truth, h, error, places, variance, low, high, fence, rules, z, R):
    """Measure truth[i]: fills z (a,) and the tracker's variances R (a,), infinite for quantities out of view.

    h (a,): predicted quantities. Returns the number of quantities received.
    """
    received = 0
    for j in range(places.shape[0]):
        sx, sy = places[j, 0], places[j, 1]
        true = polar(truth[i, 0], truth[i, 1], truth[i, 2], truth[i, 3], sx, sy, places[j, 2], rules.printed)
        blind = true[0] < rules.nearest or h[3 * j] < rules.nearest
        for q in range(3):
            a, lo, hi, drawn = 3 * j + q, low[j, q], high[j, q], variance[j, q]
            R[a] = np.inf
            if blind or not (rules.inflated or lo <= true[q] <= hi):
                continue
            R[a] = drawn
            if rules.inflated:
                R[a] += penalty_one(rules.penalty, h[a], lo, hi, fence[0, q], fence[1, q])
                drawn += penalty_one(rules.penalty, true[q], lo, hi, fence[0, q], fence[1, q])
            z[a] = true[q] + np.sqrt(drawn) * error[e, k, j, t, q]
            received += 1
    return received


@inlined
def curved_one(i, x, P, h, R):
    """Whether the measurement's second-order terms matter over the prior's spread, so that the update has to iterate.

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


@inlined
def absorb_one(i, P, H, y, R, d, v, nn):
    """d (n,) = K y and P[i] = [P[i]^-1 + H' R^-1 H]^-1, one received row after another."""
    for k in range(len(nn)):
        d[k] = 0.0
    for j in range(R.shape[0] // 3):
        for q in range(3):
            a = 3 * j + q
            if R[a] < np.inf:
                s = gain_of(q, i, P, H, a, v, nn) + R[a]
                correct_one(d, H, a, v, s, y[a], nn)
                shrink_one(i, P, v, s, nn)


@inlined
def residual_one(z, h, y):
    """y (a,) = z - h, azimuths wrapped."""
    for j in range(h.shape[0] // 3):
        y[3 * j] = z[3 * j] - h[3 * j]
        y[3 * j + 1] = z[3 * j + 1] - h[3 * j + 1]
        y[3 * j + 2] = wrapped(z[3 * j + 2] - h[3 * j + 2])


@kernel
def iterate_one(i, x, P, z, R, h, H, places, rules, y, d, v, nn):
    """Gauss-Newton update: linearise again at each new estimate, starting from the prediction x[i], P[i] with h, H.

    Ends when the estimate moves by less than CONVERGED standard deviations, or after ``rules.iterations``.
    """
    n = len(nn)
    prior, at = P[i].copy(), x[i : i + 1].copy()
    for spent in range(1, rules.iterations + 1):
        P[i] = prior
        absorb_one(i, P, H, y, R, d, v, nn)
        moved = 0.0
        for k in range(n):
            step = x[i, k] + d[k] - at[0, k]
            moved = max(moved, step * step / P[i, k, k])
            at[0, k] = x[i, k] + d[k]
        if moved < CONVERGED * CONVERGED or spent == rules.iterations:
            break
        look_one(0, at, places, rules, h, H)
        residual_one(z, h, y)
        for a in range(h.shape[0]):
            for k in range(n):
                y[a] += H[a, k] * (at[0, k] - x[i, k])
    for k in range(n):
        x[i, k] = at[0, k]


@inlined
def move_one(e, k, t, i, truth, F, L, process, truth_out, nn):
    """Move target t: truth_out[i] = F truth[i] + L process[e, k, t]."""
    predict_mean_one(i, truth, F, 0, truth_out, nn)
    for a in range(len(nn)):
        for b in range(a + 1):
            truth_out[i, a] += L[a, b] * process[e, k, t, b]


@inlined
def values_one(points, h, places, rules, values):
    """values (2 n, a): the quantities of every platform at the points (2 n, n); azimuths without a jump from h (a,)."""
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
    """Replace H (a, n) and y (a,) by C^-1 H and C^-1 y, C C' = diag(R) + the linearisation errors' covariance.

    C (a, a) is scratch space; rows of infinite R are left as they are.
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
    """Posterior linearisation: improve the estimate x[i], P[i] of a posterior too wide for one tangent.

    Every pass replaces the measurement by its statistical linear regression over the posterior so far, whose errors
    count as measurement noise, and updates the prior prior_x (1, n), prior (n, n) anew. Garcia-Fernandez, Svensson,
    Morelande and Sarkka (2015), "Posterior linearization filter". Arguments as in ``iterate_one``.
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
        P[i] = prior
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
def track_one(i, x, P, z, R, h, H, places, rules, y, d, v, nn):
    """Update the prediction x[i], P[i] with measurements z and variances R (a,); h, H: predicted ones and Jacobian."""
    residual_one(z, h, y)
    if rules.iterations > 1 and curved_one(i, x, P, h, R):
        prior_x, prior = x[i : i + 1].copy(), P[i].copy()
        iterate_one(i, x, P, z, R, h, H, places, rules, y, d, v, nn)
        if curved_one(i, x, P, h, R):
            regress_one(i, x, P, prior_x, prior, z, R, h, H, places, rules, y, d, v, nn)
    else:
        absorb_one(i, P, H, y, R, d, v, nn)
        for a in range(len(nn)):
            x[i, a] += d[a]


@kernel
def transition(
    step, mean, P, truth, unseen, process, error, settings, F, Q, L, places, fence, rules, x, P_out, truth_out,
    received, unseen_out, share, nn
):  # fmt: skip
    """One step of every environment; mean, truth (e, t, n), P (e, t, n, n), received, unseen (e, t), share (e,)."""
    (count, targets, n), platforms = mean.shape, places.shape[0]
    rows, flat = 3 * platforms, count * targets
    variance, low, high = np.empty((platforms, 3)), np.empty((platforms, 3)), np.empty((platforms, 3))
    T, H, h, z, R = np.empty((n, n)), np.empty((rows, n)), np.empty(rows), np.zeros(rows), np.empty(rows)
    y, d, v = np.empty(rows), np.empty(n), np.empty(n)
    mean, truth, x, truth_out = (
        mean.reshape((flat, n)), truth.reshape((flat, n)), x.reshape((flat, n)), truth_out.reshape((flat, n))
    )  # fmt: skip
    P, P_out = P.reshape((flat, n, n)), P_out.reshape((flat, n, n))
    for e in range(count):
        k, share[e] = step[e], np.inf
        view_all(e, settings, rules, variance, low, high)
        for t in range(targets):
            i = e * targets + t
            move_one(e, k, t, i, truth, F, L, process, truth_out, nn)
            predict_mean_one(i, mean, F, 0, x, nn)
            predict_covariance_one(i, P, F, Q, 0, T, P_out, nn)
            look_one(i, x, places, rules, h, H)
            share[e] = min(share[e], information_one(i, P_out, h, H, variance, low, high, fence, rules))
            got = measure_one(e, k, t, i, truth_out, h, error, places, variance, low, high, fence, rules, z, R)
            received[e, t], unseen_out[e, t] = got, 0 if got > 0 else unseen[e, t] + 1
            track_one(i, x, P_out, z, R, h, H, places, rules, y, d, v, nn)


@kernel
def observe(mean, P, F, Q, places, rules, out, nn):
    """out (e, elements): the observation before its logarithm is taken; variances in place of standard deviations.

    For every target, as predicted one step ahead: variances of position and velocity, then for each platform
    |(r, rdot, azimuth)|, each followed by its variance.
    """
    n, rows = len(nn), 3 * places.shape[0]
    T, H, h = np.empty((n, n)), np.empty((rows, n)), np.empty(rows)
    x, V = np.empty((mean.shape[1], n)), np.empty((mean.shape[1], n, n))
    for e in range(mean.shape[0]):
        column = 0
        for t in range(mean.shape[1]):
            predict_mean_one(t, mean[e], F, 0, x, nn)
            predict_covariance_one(t, P[e], F, Q, 0, T, V, nn)
            look_one(t, x, places, rules, h, H)
            out[e, column] = V[t, 0, 0] + V[t, 2, 2]
            out[e, column + 1] = V[t, 1, 1] + V[t, 3, 3]
            column += 2
            for j in range(places.shape[0]):
                for q in range(3):
                    a = 3 * j + q
                    out[e, column] = max(abs(h[a]), FAINT)
                    out[e, column + 1] = max(spread_of(q, t, V, H, a), FAINT * FAINT)
                    column += 2


@kernel
def measure(mean, P, truth, position, nees, nn):
    """Fill position error and NEES e' P^-1 e of every target, (e, t) each."""
    L, d = np.empty((len(nn), len(nn))), np.empty(len(nn))
    for e in range(mean.shape[0]):
        for t in range(mean.shape[1]):
            for a in range(len(nn)):
                d[a] = mean[e, t, a] - truth[e, t, a]
            position[e, t] = np.sqrt(d[0] * d[0] + d[2] * d[2])
            nees[e, t] = squared_mahalanobis_one(t, d, P[e], L, nn)
