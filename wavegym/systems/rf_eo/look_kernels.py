"""What the platforms see of a predicted target, in compiled form: quantities, their spread, predicted variances.

Shapes: e environments, t targets, p platforms, a = 3 p quantities, (r, rdot, azimuth) of platform after platform.
``settings`` (e, p, 3): PRF, bandwidth and pixel angle; variance, low and high (p, 3): variances and field of
view of one environment's settings. ``places`` (p, 3): positions and look directions; ``fence`` (2, 3): sharpness and
height of the penalties; ``rules``: the scalars of ``Rules``.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.kernels import inlined
from wavegym.sensors.platform_kernels import penalty_one, polar, polar_rows, view_one, wrapped
from wavegym.trackers.polar_kernels import state_gradient, state_point
from wavegym.trackers.rank_one_kernels import gain_one, spread_one

PLACE = (0, 2)  # elements of [x xdot y ydot] that range and azimuth depend on
ALL = (0, 1, 2, 3)  # elements that the range-rate depends on


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
def look_polar(i, p, places, rules, h, H):
    """As ``look_one`` for the state p[i] = [r, rdot, azimuth, v] about the first platform (``polar_kernels``)."""
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
