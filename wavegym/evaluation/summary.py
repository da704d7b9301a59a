"""The summary of a comparison, as in ``summary.json``."""

from __future__ import annotations

import math
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from wavegym.core import VERSION
from wavegym.core.action_sets import waveform_labels
from wavegym.core.worlds import word
from wavegym.evaluation import statistics
from wavegym.evaluation.comparison import BASELINE, FLOOR, Comparison
from wavegym.evaluation.consistency import consistency, reversals, steps_outside
from wavegym.evaluation.play import EpisodeResults
from wavegym.evaluation.statistics import Estimate, finite

PACKAGES = ("gymnasium", "numpy", "scipy", "numba", "stable-baselines3", "torch")


def summarise(comparison: Comparison) -> dict[str, Any]:
    """The summary in plain types; None (``null``) for a metric that the system lacks or an estimate that is undefined.

    Keys:
        env, parameters (other than the registered ones), worlds, seed, versions; ``in_gospa``, whether the
        error by truth is the GOSPA distance; ``nees_dimension``, the mean NEES of a consistent tracker; policies
        (below); ``reversals``, the pairs that belief and truth rank differently.

        For each policy ``cost`` {mean, ci, iqm, median} of the episodes' mean cost per step; ``vs_myopic`` {percent,
        ci, geometric_percent, geometric_ci}, negative = cheaper than the one-step scheduler; ``score`` (0 = random,
        1 = myopic); ``truth``, ``nees``, ``true_over_believed``, ``lost``, ``collisions``, ``share``: see ``by_truth``
        and ``by_consistency``; ``rmse`` {mean, median, ci} of the position in m, and of several targets ``targets``,
        the mean of each; with several sensors ``choices``, for each of them the share of every waveform that it
        transmitted, by label, the commonest first; ``us_per_decision``, microseconds for one decision in batches of
        worlds, the only figure taken from a clock, so another run does not repeat it. Intervals: [low, high] at 95 %.
    """
    by_policy = comparison.by_policy()
    return {
        "env": comparison.task.env_id,
        "parameters": {key: _plain(value) for key, value in comparison.task.parameters.items()},
        "worlds": len(comparison.seeds),
        "seed": comparison.seed,
        "versions": versions(),
        "in_gospa": by_policy[BASELINE].in_gospa,
        "nees_dimension": comparison.task.system.nees_dimension,
        "policies": {name: _policy(comparison, name, by_policy) for name in comparison.played},
        "reversals": reversals(by_policy, comparison.seed),
    }


def by_truth(results: EpisodeResults, reference: EpisodeResults, rng: np.random.Generator) -> dict[str, Any]:
    """The error of a policy by truth, as plain types.

    Args:
        results: of the policy.
        reference: of the policy that it is compared with, on the same worlds.
        rng: of the bootstrap.

    Returns:
        ``mean`` and ``ci``, the squared error per step in m^2; ``root``, the root of the mean in m; and against the
        reference ``percent``, ``percent_ci`` of the means, ``geometric_percent`` and ``geometric_ci``.
    """
    mean = statistics.mean(results.squared_error, rng)
    against = statistics.difference(results.squared_error, reference.squared_error, rng)
    return {
        **named("mean", "ci", mean),
        "root": None if mean.value is None else math.sqrt(mean.value),
        **named("percent", "percent_ci", against.percent),
        **named("geometric_percent", "geometric_ci", against.geometric),
    }


