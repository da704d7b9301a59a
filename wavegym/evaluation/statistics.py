"""Estimates with bootstrap intervals, from the costs of (training seed, world) pairs.

Every policy met the same worlds, and an agent may have several training runs, its *members*: results are a matrix
(member, world), with one row for a scheduler. Worlds differ far more than policies do, so policies are compared in
pairs: a resample of worlds is the same for all. If there are several members, the claim is about the training and not
about these networks. The interval over worlds, for the mean of these members, is then widened by the interval over
training runs, Student's t of their figures in all worlds: distances from the estimate add in squares. Where the
reference has several members, too, so do those of its own interval. Ratios are widened on the logarithmic scale. With
few members a bootstrap over them would be too narrow. Independent (member, world) episodes would miss that members
share worlds.

Intervals are bias-corrected and accelerated (BCa), because costs have a heavy right tail, for which percentile
intervals are too low.

Where an estimate is undefined, its value is None, never NaN. Examples are an interval from a single world, a ratio to a
cost of 0, a geometric mean with a cost that is not positive, and a score if random and myopic cost the same. Identical
values have an interval of width 0.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from functools import partial
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
    return Difference(*(_against(ratio, values, baseline, rng) for ratio in (_log_of_means, _mean_of_logs)))


def _against(ratio: Callable[..., Array], values: Array, baseline: Array, rng: np.random.Generator) -> Estimate:
    """The ratio to the baseline less 1, in per cent, from a function for its logarithm."""
    members, worlds = (np.arange(count) for count in values.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        alone = np.array([ratio(values, one[None], members, worlds) for one in baseline])
    found = _estimate(partial(ratio, values, baseline), values.shape, rng, _reach(alone))
    value, ci = (None if each is None else 100.0 * np.expm1(each) for each in found)
    return Estimate(None if value is None else float(value), None if ci is None else (float(ci[0]), float(ci[1])))


def _log_of_means(values: Array, baseline: Array, members: Array, worlds: Array) -> Array:
    means = _resampled(values, members, worlds).mean(axis=(-2, -1))
    return np.log(means / baseline.mean(axis=0)[worlds].mean(axis=-1))


def _mean_of_logs(values: Array, baseline: Array, members: Array, worlds: Array) -> Array:
    return _resampled(_log_ratios(values, baseline), members, worlds).mean(axis=(-2, -1))


def _log_ratios(values: Array, baseline: Array) -> Array:
    """(member, world), against the geometric mean of the baseline's members; NaN unless all are positive and finite."""
    if not all((costs > 0).all() and np.isfinite(costs).all() for costs in (values, baseline)):
        return np.full(values.shape, np.nan)
    return np.log(values) - np.log(baseline).mean(axis=0)


def p_value(values: Array, baseline: Array) -> float | None:
    """Two-sided p-value of the hypothesis that the geometric mean of the ratios of ``difference`` is 1.

    Student's t, with the variances over worlds, over members and over members of the baseline added (Welch and
    Satterthwaite's degrees of freedom). None where ``difference`` has no geometric figure, or a single world.
    """
    from scipy.stats import t

    logarithms = _log_ratios(values, baseline)
    middle = logarithms.mean()
    if np.isnan(middle) or values.shape[1] == 1:
        return None
    of_reference = [_log_ratios(values, one[None]).mean() for one in baseline]
    parts = [
        (np.var(each, ddof=1) / len(each), len(each) - 1)
        for each in (logarithms.mean(axis=0), logarithms.mean(axis=1), of_reference)
        if len(each) > 1
    ]
    total = sum(variance for variance, _ in parts)
    if total == 0.0:
        return float(middle == 0.0)
    freedom = total**2 / sum(variance**2 / count for variance, count in parts)
    return float(2.0 * t.sf(abs(middle) / np.sqrt(total), freedom))


def established(p_values: Sequence[float | None]) -> list[bool]:
    """Which hypotheses of a family are rejected at 5 %, by Holm's step-down procedure (1979); None is none of them."""
    tested = sorted((p, i) for i, p in enumerate(p_values) if p is not None)
    rejected = [False] * len(p_values)
    for rank, (p, i) in enumerate(tested):
        if p > (1.0 - LEVEL) / (len(tested) - rank):
            break
        rejected[i] = True
    return rejected


def score(cost: float | None, random: float | None, baseline: float | None) -> float | None:
    """Mean costs on a scale where random choice is 0 and the baseline 1; None where that is undefined."""
    if cost is None or random is None or baseline is None or random == baseline:
        return None
    return finite((random - cost) / (random - baseline))


def _resampled(values: Array, members: Array, worlds: Array) -> Array:
    return values[members[..., :, None], worlds[..., None, :]]


def _estimate(statistic: Statistic, shape: tuple[int, ...], rng: np.random.Generator, reach: float = 0.0) -> Estimate:
    """The statistic of all members and worlds, and its interval; ``reach``: half the width of another part of it."""
    members, worlds = (np.arange(count) for count in shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = finite(statistic(members, worlds))
        if value is None or len(worlds) == 1:
            return Estimate(value, None)
        alone = statistic(members[:, None], np.broadcast_to(worlds, shape))
        ends = _over_worlds(partial(statistic, members), worlds, rng, max(1, NUMBERS // math.prod(shape)))
    if reach := math.hypot(_reach(alone), reach):
        outwards = np.array([-1.0, 1.0])
        ends = value + outwards * np.hypot(np.maximum(outwards * (ends - value), 0.0), reach)
    return Estimate(value, (float(ends[0]), float(ends[1])) if np.isfinite(ends).all() else None)


def _over_worlds(statistic: Callable[[Array], Array], worlds: Array, rng: np.random.Generator, batch: int) -> Array:
    """Ends of the BCa interval, of that of percentiles where BCa is undefined; ``batch`` resamples at a time."""
    from scipy.stats import bootstrap  # half a second, which worker processes and training runs do not need

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "degenerate distribution": answered below
        result = bootstrap(
            (worlds,),
            lambda worlds, axis=-1: statistic(worlds),
            n_resamples=RESAMPLES,
            batch=batch,
            vectorized=True,
            confidence_level=LEVEL,
            method="BCa",
            random_state=rng,
        )
    ends = np.array(result.confidence_interval)
    if np.isfinite(ends).all():
        return ends
    return np.quantile(result.bootstrap_distribution, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])


def _reach(alone: Array) -> float:
    """Half the width of Student's interval of the mean of the members' own figures (member,); 0 for one of them."""
    from scipy.stats import t

    count = len(alone)
    return 0.0 if count == 1 else float(t.ppf((1 + LEVEL) / 2, count - 1) * alone.std(ddof=1) / np.sqrt(count))


def finite(value: Any) -> float | None:
    """A number, or None where it is not finite."""
    return float(value) if np.isfinite(value) else None
