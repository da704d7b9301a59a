"""Estimates with bootstrap intervals, from the costs of (training seed, world) pairs.

Every policy met the same worlds, and an agent may have several training runs, its *members*: results are a matrix
(member, world), with one row for a scheduler. Worlds differ far more than policies do, so policies are compared in
pairs: a resample of worlds is the same for all. If there are several members, they are resampled too (the two axes
independently; Owen 2007, "The pigeonhole bootstrap"), because the claim is about the training and not about these
networks. With fixed members the spread between training runs would be missing. With independent (member, world)
episodes it would be missing that members share worlds. Both would make intervals too narrow. With three training seeds
the interval over seeds is still too narrow: read it together with the spread of the seeds.

Intervals are bias-corrected and accelerated (BCa), because costs have a heavy right tail, for which percentile
intervals are too low.

Without an estimate the value is None, never NaN. Examples are an interval from a single world, a ratio to a cost of 0,
a geometric mean with a cost that is not positive, and a score if random and myopic cost the same. Identical values have
an interval of width 0.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from wavegym.core.arrays import Array

Interval = tuple[float, float]
Statistic = Callable[[Array, Array], Array]  # (member indices (..., m), world indices (..., n)) -> (...)

LEVEL = 0.95
RESAMPLES = 2000
NUMBERS = 2_000_000  # resampled values held at a time


class Estimate(NamedTuple):
    """A number and its 95 % interval."""

    value: float | None
    ci: Interval | None


class Difference(NamedTuple):
    """A policy's cost against the baseline's on the same worlds; negative = cheaper."""

    percent: Estimate  # of the means
    geometric: Estimate  # geometric mean of the ratios, as percent: each world counts alike, however costly


def mean(values: Array, rng: np.random.Generator) -> Estimate:
    """The mean of ``values`` (member, world)."""
    return _estimate(lambda m, w: _resampled(values, m, w).mean(axis=(-2, -1)), values.shape, rng)


def ratio(values: Array, others: Array, rng: np.random.Generator) -> Estimate:
    """The mean of ``values`` over that of ``others``, (member, world) both, of the episodes that have both numbers."""
    counted = np.isfinite(values) & np.isfinite(others)
    above, below = np.where(counted, values, 0.0), np.where(counted, others, 0.0)

    def statistic(members: Array, worlds: Array) -> Array:
        resampled = (_resampled(each, members, worlds).sum(axis=(-2, -1)) for each in (above, below))
        return np.divide(*resampled)

    return _estimate(statistic, values.shape, rng)


def of_worlds(statistic: Callable[[Array], Array], count: int, rng: np.random.Generator) -> Estimate:
    """Any ``statistic`` of the indices of this number of worlds, (..., world) -> (...)."""
    return _estimate(lambda members, worlds: statistic(worlds), (1, count), rng)


def interquartile_mean(values: Array) -> float | None:
    """The mean of the middle half of all episodes: a quarter (rounded down) is left out at each end."""
    ordered = np.sort(values, axis=None)
    cut = len(ordered) // 4
    return finite(ordered[cut : len(ordered) - cut].mean())


def difference(values: Array, baseline: Array, rng: np.random.Generator) -> Difference:
    """``values`` (member, world) against the mean of the ``baseline``'s members (member, world) on the same worlds.

    For the geometric figure this is their geometric mean, so that members against themselves are level.
    """
    reference = baseline.mean(axis=0)

    def percent(members: Array, worlds: Array) -> Array:
        ratio = _resampled(values, members, worlds).mean(axis=(-2, -1)) / reference[worlds].mean(axis=-1)
        return 100.0 * (ratio - 1.0)

    def geometric(members: Array, worlds: Array) -> Array:
        return 100.0 * np.expm1(_resampled(logarithms, members, worlds).mean(axis=(-2, -1)))

    comparable = all((costs > 0).all() and np.isfinite(costs).all() for costs in (values, baseline))
    logarithms = np.log(values) - np.log(baseline).mean(axis=0) if comparable else np.full(values.shape, np.nan)
    return Difference(_estimate(percent, values.shape, rng), _estimate(geometric, values.shape, rng))


def score(cost: float | None, random: float | None, baseline: float | None) -> float | None:
    """Mean costs on a scale where random choice is 0 and the baseline 1; None where that is undefined."""
    if cost is None or random is None or baseline is None or random == baseline:
        return None
    return finite((random - cost) / (random - baseline))


def _resampled(values: Array, members: Array, worlds: Array) -> Array:
    return values[members[..., :, None], worlds[..., None, :]]


def _estimate(statistic: Statistic, shape: tuple[int, ...], rng: np.random.Generator) -> Estimate:
    """The statistic of all members and worlds, and its interval."""
    members, worlds = (np.arange(count) for count in shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = finite(statistic(members, worlds))
    if value is None or len(worlds) == 1:
        return Estimate(value, None)
    return Estimate(value, _interval(statistic, members, worlds, rng))


def _interval(statistic: Statistic, members: Array, worlds: Array, rng: np.random.Generator) -> Interval | None:
    """BCa interval, resampling worlds, and members where there are several; percentiles where BCa is undefined."""
    from scipy.stats import bootstrap  # half a second, which worker processes and training runs do not need

    def of_worlds(worlds: Array, axis: int = -1) -> Array:
        return statistic(members, worlds)

    def of_both(members: Array, worlds: Array, axis: int = -1) -> Array:
        return statistic(members, worlds)

    with warnings.catch_warnings(), np.errstate(divide="ignore", invalid="ignore"):
        warnings.simplefilter("ignore")  # "degenerate distribution": answered below
        result = bootstrap(
            (worlds,) if len(members) == 1 else (members, worlds),
            of_worlds if len(members) == 1 else of_both,
            n_resamples=RESAMPLES,
            batch=max(1, NUMBERS // (len(members) * len(worlds))),
            vectorized=True,
            confidence_level=LEVEL,
            method="BCa",
            random_state=rng,
        )
    ends = np.array(result.confidence_interval)
    if not np.isfinite(ends).all():
        ends = np.quantile(result.bootstrap_distribution, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return (float(ends[0]), float(ends[1])) if np.isfinite(ends).all() else None


def finite(value: Any) -> float | None:
    """A number, or None where it is not finite."""
    return float(value) if np.isfinite(value) else None