def by_consistency(comparison: Comparison, name: str, rng: np.random.Generator) -> dict[str, Any]:
    """How well the tracker knows its errors under a policy, as plain types.

    Returns:
        ``nees`` {mean, ci, flag, steps_outside}, see ``consistency`` and ``steps_outside``; ``true_over_believed``
        {ratio, ci, flag} of the mean squared position errors; ``lost``, targets lost per episode; ``collisions`` with
        other users of the band in a step, and the ``share`` of the spectrum that a step uses.
    """
    results, dimension = comparison.results(name), comparison.task.system.nees_dimension
    found = consistency(results, dimension, rng)
    outside = steps_outside(comparison.played[name], dimension)
    return {
        "nees": {**named("mean", "ci", found.nees), "flag": found.flag, "steps_outside": outside},
        "true_over_believed": {**named("ratio", "ci", found.true_over_believed), "flag": found.ratio_flag},
        "lost": finite(np.mean(results.lost)),
        "collisions": finite(np.mean(results.collisions)),
        "share": finite(np.mean(results.share)),
    }


def _policy(comparison: Comparison, name: str, by_policy: dict[str, EpisodeResults]) -> dict[str, Any]:
    # Every policy has its own generator, so its interval does not depend on the other policies.
    rng = np.random.default_rng([comparison.seed, word("bootstrap")])
    results, baseline = by_policy[name], by_policy[BASELINE]
    cost, rmse = results.cost, results.rmse
    against = statistics.difference(cost, baseline.cost, rng)  # first, as in ``Comparison.against``
    mean = statistics.mean(cost, rng)
    floor = finite(np.mean(by_policy[FLOOR].cost)) if FLOOR in by_policy else None
    rmse_mean = statistics.mean(rmse, rng)
    return {
        "cost": {
            **named("mean", "ci", mean),
            "iqm": statistics.interquartile_mean(cost),
            "median": finite(np.median(cost)),
        },
        "vs_myopic": {
            **named("percent", "ci", against.percent),
            **named("geometric_percent", "geometric_ci", against.geometric),
        },
        "score": statistics.score(mean.value, floor, finite(np.mean(baseline.cost))),
        "truth": by_truth(results, baseline, rng),
        **by_consistency(comparison, name, rng),
        "rmse": {**named("mean", "ci", rmse_mean), "median": finite(np.median(rmse)), **_targets(comparison, name)},
        **_choices(comparison, name),
        "us_per_decision": us_per_decision(comparison, name),
    }


def us_per_decision(comparison: Comparison, name: str) -> float:
    """Microseconds of a policy's decision."""
    played = comparison.played[name]
    return 1e6 * float(sum(m.seconds.sum() for m in played) / sum(m.steps.sum() for m in played))


def _targets(comparison: Comparison, name: str) -> dict[str, Any]:
    """Each target's mean root mean square error over the episodes in which it was present; {} for a single target."""
    errors = np.concatenate([member.target_rmse for member in comparison.played[name]])  # (episode, target)
    if errors.shape[1] == 1:
        return {}
    present = [column[~np.isnan(column)] for column in errors.T]
    return {"targets": [finite(np.mean(column)) if column.size else None for column in present]}


def _choices(comparison: Comparison, name: str) -> dict[str, Any]:
    """The share of each waveform by label, for every sensor; {} for a single sensor, or a box."""
    counts = np.sum([member.chosen.sum(axis=0) for member in comparison.played[name]], axis=0)  # (sensor, waveform)
    if len(counts) < 2:
        return {}
    labels = waveform_labels(comparison.task.system.actions)
    orders, steps = np.argsort(-counts, axis=1, kind="stable"), counts[0].sum()
    shares = [
        {labels[i]: float(row[i] / steps) for i in order if row[i]} for row, order in zip(counts, orders, strict=True)
    ]
    return {"choices": shares}


def named(value: str, ci: str, estimate: Estimate) -> dict[str, Any]:
    """An estimate as plain types, under these two keys."""
    return {value: estimate.value, ci: None if estimate.ci is None else list(estimate.ci)}


def versions() -> dict[str, str]:
    """Of Python, this package and those that the numbers rest on."""
    found = {"python": platform.python_version(), "wavegym": VERSION}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def _plain(value: Any) -> Any:
    """A setting as JSON has it."""
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value if isinstance(value, (bool, int, float, str, type(None))) else str(value)
