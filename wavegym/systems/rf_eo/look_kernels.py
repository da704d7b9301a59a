"""Predicted measurements of the platforms, and the belief after them, in compiled form.

Shapes: e environments, t targets, p platforms, c candidates, a = 3 p quantities: (r, rdot, azimuth), platform by
platform.

- ``settings`` (e, p, 4): PRF, bandwidth, pixel angle and look direction;
- variance, low and high (p, 3): variances and field of view of the settings of one environment;
- ``places`` (p, 3): positions, and directions from which azimuths count (+y in arguments of kernels);
- ``looks`` (e, p): look directions before the step;
- ``fence`` (2, 3): sharpness and height of the penalties;
- ``rules``: the scalars of ``Rules``;
- ``stay`` (t, 2): the steps after which targets come and go.

A quantity that may be folded updates the belief only if its fold is certain. One Gaussian cannot represent several
folds. If it had the moments of all folds, the next measurement would remove the less probable ones, and the target
would be lost if one of them was true.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.array_kernels import copy_matrix, copy_vector
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.folding_kernels import (
    certain_fold_one,
    certain_reach,
    fold_pair_one,
    nearest_fold,
    nearest_pair,
    outside_notch_one,
    shifted,
)
from wavegym.sensors.platform_kernels import penalty_one, polar, polar_rows, view_one, wrapped
from wavegym.trackers.kernels import (
    correct_one,
    gain_one,
    predict_covariance_one,
    predict_mean_one,
    shrink_one,
    spread_one,
)
from wavegym.trackers.polar_kernels import state_gradient, state_point

PLACE = (0, 2)  # elements of [x xdot y ydot] on which range and azimuth depend
ALL = (0, 1, 2, 3)  # elements on which the range-rate depends


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
    folding: bool = False
    duty: float = 0.0
    notch: float = 0.0


class Scene(NamedTuple):
    """The model that the tracker and the schedulers assume."""

    F: Any  # (t, n, n), of each target
    Q: Any  # (e, t, n, n) process noise of the next step; (1, t, n, n): the same in all environments
    places: Any  # (p, 3)
    fence: Any  # (2, 3)
    rules: Rules
    stay: Any  # (t, 2)


SURE = 5.0  # a fold is certain if all others are exp(SURE^2 / 2) times less likely; error probability Q(SURE) = 3e-7
CERTAIN = 8.0  # standard deviations from an edge: beyond this distance the side is assumed to be certain


@inlined
def view_all(e, settings, rules, variance, low, high):
    """Fill variance, low and high for the settings of environment e."""
    for j in range(settings.shape[1]):
        view_one(
            settings[e, j, 0], settings[e, j, 1], settings[e, j, 2], rules.wavelength, rules.fft_length, rules.pixels,
            rules.printed, j, variance, low, high
        )  # fmt: skip


@inlined
def is_here(t, step, stay):
    """Whether target t is in the scene at a step."""
    return stay[t, 0] < step <= stay[t, 1]


@inlined
def aim_all(looks, places, aimed):
    """Fill aimed (p, 3): the platforms' places, with azimuths counted from looks (p,)."""
    for j in range(places.shape[0]):
        aimed[j, 0], aimed[j, 1], aimed[j, 2] = places[j, 0], places[j, 1], looks[j]


@inlined
def off_look(value, look, q):
    """Quantity q; an azimuth is converted: it counts from +y in ``value`` and from ``look`` in the result."""
    return wrapped(value - look) if q == 2 else value


@inlined
def look_one(i, x, places, rules, h, H):
    """Predicted measurements h (a,) and Jacobian H (a, n) of x[i] at all platforms."""
    for j in range(places.shape[0]):
        sx, sy = places[j, 0], places[j, 1]
        r, rdot, azimuth = polar(x[i, 0], x[i, 1], x[i, 2], x[i, 3], sx, sy, places[j, 2], rules.printed)
        polar_rows(x[i, 0], x[i, 1], x[i, 2], x[i, 3], sx, sy, r, rdot, rules.printed, 3 * j, H)
        h[3 * j], h[3 * j + 1], h[3 * j + 2] = r, rdot, azimuth


