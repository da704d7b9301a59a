"""Folding: a pulse train measures range and range-rate up to whole unambiguous intervals.

A fold hypothesis is a number of whole intervals. It has a likelihood, given a Gaussian prediction; several PRFs have a
joint likelihood. If they do not resolve the fold, the measurement is ambiguous. This is not an error: the result has
the probabilities of the folds. Sources: Skolnik, Introduction to Radar Systems, 3rd ed. 2001, chapter 3; Richards,
Fundamentals of Radar Signal Processing, 2nd ed. 2014, chapter 5; the wrapped likelihood is the sum over the folds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtri

from wavegym.core.arrays import FloatArray, check_broadcast, check_each, check_elements, check_finite, check_last_axes
from wavegym.core.covariances import check_positive_definite
from wavegym.core.errors import InputError, check_int, check_non_negative, check_positive
from wavegym.sensors import folding_kernels as kernels

SIZE = 4.0
"""Standard deviations of the prediction within which folds are looked for."""

MOST_HYPOTHESES = 1_000_000
"""Greatest number of folds and detections that ``agreeing_combinations`` tries."""


class Folded(NamedTuple):
    """A folded quantity: value = apparent + fold x width."""

    apparent: FloatArray
    fold: NDArray[np.int64]


class FoldUpdate(NamedTuple):
    """A folded measurement of one quantity, given its prediction, in the form that a Kalman filter needs.

    The filter updates with ``innovation`` as with one measurement, and adds K spread K' to the updated covariance
    (moment matching, as in probabilistic data association).
    """

    log_likelihood: FloatArray  # (...) of the measurement, summed over the folds, 1/unit
    inside: NDArray[np.int64]  # (...) number of folds within the gate; 0: none, the nearest one counts alone
    fold: NDArray[np.int64]  # (...) most probable fold
    probability: FloatArray  # (...) of this fold; 1 where the measurement is not ambiguous
    innovation: FloatArray  # (...) mean of measurement + fold x width - prediction
    spread: FloatArray  # (...) variance of the innovation over the folds


class PairUpdate(NamedTuple):
    """As ``FoldUpdate``, for (range, range-rate) with correlated errors."""

    log_likelihood: FloatArray  # (...)
    inside: NDArray[np.int64]  # (...)
    fold: NDArray[np.int64]  # (..., 2)
    probability: FloatArray  # (...)
    innovation: FloatArray  # (..., 2)
    spread: FloatArray  # (..., 2, 2)


class FoldHypotheses(NamedTuple):
    """The folds of one measurement of (range, range-rate), most probable first."""

    fold: NDArray[np.int64]  # (hypothesis, 2)
    innovation: FloatArray  # (hypothesis, 2)
    probability: FloatArray  # (hypothesis,), with sum 1


class Agreements(NamedTuple):
    """Values at which detections of several PRFs agree, best first: more PRFs, then the smaller chi-square.

    With several targets, combinations of detections of different targets may agree too: ghosts.
    """

    value: FloatArray  # (combination,) weighted mean of the unfolded detections
    variance: FloatArray  # (combination,) of the mean
    detection: NDArray[np.int64]  # (combination, prf) index of the detection; -1: none of this PRF agrees
    fold: NDArray[np.int64]  # (combination, prf); 0 where there is no detection
    chi_square: FloatArray  # (combination,) weighted squares of the differences to the mean
    probability: FloatArray  # (combination,) among those with the same number of PRFs, for a uniform prior


def fold_range(range_m: ArrayLike, unambiguous_range: ArrayLike) -> Folded:
    """Apparent range in [0, c PRI/2), m, and the number of whole intervals, (...).

    Args:
        range_m: range, m, >= 0, (...).
        unambiguous_range: c PRI/2, m, > 0; inf folds nothing. ``PulseTiming.unambiguous_range``.

    Raises:
        InputError: a range that is negative or not finite, a width that is not > 0, or shapes that do not fit.
    """
    return _fold(check_elements(check_non_negative, "range_m", range_m), "unambiguous_range", unambiguous_range, 0.0)


def fold_velocity(range_rate: ArrayLike, unambiguous_velocity: ArrayLike) -> Folded:
    """Apparent range-rate in [-lambda PRF/4, lambda PRF/4), m/s, and the number of whole intervals, (...).

    Args:
        range_rate: m/s, (...).
        unambiguous_velocity: lambda PRF/2, the full interval, m/s, > 0; inf folds nothing.

    Raises:
        InputError: a range-rate that is not finite, a width that is not > 0, or shapes that do not fit.
    """
    return _fold(check_finite("range_rate", range_rate), "unambiguous_velocity", unambiguous_velocity, -0.5)


def unfold(apparent: ArrayLike, fold: ArrayLike, width: ArrayLike) -> FloatArray:
    """apparent + fold x width, (...); an infinite width has the fold 0 only.

    Raises:
        InputError: an apparent value or fold that is not finite, or a width that is not > 0.
    """
    values, number = check_finite("apparent", apparent), check_finite("fold", fold)
    values, number, interval = check_broadcast(apparent=values, fold=number, width=_width("width", width))
    return values + np.where(number == 0.0, 0.0, number * np.where(np.isinf(interval), 0.0, interval))


def fold_update(
    measurement: ArrayLike, predicted: ArrayLike, variance: ArrayLike, width: ArrayLike, size: float = SIZE
) -> FoldUpdate:
    """A folded measurement against a Gaussian prediction: likelihood, probabilities and a moment-matched innovation.

    The density of the measurement z is the sum over the folds n of N(z + n W; predicted, variance), of those within
    ``size`` standard deviations. If none is, the nearest one stands alone, and a tracker may refuse it (``inside``).

    Args:
        measurement: apparent value z, (...).
        predicted: predicted value, (...).
        variance: innovation variance S: of the prediction and of the measurement's error, > 0, (...).
        width: W, unambiguous interval, > 0, inf for none, (...).
        size: standard deviations, > 0.

    Raises:
        InputError: values that are not finite, variances, widths or a size that are not > 0, or shapes that do not fit.
    """
    z, p, s, w = check_broadcast(
        measurement=check_finite("measurement", measurement),
        predicted=check_finite("predicted", predicted),
        variance=check_elements(check_positive, "variance", variance),
        width=_width("width", width),
    )
    out = np.empty((z.size, 6))
    kernels.updates(_flat(z), _flat(p), _flat(s), _flat(w), float(check_positive("size", size)), out)
    log_likelihood, inside, fold, probability, innovation, spread = out.T.reshape(6, *z.shape)
    return FoldUpdate(log_likelihood, _whole(inside), _whole(fold), probability, innovation, spread)


def fold_pair_update(
    measurement: ArrayLike, predicted: ArrayLike, S: ArrayLike, widths: ArrayLike, size: float = SIZE
) -> PairUpdate:
    """``fold_update`` for (range, range-rate) with a full innovation covariance: folds are pairs of numbers.

    Args:
        measurement: apparent (range, range-rate), (..., 2).
        predicted: predicted (range, range-rate), (..., 2).
        S: innovation covariance, (..., 2, 2).
        widths: unambiguous (range, velocity), > 0, inf for none, (..., 2).
        size: standard deviations of the gate's ellipse, > 0.

    Raises:
        InputError: as ``fold_update``, or an S that is not symmetric positive definite.
    """
    z, p, w = _pair(measurement, predicted, widths)
    covariance = check_positive_definite("S", check_last_axes("S", S, 2, 2))
    lead = check_broadcast(z=z[..., 0], p=p[..., 0], w=w[..., 0], S=covariance[..., 0, 0])[0].shape
    z, p, w = (_flat(np.broadcast_to(array, (*lead, 2)), 2) for array in (z, p, w))
    out = np.empty((len(z), 10))
    covariance = _flat(np.broadcast_to(covariance, (*lead, 2, 2)), 2, 2)
    kernels.pair_updates(z, p, covariance, w, float(check_positive("size", size)), out)
    out = out.reshape(*lead, 10)
    return PairUpdate(
        out[..., 0],
        _whole(out[..., 1]),
        _whole(out[..., 2:4]),
        out[..., 4],
        out[..., 5:7],
        out[..., [7, 8, 8, 9]].reshape(*lead, 2, 2),
    )


def fold_hypotheses(
    measurement: ArrayLike, predicted: ArrayLike, S: ArrayLike, widths: ArrayLike, size: float = SIZE
) -> FoldHypotheses:
    """The folds of one measurement with their innovations and probabilities, for trackers that keep several.

    Arguments and errors: those of ``fold_pair_update`` without leading axes.
    """
    z, p, w = _pair(measurement, predicted, widths)
    covariance = check_positive_definite("S", check_last_axes("S", S, 2, 2))
    if z.ndim != 1 or p.ndim != 1 or w.ndim != 1 or covariance.ndim != 2:
        shapes = f"{z.shape}, {p.shape}, {covariance.shape} and {w.shape}"
        raise InputError(
            f"measurement, predicted, S and widths have shapes {shapes}, expected (2,), (2,), (2, 2), (2,)"
        )
    check_positive("size", size)
    arguments = (*z, *p, covariance[0, 0], covariance[1, 0], covariance[1, 1], *w, float(size))
    count = max(int(kernels.fold_pair_one(*arguments, np.empty((0, 3)))[1]), 1)
    listed = np.empty((count, 3))
    kernels.fold_pair_one(*arguments, listed)
    listed = listed[np.argsort(-listed[:, 2], kind="stable")]
    fold = _whole(listed[:, :2])
    return FoldHypotheses(fold, unfold(z, fold, w) - p, listed[:, 2])


def agreeing_combinations(
    apparent: Sequence[ArrayLike],
    widths: ArrayLike,
    variance: ArrayLike,
    low: float,
    high: float,
    needed: int | None = None,
    gate_probability: float = 0.9999,
) -> Agreements:
    """Values at which unfolded detections of several PRFs agree: true targets and ghosts.

    Every fold of every detection is a candidate. Of each other PRF the nearest unfolded detection joins if it agrees. A
    combination counts if the chi-square of its differences is within the quantile ``gate_probability`` of its degrees
    of freedom, the number of PRFs minus one. For one detection of each PRF this is the maximum likelihood over fold
    numbers. Without noise it is the Chinese remainder theorem, for any widths, integer ratios or not.

    Args:
        apparent: apparent values of the detections of each PRF, a sequence of (detection,).
        widths: unambiguous interval of each PRF, > 0 and finite, (prf,).
        variance: of a detection's error, by PRF, > 0, (prf,).
        low, high: interval in which values are looked for.
        needed: number of PRFs that have to agree, default all. Fewer allow for blind zones.
        gate_probability: probability that the detections of a target agree, in (0, 1).

    Raises:
        InputError: values out of range, shapes that do not fit, or more than a million candidates.
    """
    detections = [np.atleast_1d(check_finite("apparent", values)) for values in apparent]
    interval = np.atleast_1d(check_elements(check_positive, "widths", widths))
    variances = np.atleast_1d(check_elements(check_positive, "variance", variance))
    count = len(detections)
    for name, array in (("widths", interval), ("variance", variances)):
        if array.shape != (count,):
            raise InputError(f"{name} has shape {array.shape}, expected one for each of the {count} PRFs, ({count},)")
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise InputError(f"(low, high) is ({low!r}, {high!r}), expected low < high, both finite")
    least = count if needed is None else check_int("needed", needed, 1)
    if least > count:
        raise InputError(f"needed is {needed!r}, expected at most the number of PRFs (nearest: {count})")
    if not 0.0 < gate_probability < 1.0:
        raise InputError(f"gate_probability is {gate_probability!r}, expected a probability above 0 and below 1")
    quantiles = np.array([0.0, *(chdtri(n, 1.0 - gate_probability) for n in range(1, count))])  # by PRFs less one
    candidates = _candidates(detections[: count - least + 1], interval, low, high)
    found = _combine(candidates, detections, interval, variances, quantiles[-1] if count > 1 else 0.0)
    return _best(*found, interval, variances, detections, quantiles, least, (low, high))


def resolve_folds(
    apparent: ArrayLike,
    widths: ArrayLike,
    variance: ArrayLike,
    low: float,
    high: float,
    gate_probability: float = 0.9999,
) -> Agreements:
    """The values that one detection of each PRF allows, most probable first.

    The measurement is resolved if ``probability[0]`` is near 1. Otherwise it is ambiguous, with these probabilities. No
    row: the detections do not belong together.

    Args:
        apparent: apparent value of each PRF, (prf,).
        widths, variance, low, high, gate_probability: see ``agreeing_combinations``.

    Raises:
        InputError: as ``agreeing_combinations``.
    """
    values = check_finite("apparent", apparent)
    if values.ndim != 1:
        raise InputError(f"apparent has shape {values.shape}, expected one value of each PRF, (prf,)")
    return agreeing_combinations(list(values), widths, variance, low, high, gate_probability=gate_probability)


def combined_interval(widths: ArrayLike, tolerance: float, farthest: float) -> float:
    """The shortest distance at which all PRFs fold two values together, within ``tolerance``; inf beyond ``farthest``.

    For widths that are whole multiples of a cell and a tolerance below it, this is their least common multiple. It is
    the unambiguous interval of the PRFs together.

    Args:
        widths: unambiguous interval of each PRF, > 0 and finite, (prf,).
        tolerance: differences that pass as noise, >= 0.
        farthest: distance up to which is searched.

    Raises:
        InputError: a width that is not a finite number > 0, a tolerance or distance out of range.
    """
    interval = np.atleast_1d(check_elements(check_positive, "widths", widths))
    check_non_negative("tolerance", tolerance)
    check_positive("farthest", farthest)
    longest = float(interval.max())
    if farthest / longest > MOST_HYPOTHESES:
        raise InputError(
            f"farthest is {farthest!r}, expected at most {MOST_HYPOTHESES * longest:g}, a million intervals"
        )
    multiples = longest * np.arange(1, math.floor(farthest / longest * (1 + 1e-12)) + 1)
    apart = np.abs(_centred(multiples[:, None].astype(np.float64), interval)).max(axis=-1)
    agree = np.flatnonzero(apart <= tolerance + 1e-9 * longest)
    return float(multiples[agree[0]]) if len(agree) else math.inf


def outside_notch(range_rate: ArrayLike, unambiguous_velocity: ArrayLike, notch: ArrayLike) -> NDArray[np.bool_]:
    """Whether a target's folded speed lies beyond the clutter notch, so that it is seen, (...).

    Args:
        range_rate: m/s, (...).
        unambiguous_velocity: lambda PRF/2, m/s, > 0; inf: one notch, around 0.
        notch: half the notch's width, m/s, >= 0.

    Raises:
        InputError: values out of range, or shapes that do not fit.
    """
    half = check_elements(check_non_negative, "notch", notch)
    return np.asarray(np.abs(fold_velocity(range_rate, unambiguous_velocity).apparent) > half)


def outside_notch_probability(
    predicted: ArrayLike, variance: ArrayLike, unambiguous_velocity: ArrayLike, notch: ArrayLike
) -> FloatArray:
    """The probability that a target of Gaussian range-rate is beyond the clutter notch of its fold, in [0, 1], (...).

    Args:
        predicted: mean range-rate, m/s, (...).
        variance: of the range-rate, m^2/s^2, >= 0, (...).
        unambiguous_velocity: lambda PRF/2, m/s, > 0; inf: one notch, around 0.
        notch: half the notch's width, m/s, >= 0, less than half the unambiguous velocity.

    Raises:
        InputError: values out of range, or shapes that do not fit.
    """
    p, s, w, half = check_broadcast(
        predicted=check_finite("predicted", predicted),
        variance=check_elements(check_non_negative, "variance", variance),
        unambiguous_velocity=_width("unambiguous_velocity", unambiguous_velocity),
        notch=check_elements(check_non_negative, "notch", notch),
    )
    check_each("notch", half, 2.0 * half <= w, "at most half the unambiguous velocity")
    return kernels.outside_notch(p, s, w, half)


def _fold(values: FloatArray, name: str, width: ArrayLike, low: float) -> Folded:
    interval = _width(name, width)
    check_broadcast(values=values, **{name: interval})
    begin = np.where(np.isinf(interval), 0.0, low * np.where(np.isinf(interval), 1.0, interval))
    apparent, fold = kernels.fold(values, interval, begin)
    return Folded(apparent, _whole(fold))


def _width(name: str, width: ArrayLike) -> FloatArray:
    """``width`` as an array of numbers > 0, inf allowed."""
    array = np.asarray(width, dtype=np.float64)
    check_each(name, array, array > 0.0, "a number > 0, or inf where nothing folds")
    return array


def _pair(measurement: ArrayLike, predicted: ArrayLike, widths: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    z, p = check_finite("measurement", measurement, 2), check_finite("predicted", predicted, 2)
    return z, p, _width("widths", check_last_axes("widths", widths, 2))


def _candidates(detections: Sequence[FloatArray], widths: FloatArray, low: float, high: float) -> FloatArray:
    """All unfolded values in [low, high] of the given PRFs' detections."""
    expected = sum(len(z) * (high - low) / width for z, width in zip(detections, widths, strict=False))
    if expected > MOST_HYPOTHESES:
        raise InputError(f"(low, high) holds {expected:.3g} folds, expected at most {MOST_HYPOTHESES:,}: narrow it")
    parts = [np.empty(0)]
    for values, width in zip(detections, widths, strict=False):
        for z in values:
            folds = np.arange(math.ceil((low - z) / width), math.floor((high - z) / width) + 1)
            parts.append(z + folds * width)
    return np.concatenate(parts)


