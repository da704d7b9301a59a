"""Compiled folded measurements; ``folding.py`` has the public functions.

A quantity is measured up to multiples of the unambiguous interval W: z = value - n W. With W = inf nothing folds.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import math

import numpy as np

from wavegym.core.kernels import batched, inlined, kernel

MOST_FOLDS = 1000.0
"""Folds on each side of the prediction beyond which nothing is looked for."""
LOG_TWO_PI = np.log(2.0 * np.pi)
FARTHEST = 8.0  # standard deviations; 1e-15 of a Gaussian lies outside


@inlined
def fold_of(value, width, low):
    """n such that value - n W lies in [low, low + W); 0 for W = inf."""
    return 0.0 if np.isinf(width) else np.floor((value - low) / width)


@inlined
def apparent(value, width, low):
    """The folded value, in [low, low + W)."""
    if np.isinf(width):
        return value
    z = value - fold_of(value, width, low) * width
    return low if z >= low + width else max(z, low)  # rounding


@inlined
def nearest_fold(difference, width):
    """n for which n W is nearest to ``difference``."""
    return 0.0 if np.isinf(width) else np.rint(difference / width)


@inlined
def shifted(n, width):
    """n W, also for n = 0 and W = inf."""
    return 0.0 if n == 0.0 else n * width


@kernel
def fold_update_one(z, predicted, variance, width, size):
    """(log likelihood, number of folds within ``size``, best fold, its probability, innovation, spread).

    A Gaussian prediction, wrapped over the folds within ``size`` standard deviations; at least the nearest one counts.
    """
    first = nearest_fold(predicted - z, width)
    reach = size * np.sqrt(variance)
    inside, best = 0.0, first
    y0 = z + shifted(first, width) - predicted
    total, mean, square = 1.0, 0.0, 0.0  # relative to the nearest one
    if abs(y0) <= reach:
        inside = 1.0
        if not np.isinf(width):
            low = max(np.ceil((predicted - reach - z) / width), first - MOST_FOLDS)
            high = min(np.floor((predicted + reach - z) / width), first + MOST_FOLDS)
            n = low
            while n <= high:
                if n != first:
                    d = (n - first) * width
                    weight = np.exp(-0.5 * d * (2.0 * y0 + d) / variance)
                    total += weight
                    mean += weight * d
                    square += weight * d * d
                    inside += 1.0
                n += 1.0
    mean /= total
    spread = max(square / total - mean * mean, 0.0)
    log_likelihood = np.log(total) - 0.5 * (y0 * y0 / variance + np.log(variance) + LOG_TWO_PI)
    return log_likelihood, inside, best, 1.0 / total, y0 + mean, spread


@inlined
def certain_reach(variance, width, size):
    """Innovation up to which the next fold is at least exp(size^2 / 2) times less likely; negative if W < size sigma.

    If the innovation is y, that of the next fold is W - |y|: (W - |y|)^2 - y^2 >= size^2 variance.
    """
    return 0.5 * (width - size * size * variance / width)


@inlined
def certain_fold_one(variance, width, size):
    """The probability that a Gaussian prediction's innovation stays within ``certain_reach``."""
    reach = certain_reach(variance, width, size)
    return math.erf(reach / np.sqrt(2.0 * variance)) if reach > 0.0 else 0.0


@inlined
def rows(y0, y1, S00, S01, S11, W1, radius):
    """First and last fold of the second quantity within ``radius``."""
    reach = radius * np.sqrt(S11)
    if np.isinf(W1):
        return 0.0, 0.0
    near = np.rint(-y1 / W1)
    return max(np.ceil((-y1 - reach) / W1), near - MOST_FOLDS), min(np.floor((-y1 + reach) / W1), near + MOST_FOLDS)


@inlined
def row(y0, w, S00, S01, S11, W0, radius):
    """First and last fold of the first quantity within ``radius``, if the innovation of the second is w."""
    centre = S01 / S11 * w - y0  # the ideal n W0
    if np.isinf(W0):
        return 0.0, 0.0
    reach = np.sqrt(max((radius * radius - w * w / S11) * (S00 - S01 * S01 / S11), 0.0))
    near = np.rint(centre / W0)
    return max(np.ceil((centre - reach) / W0), near - MOST_FOLDS), min(
        np.floor((centre + reach) / W0), near + MOST_FOLDS
    )


@inlined
def distance(v, w, S00, S01, S11):
    """Squared Mahalanobis distance of the innovation (v, w)."""
    u = v - S01 / S11 * w
    return u * u / (S00 - S01 * S01 / S11) + w * w / S11


@kernel
def nearest_pair(y0, y1, S00, S01, S11, W0, W1):
    """(folds of both quantities, squared distance) of the hypothesis with the least distance.

    The first guess rounds one quantity after the other. Nearer folds lie in the ellipse through this guess.
    """
    j0 = nearest_fold(-y1, W1)
    w = y1 + shifted(j0, W1)
    i0 = nearest_fold(S01 / S11 * w - y0, W0)
    least = distance(y0 + shifted(i0, W0), w, S00, S01, S11)
    radius = np.sqrt(least) * (1.0 + 1e-12)
    first, last = rows(y0, y1, S00, S01, S11, W1, radius)
    j = first
    while j <= last:
        w = y1 + shifted(j, W1)
        i = nearest_fold(S01 / S11 * w - y0, W0)
        d = distance(y0 + shifted(i, W0), w, S00, S01, S11)
        if d < least:
            i0, j0, least = i, j, d
        j += 1.0
    return i0, j0, least