@inlined
def look_polar(i, p, places, rules, h, H):
    """``look_one`` for the state p[i] = [r, rdot, azimuth, v] about the first platform (``polar_kernels``)."""
    if places.shape[0] > 1:
        n = H.shape[1]
        x, D, row = np.empty((1, n)), np.empty((n, n)), np.empty(n)
        x[0, 0], x[0, 1], x[0, 2], x[0, 3] = state_point(p[i, 0], p[i, 1], p[i, 2], p[i, 3])
        x[0, 0] += places[0, 0]
        x[0, 2] += places[0, 1]
        look_one(0, x, places, rules, h, H)
        state_gradient(i, p, D)
        for a in range(3, h.shape[0]):
            for k in range(n):
                row[k] = 0.0
                for b in range(n):
                    row[k] += H[a, b] * D[b, k]
            for k in range(n):
                H[a, k] = row[k]
    for q in range(3):
        h[q] = p[i, q]
        for k in range(H.shape[1]):
            H[q, k] = 1.0 if k == q else 0.0
    h[2] = wrapped(p[i, 2] - places[0, 2])


@inlined
def spread_of(q, i, P, H, a):
    """h'P[i] h, where h is row a of H; q: range, range-rate or azimuth."""
    return spread_one(i, P, H, a, ALL) if q == 1 else spread_one(i, P, H, a, PLACE)


@inlined
def gain_of(q, i, P, H, a, v, nn):
    """``spread_of``, which also fills v (n,) = P[i] h."""
    return gain_one(i, P, H, a, v, nn, ALL) if q == 1 else gain_one(i, P, H, a, v, nn, PLACE)


@inlined
def predicted_variance(value, spread, variance, low, high, q, fence, rules):
    """R~ of quantity q: its variance, plus the larger penalty ``margin`` deviations above or below the prediction.

    A quantity that folds has no edge and no penalty.
    """
    if rules.folding and q < 2:
        return variance
    if rules.margin == 0.0:
        return variance + penalty_one(rules.penalty, value, low, high, fence[0, q], fence[1, q])
    reach = rules.margin * np.sqrt(spread)
    upper = penalty_one(rules.penalty, value + reach, low, high, fence[0, q], fence[1, q])
    lower = penalty_one(rules.penalty, value - reach, low, high, fence[0, q], fence[1, q])
    return variance + max(upper, lower)


@inlined
def width_of(q, high, rules):
    """Unambiguous interval of quantity q whose field of view ends at ``high``; inf if the quantity does not fold."""
    if not rules.folding or q == 2:
        return np.inf
    return high if q == 0 else 2.0 * high


@inlined
def hidden_half(q, width, rules):
    """Half the width of the blind zone around each multiple of the interval: the transmission, or the clutter notch."""
    return rules.duty * width if q == 0 else rules.notch


@inlined
def visible_one(value, variance, width, half):
    """The probability that a Gaussian value is farther than ``half`` from all multiples of ``width``."""
    off = abs(value - width * np.rint(value / width)) - half
    if off * off > CERTAIN * CERTAIN * variance:
        return 1.0 if off > 0.0 else 0.0
    return outside_notch_one(value, variance, width, half)


@inlined
def seen_one(r, rdot, r_variance, rdot_variance, high, j, rules):
    """The probability that platform j's radar sees a target of this predicted range and range-rate.

    This is the probability that the target is outside all blind zones and outside the notch. The correlation of range
    and range-rate is neglected. Without folding the result is 1.
    """
    if not rules.folding:
        return 1.0
    W0, W1 = width_of(0, high[j, 0], rules), width_of(1, high[j, 1], rules)
    return visible_one(r, r_variance, W0, hidden_half(0, W0, rules)) * visible_one(
        rdot, rdot_variance, W1, hidden_half(1, W1, rules)
    )


@inlined
def expected_innovation(spread, variance, seen, width):
    """Innovation variance s for which P - v v' / s is the expected covariance after a measurement that may fold.

    The radar sees the target with probability ``seen``. The measurement is used if its fold is certain.
    """
    s = spread + variance
    return s / (seen * certain_fold_one(s, width, SURE)) if width < np.inf else s


@inlined
def weighted_information(spread, variance, seen, width):
    """spread / R; R: variance of a certain, unfolded measurement that gives the same expected covariance."""
    if width < np.inf:
        return spread / (expected_innovation(spread, variance, seen, width) - spread)
    return spread / variance


@inlined
def information_one(i, P, h, H, variance, low, high, fence, rules):
    """tr(P C' R~^-1 C) of the predicted target i: the information of the settings, weighted with P[i]."""
    total = 0.0
    for j in range(variance.shape[0]):
        a = 3 * j
        if h[a] >= rules.nearest:
            r_variance, rdot_variance = spread_of(0, i, P, H, a), spread_of(1, i, P, H, a + 1)
            seen = seen_one(h[a], h[a + 1], r_variance, rdot_variance, high, j, rules)
            for q in range(3):
                g = spread_of(q, i, P, H, a + q)
                R = predicted_variance(h[a + q], g, variance[j, q], low[j, q], high[j, q], q, fence, rules)
                total += weighted_information(g, R, seen, width_of(q, high[j, q], rules))
    return total


