"""Kernels of a target that buildings may hide: the probability that it is visible, and the update after a look.

The position is Gaussian with covariance L L'. Visibility is evaluated at the places x + L u for points u of equal
weight, ``radar.places`` (p, 2). v(u) is 1 if all sites see the place, otherwise 0. The density of the state is
multiplied by the likelihood of the look, ``base`` + ``slope`` v, and replaced by the Gaussian of the same mean and
covariance. A point represents a small Gaussian of variance ``BLUR``, so a covariance never collapses to a few points.
Shapes are those of ``kernels.py``.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.multipath_kernels import is_clear

BLUR = 0.05  # of a variance of 1: half the mean distance of 48 points, squared
UNLIKELY = 1e-9  # a look whose outcome was less probable contradicts the model and changes nothing
DOUBT = 0.1  # least weight of a place that a look contradicts, because tails matter and are not quite Gaussian
CONTRADICTED = 0.3  # weight of a place that was visible when the last look found nothing; calibrated
SHADOWED = 0.1  # weight of a place that was hidden when the last look found the target; calibrated
FLAT = 1e-12  # least share of a variance that remains in the other coordinate


@inlined
def visibility_is_predicted(radar):
    """Whether visibility is predicted, because buildings hide targets at unknown times."""
    return radar.table.clear.shape[0] > 0


@inlined
def root_one(i, P):
    """L = [[a, 0], [b, c]] of the position; returns (a, b, c)."""
    a = np.sqrt(P[i, 0, 0])
    b = P[i, 2, 0] / a
    return a, b, np.sqrt(max(P[i, 2, 2] - b * b, FLAT * P[i, 2, 2]))


@inlined
def slopes_one(i, P, k, a, b, c):
    """Regression (g, h) of element k of the state on u."""
    g = P[i, k, 0] / a
    return g, (P[i, k, 2] - b * g) / c


@inlined
def place_one(i, x, P, a, b, c, u, w, last, radar):
    """Whether the place of the point (u, w) is visible, and the weight of the point.

    ``last``: 1 if a look found the target a step ago, -1 if it found nothing, 0 if there was no look. The target is
    probably not at a place that was hidden when the look found it, or visible when the look found nothing. Such a place
    has a lower weight, although the Gaussian includes it.
    """
    px, py = x[i, 0] + a * u, x[i, 2] + b * u + c * w
    clear = is_clear(px, py, radar.table)
    if last == 0:
        return clear, 1.0
    (g, h), (m, n) = slopes_one(i, P, 1, a, b, c), slopes_one(i, P, 3, a, b, c)
    px -= radar.dt * (x[i, 1] + g * u + h * w)
    py -= radar.dt * (x[i, 3] + m * u + n * w)
    before = is_clear(px, py, radar.table)
    if last > 0:
        return clear, 1.0 if before else SHADOWED
    return clear, CONTRADICTED if before else 1.0


@kernel
def chance_one(i, x, P, last, radar, places):
    """Probability that target i is visible; ``last``: see ``place_one``."""
    a, b, c = root_one(i, P)
    visible, total = 0.0, 0.0
    for p in range(len(places)):
        clear, weight = place_one(i, x, P, a, b, c, places[p, 0], places[p, 1], last, radar)
        visible += weight if clear else 0.0
        total += weight
    return visible / total


@kernel
def sight_one(i, x, P, last, radar, sight):
    """Fill sight (6,) with the means of v, v u and v u u' over all points; returns ``chance_one``.

    After a look that found nothing, the points of v have the weights of ``place_one``, because the Gaussian represents
    that look poorly. After a look that found the target, they have equal weights, because the place is known well.
    """
    a, b, c = root_one(i, P)
    visible, total = 0.0, 0.0
    sight[:] = 0.0
    for p in range(len(radar.places)):
        u, w = radar.places[p, 0], radar.places[p, 1]
        clear, weight = place_one(i, x, P, a, b, c, u, w, last, radar)
        total += weight
        if clear:
            visible += weight
            weight = weight if last < 0 else 1.0
            sight[0] += weight
            sight[1] += weight * u
            sight[2] += weight * w
            sight[3] += weight * u * u
            sight[4] += weight * u * w
            sight[5] += weight * w * w
    for m in range(6):
        sight[m] /= len(radar.places)
    return visible / total


@inlined
def moments_of(sight, base, slope):
    """Mean (m, n) of u after a look, and its covariance minus 1, [[f, g], [g, h]]; 0 if the look changes nothing."""
    left = base + slope * sight[0]
    if sight[0] == 0.0 or sight[0] == 1.0 or not left > UNLIKELY:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    scale, own = slope / left, base / left
    m, n = scale * sight[1], scale * sight[2]
    rest = own * (1.0 - BLUR) + BLUR - 1.0  # the variance of the points, and the blur
    return m, n, rest + scale * sight[3] - m * m, scale * sight[4] - m * n, rest + scale * sight[5] - n * n


@inlined
def of_a_miss(undetected):
    """Slope of the likelihood of a look that finds nothing; ``undetected``: its probability for a visible target."""
    return max(undetected, DOUBT) - 1.0


@inlined
def condition_covariance(i, P, sight, base, slope, nn):
    """Update P[i] with a look of the likelihood base + slope v."""
    _, _, f, g, h = moments_of(sight, base, slope)
    if f == 0.0 and h == 0.0:
        return
    a, b, c = root_one(i, P)
    slopes = (
        slopes_one(i, P, 0, a, b, c), slopes_one(i, P, 1, a, b, c), slopes_one(i, P, 2, a, b, c),
        slopes_one(i, P, 3, a, b, c),
    )  # fmt: skip
    for j in range(len(nn)):
        first, second = slopes[j]
        left, right = first * f + second * g, first * g + second * h
        for k in range(j + 1):
            P[i, j, k] += left * slopes[k][0] + right * slopes[k][1]
            P[i, k, j] = P[i, j, k]


@inlined
def condition_one(i, x, P, sight, base, slope, nn):
    """Update x[i], P[i] with a look of the likelihood base + slope v."""
    m, n, _, _, _ = moments_of(sight, base, slope)
    a, b, c = root_one(i, P)
    for k in range(len(nn)):
        g, h = slopes_one(i, P, k, a, b, c)
        x[i, k] += g * m + h * n
    condition_covariance(i, P, sight, base, slope, nn)


@inlined
def condition_worth(i, P, sight, base, slope, M, nn):
    """trace(M (P[i] - P')) of ``condition_one``."""
    _, _, f, g, h = moments_of(sight, base, slope)
    if f == 0.0 and h == 0.0:
        return 0.0
    a, b, c = root_one(i, P)
    total = 0.0
    for j in range(len(nn)):
        first, second = slopes_one(i, P, j, a, b, c)
        left, right = first * f + second * g, first * g + second * h
        for k in range(len(nn)):
            there, aside = slopes_one(i, P, k, a, b, c)
            total -= M[j, k] * (left * there + right * aside)
    return total


@inlined
def drawn_place(i, x, P, draw, last, radar, d, nn):
    """Fill d (n,): a place of target i, picked by a uniform draw, minus its mean; returns whether it is visible."""
    a, b, c = root_one(i, P)
    count = len(radar.places)
    total = float(count)
    if last != 0:
        total = 0.0
        for p in range(count):
            total += place_one(i, x, P, a, b, c, radar.places[p, 0], radar.places[p, 1], last, radar)[1]
    p, left = 0, draw * total
    if last == 0:
        p = min(int(left), count - 1)
    clear, weight = place_one(i, x, P, a, b, c, radar.places[p, 0], radar.places[p, 1], last, radar)
    while last != 0 and left >= weight and p < count - 1:
        left -= weight
        p += 1
        clear, weight = place_one(i, x, P, a, b, c, radar.places[p, 0], radar.places[p, 1], last, radar)
    for k in range(len(nn)):
        g, h = slopes_one(i, P, k, a, b, c)
        d[k] = g * radar.places[p, 0] + h * radar.places[p, 1]
    return clear