@kernel
def fold_pair_one(z0, z1, p0, p1, S00, S01, S11, W0, W1, size, out):
    """``fold_update_one`` of two correlated quantities; list the folds and their weights in out (capacity, 3).

    Returns (log likelihood, inside, i, j, probability, y0, y1, C00, C01, C11): the best folds, the mean innovation and
    the spread of the innovations. A capacity of 0 lists nothing; otherwise the weights (third column) become
    probabilities of all hypotheses.
    """
    y0, y1 = z0 - p0, z1 - p1
    i0, j0, least = nearest_pair(y0, y1, S00, S01, S11, W0, W1)
    v0, w0 = y0 + shifted(i0, W0), y1 + shifted(j0, W1)
    total, inside = 1.0, 0.0
    m0, m1, q00, q01, q11 = 0.0, 0.0, 0.0, 0.0, 0.0
    capacity = len(out)
    if capacity > 0:
        out[0, 0], out[0, 1], out[0, 2] = i0, j0, 1.0
    if least <= size * size:
        inside = 1.0
        first, last = rows(y0, y1, S00, S01, S11, W1, size)
        j = first
        while j <= last:
            w = y1 + shifted(j, W1)
            i, high = row(y0, w, S00, S01, S11, W0, size)
            while i <= high:
                v = y0 + shifted(i, W0)
                d = distance(v, w, S00, S01, S11)
                if d <= size * size and not (i == i0 and j == j0):
                    weight = np.exp(0.5 * (least - d))
                    a, b = v - v0, w - w0
                    if inside < capacity:
                        k = int(inside)
                        out[k, 0], out[k, 1], out[k, 2] = i, j, weight
                    total += weight
                    inside += 1.0
                    m0 += weight * a
                    m1 += weight * b
                    q00 += weight * a * a
                    q01 += weight * a * b
                    q11 += weight * b * b
                i += 1.0
            j += 1.0
    one = 1.0 / total
    for k in range(min(capacity, max(int(inside), 1))):
        out[k, 2] *= one
    m0, m1 = m0 * one, m1 * one
    determinant = S00 * S11 - S01 * S01
    log_likelihood = np.log(total) - 0.5 * (least + np.log(determinant)) - LOG_TWO_PI
    spread = max(q00 * one - m0 * m0, 0.0), q01 * one - m0 * m1, max(q11 * one - m1 * m1, 0.0)
    return log_likelihood, inside, i0, j0, one, v0 + m0, w0 + m1, spread[0], spread[1], spread[2]


@inlined
def below(x, mean, deviation):
    """The probability of a Gaussian below x."""
    return 0.5 * math.erfc((mean - x) / (deviation * 1.4142135623730951))


@inlined
def outside_notch_one(predicted, variance, width, notch):
    """The probability that a Gaussian range-rate folds to a speed beyond the notch."""
    deviation = np.sqrt(variance)
    if deviation == 0.0:
        return 1.0 if abs(apparent(predicted, width, -0.5 * width)) > notch else 0.0
    if np.isinf(width):
        return 1.0 - (below(notch, predicted, deviation) - below(-notch, predicted, deviation))
    if deviation > 10.0 * width:  # uniform in the interval, to rounding
        return 1.0 - 2.0 * notch / width
    middle = np.rint(predicted / width)
    folds = np.ceil(FARTHEST * deviation / width) + 1.0
    hidden = 0.0
    n = middle - folds
    while n <= middle + folds:
        centre = n * width
        hidden += below(centre + notch, predicted, deviation) - below(centre - notch, predicted, deviation)
        n += 1.0
    return min(max(1.0 - hidden, 0.0), 1.0)


@batched("(),(),()->(),()")
def fold(value, width, low, folded, number):
    """apparent and fold_of, element by element."""
    for e in range(len(value)):
        folded[e] = apparent(value[e], width[e], low[e])
        number[e] = 0.0 if np.isinf(width[e]) else np.rint((value[e] - folded[e]) / width[e])


@kernel
def updates(z, predicted, variance, width, size, out):
    """fold_update_one, element by element: out (e, 6)."""
    for e in range(len(out)):
        out[e, 0], out[e, 1], out[e, 2], out[e, 3], out[e, 4], out[e, 5] = fold_update_one(
            z[e], predicted[e], variance[e], width[e], size
        )


@kernel
def pair_updates(z, predicted, S, width, size, out):
    """fold_pair_one, element by element: out (e, 10)."""
    none = np.empty((0, 3))
    for e in range(len(out)):
        result = fold_pair_one(
            z[e, 0], z[e, 1], predicted[e, 0], predicted[e, 1], S[e, 0, 0], S[e, 1, 0], S[e, 1, 1],
            width[e, 0], width[e, 1], size, none,
        )  # fmt: skip
        for i in range(10):
            out[e, i] = result[i]


@batched("(),(),(),()->()")
def outside_notch(predicted, variance, width, notch, out):
    """outside_notch_one, element by element."""
    for e in range(len(out)):
        out[e] = outside_notch_one(predicted[e], variance[e], width[e], notch[e])