@inlined
def residual_one(z, h, y):
    """Fill y (a,) = z - h; azimuths are wrapped."""
    for j in range(h.shape[0] // 3):
        y[3 * j] = z[3 * j] - h[3 * j]
        y[3 * j + 1] = z[3 * j + 1] - h[3 * j + 1]
        y[3 * j + 2] = wrapped(z[3 * j + 2] - h[3 * j + 2])


@inlined
def absorb_one(i, P, H, y, R, d, v, nn):
    """Fill d (n,) = K y and P[i] = [P[i]^-1 + H' R^-1 H]^-1, one received row after another."""
    for k in range(len(nn)):
        d[k] = 0.0
    for j in range(R.shape[0] // 3):
        for q in range(3):
            a = 3 * j + q
            if R[a] < np.inf:
                s = gain_of(q, i, P, H, a, v, nn) + R[a]
                correct_one(d, H, a, v, s, y[a], nn)
                shrink_one(i, P, v, s, nn)


@kernel
def fold_pair(P, H, z, h, R, high, j, rules, nn):
    """(range certain, its fold, range-rate certain, its fold) of platform j, for the prediction h, P (1, n, n).

    The likely folds of the pair are those that are not exp(SURE^2 / 2) times less likely than the best. A quantity is
    certain if its fold is the same in all of them: its spread is 0.
    """
    a, S01 = 3 * j, 0.0
    for k in range(len(nn)):
        for m in range(len(nn)):
            S01 += H[a, k] * P[0, k, m] * H[a + 1, m]
    S00, S11 = spread_of(0, 0, P, H, a) + R[a], spread_of(1, 0, P, H, a + 1) + R[a + 1]
    W0, W1 = width_of(0, high[j, 0], rules), width_of(1, high[j, 1], rules)
    least = nearest_pair(z[a] - h[a], z[a + 1] - h[a + 1], S00, S01, S11, W0, W1)[2]
    size = np.sqrt(least + SURE * SURE)
    found = fold_pair_one(z[a], z[a + 1], h[a], h[a + 1], S00, S01, S11, W0, W1, size, np.empty((0, 3)))
    return found[7] == 0.0, found[2], found[9] == 0.0, found[3]


@kernel
def unfold_one(i, P, z, R, h, H, high, rules, u, part, y, d, v, nn):
    """Fill u and part (a,): unfolded measurements and their variances, infinite if the fold is not certain.

    Azimuths first update a copy of the prediction P[i]. Then a range or range-rate is added if all other folds are
    exp(SURE^2 / 2) times less likely than the nearest. Each addition narrows the prediction for the others, until no
    other fold is certain. high (p, 3): upper edges of the fields of view, which set the widths.
    """
    trial, at, fold = P[i : i + 1].copy(), h.copy(), np.zeros(2)
    certain = np.zeros(2, np.bool_)
    residual_one(z, h, y)
    for a in range(len(z)):
        u[a], part[a] = z[a], R[a] if a % 3 == 2 else np.inf
    absorb_one(0, trial, H, y, part, d, v, nn)
    changed = True
    while changed:
        changed = False
        for j in range(len(z) // 3):
            for a in range(3 * j, 3 * j + 2):
                at[a] = h[a]
                for k in range(len(nn)):
                    at[a] += H[a, k] * d[k]
            waits = R[3 * j] < np.inf and part[3 * j] == np.inf, R[3 * j + 1] < np.inf and part[3 * j + 1] == np.inf
            if waits[0] and waits[1]:
                certain[0], fold[0], certain[1], fold[1] = fold_pair(trial, H, z, at, R, high, j, rules, nn)
            for q in range(2):
                a = 3 * j + q
                if not waits[q]:
                    continue
                W = width_of(q, high[j, q], rules)
                if not waits[1 - q]:
                    fold[q] = nearest_fold(at[a] - z[a], W)
                    y0 = z[a] + shifted(fold[q], W) - at[a]
                    certain[q] = abs(y0) <= certain_reach(spread_of(q, 0, trial, H, a) + R[a], W, SURE)
                if certain[q]:
                    changed, part[a], u[a] = True, R[a], z[a] + shifted(fold[q], W)
                    s = gain_of(q, 0, trial, H, a, v, nn) + R[a]
                    correct_one(d, H, a, v, s, u[a] - h[a], nn)
                    shrink_one(0, trial, v, s, nn)


@inlined
def noise_of(e, scene):
    """Process noise (t, n, n) of environment e."""
    return scene.Q[e if scene.Q.shape[0] > 1 else 0]


@kernel
def predict_ahead(step, mean, P, scene, Q, x, V, h, H, nn):
    """Predict all targets: mean x (t, n), covariance V (t, n, n), measurements h (t, a), Jacobians H (t, a, n).

    Q (t, n, n). A target that is not in the scene one step ahead does not change. Its range is set to -1, which is too
    near for a measurement.
    """
    T = np.empty((len(nn), len(nn)))
    for t in range(mean.shape[0]):
        if not is_here(t, step + 1, scene.stay):
            copy_vector(mean[t], x[t])
            copy_matrix(P[t], V[t])
            h[t], H[t] = -1.0, 0.0
            continue
        predict_mean_one(t, mean, scene.F, t, x, nn)
        predict_covariance_one(t, P, scene.F, Q, t, T, V, nn)
        look_one(t, x, scene.places, scene.rules, h[t], H[t])


@kernel
def predict(step, mean, P, settings, scene, x, P_out, nn):
    """Fill predicted means x (e, c, t, n) and updated covariances P_out (e, c, t, n, n); settings (e or 1, c, p, 4)."""
    (count, candidates, targets), n, platforms = x.shape[:3], len(nn), scene.places.shape[0]
    fence, rules = scene.fence, scene.rules
    variance, low, high = np.empty((platforms, 3)), np.empty((platforms, 3)), np.empty((platforms, 3))
    ahead, V, v = np.empty((targets, n)), np.empty((targets, n, n)), np.empty(n)
    h, H, spread, seen = np.empty((targets, 3 * platforms)), np.empty((targets, 3 * platforms, n)), 0.0, 1.0
    for e in range(count):
        predict_ahead(step[e], mean[e], P[e], scene, noise_of(e, scene), ahead, V, h, H, nn)
        own = settings[e if settings.shape[0] > 1 else 0]
        for c in range(candidates):
            view_all(c, own, rules, variance, low, high)
            out = P_out[e, c]
            for t in range(targets):
                copy_vector(ahead[t], x[e, c, t])
                copy_matrix(V[t], out[t])
                for turn in range(6 * platforms if rules.folding else 3 * platforms):
                    a = turn % (3 * platforms)
                    j, q = a // 3, a % 3
                    early = rules.folding and turn < 3 * platforms  # azimuths first, as in the tracker
                    if h[t, 3 * j] < rules.nearest or (rules.folding and early != (q == 2)):
                        continue
                    if rules.margin > 0.0:
                        spread = spread_of(q, t, V, H[t], a)
                    if rules.folding and q == 0:
                        r_variance, rdot_variance = spread_of(0, t, V, H[t], a), spread_of(1, t, V, H[t], a + 1)
                        seen = seen_one(h[t, a], h[t, a + 1], r_variance, rdot_variance, high, j, rules)
                    value = off_look(h[t, a], own[c, j, 3], q)
                    R = predicted_variance(value, spread, variance[j, q], low[j, q], high[j, q], q, fence, rules)
                    g = gain_of(q, t, out, H[t], a, v, nn)
                    s = expected_innovation(g, R, seen, width_of(q, high[j, q], rules))
                    shrink_one(t, out, v, s, nn)


@kernel
def information(step, mean, P, settings, scene, out, nn):
    """Fill out (e, c, t): tr(P C' R~^-1 C) of every target for settings (e or 1, c, p, 4)."""
    (count, candidates, targets), n, platforms = out.shape, len(nn), scene.places.shape[0]
    fence, rules = scene.fence, scene.rules
    variance, low, high = np.empty((platforms, 3)), np.empty((platforms, 3)), np.empty((platforms, 3))
    ahead, V = np.empty((targets, n)), np.empty((targets, n, n))
    h, H, off = np.empty((targets, 3 * platforms)), np.empty((targets, 3 * platforms, n)), np.empty(3 * platforms)
    for e in range(count):
        predict_ahead(step[e], mean[e], P[e], scene, noise_of(e, scene), ahead, V, h, H, nn)
        own = settings[e if settings.shape[0] > 1 else 0]
        for c in range(candidates):
            view_all(c, own, rules, variance, low, high)
            for t in range(targets):
                for a in range(len(off)):
                    off[a] = off_look(h[t, a], own[c, a // 3, 3], a % 3)
                out[e, c, t] = information_one(t, V, off, H[t], variance, low, high, fence, rules)