def _centred(difference: FloatArray, width: FloatArray | float) -> FloatArray:
    """``difference`` minus the nearest multiple of ``width``."""
    return difference - width * np.rint(difference / width)


def _combine(
    candidates: FloatArray, detections: Sequence[FloatArray], widths: FloatArray, variances: FloatArray, limit: float
) -> tuple[NDArray[np.int64], FloatArray]:
    """Nearest detection of each PRF, -1 where none agrees, and its unfolded value, both (candidate, prf)."""
    chosen = np.full((len(candidates), len(detections)), -1)
    values = np.zeros(chosen.shape)
    rows = np.arange(len(candidates))
    for i, z in enumerate(detections):
        if len(z) and len(rows):
            apart = _centred(candidates[:, None] - z, float(widths[i]))
            best = np.abs(apart).argmin(axis=1)
            off = apart[rows, best]
            # A candidate is a noisy detection itself.
            agrees = off * off <= limit * (variances[i] + variances.max())
            chosen[:, i] = np.where(agrees | (off == 0.0), best, -1)
            values[:, i] = candidates - off
    return chosen, values


def _best(
    chosen: NDArray[np.int64],
    values: FloatArray,
    widths: FloatArray,
    variances: FloatArray,
    detections: Sequence[FloatArray],
    quantiles: FloatArray,
    least: int,
    bounds: tuple[float, float],
) -> Agreements:
    """Drop what does not agree or is found twice; sort the rest."""
    seen = chosen >= 0
    weights = seen / variances
    total = np.maximum(weights.sum(axis=1), np.finfo(np.float64).tiny)
    mean = (weights * values).sum(axis=1) / total
    chi_square = (weights * (values - mean[:, None]) ** 2).sum(axis=1)
    number = seen.sum(axis=1)
    good = (number >= least) & (chi_square <= quantiles[np.maximum(number - 1, 0)] + 1e-12)
    good &= (mean >= bounds[0]) & (mean <= bounds[1])
    apparent = np.stack(
        [z[c] if len(z) else np.zeros(len(c)) for z, c in zip(detections, chosen.T, strict=True)], axis=1
    )
    fold = _whole(np.where(seen, np.rint((values - apparent) / widths), 0.0))
    order = np.lexsort((chi_square, -number))
    order = order[good[order]]
    _, first = np.unique(np.concatenate([chosen[order], fold[order]], axis=1), axis=0, return_index=True)
    order = order[np.sort(first)]
    likelihood = np.exp(-0.5 * chi_square[order])
    alike = number[order][:, None] == number[order]
    probability = likelihood / np.maximum((alike * likelihood).sum(axis=1), np.finfo(np.float64).tiny)
    return Agreements(mean[order], 1.0 / total[order], chosen[order], fold[order], chi_square[order], probability)


def _flat(array: FloatArray, *core: int) -> FloatArray:
    """A writeable contiguous copy with one leading axis."""
    return np.array(array, order="C").reshape(-1, *core)


def _whole(array: FloatArray) -> NDArray[np.int64]:
    return np.rint(array).astype(np.int64)
