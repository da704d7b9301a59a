"""One figure for a whole suite: costs of a policy against the best heuristic over many environments.

All figures use the logarithm of the cost ratio in a world. If a policy does not play an environment, the best heuristic
counts there: it is what a user would take instead. Agarwal et al. (2021), "Deep reinforcement learning at the edge of
the statistical precipice", give the reasons for the interquartile mean, the probability of improvement and the
performance profile.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.evaluation import statistics
from wavegym.evaluation.statistics import Estimate


class SuiteScore(NamedTuple):
    """The figures of a policy over a suite; a negative percentage is cheaper than the best heuristic."""

    mean: Estimate  # geometric mean of the ratios over worlds and environments, per cent
    interquartile: Estimate  # the same of the middle half of all (environment, world)
    improvement: Estimate  # probability of a lower cost in a random world of a random environment; a tie counts half


def suite_score(logs: Mapping[str, Array], suite: list[str], rng: np.random.Generator) -> SuiteScore:
    """The figures, with intervals over worlds.

    Args:
        logs: by environment, ln(cost / cost of the best heuristic), (world,), with the same number of worlds.
        suite: all environments.
        rng: of the bootstrap.
    """
    table = over_suite(logs, suite)

    def estimate(statistic: Callable[[Array], Array]) -> Estimate:
        return statistics.of_worlds(lambda worlds: statistic(_pooled(table, worlds)), table.shape[1], rng)

    return SuiteScore(estimate(_mean), estimate(_interquartile), estimate(_improvement))


def over_suite(logs: Mapping[str, Array], suite: list[str]) -> Array:
    """The logarithms of all environments, (environment, world); 0 for an environment that is not played."""
    worlds = len(next(iter(logs.values())))
    return np.stack([logs.get(env_id, np.zeros(worlds)) for env_id in suite])


def profile(table: Array, percents: Array) -> Array:
    """The share of (environment, world) whose cost is at most each percentage above the reference, (percent,)."""
    values = np.sort(table, axis=None)
    return np.searchsorted(values, np.log1p(percents / 100.0), side="right") / values.size


def _pooled(table: Array, worlds: Array) -> Array:
    """The values of the resampled worlds of every environment, (..., environment * world)."""
    resampled = np.moveaxis(table[:, worlds], 0, -2)
    return resampled.reshape(*resampled.shape[:-2], -1)


def _mean(values: Array) -> Array:
    return 100.0 * np.expm1(values.mean(axis=-1))


def _interquartile(values: Array) -> Array:
    ordered = np.sort(values, axis=-1)
    cut = ordered.shape[-1] // 4
    return 100.0 * np.expm1(ordered[..., cut : ordered.shape[-1] - cut].mean(axis=-1))


def _improvement(values: Array) -> Array:
    return (values < 0.0).mean(axis=-1) + 0.5 * (values == 0.0).mean(axis=-1)
