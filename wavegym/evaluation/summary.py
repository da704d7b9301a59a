"""The summary of a comparison, as in ``summary.json``."""

from __future__ import annotations

import math
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from wavegym.core.action_sets import waveform_labels
from wavegym.core.arrays import Array
from wavegym.core.version import VERSION
from wavegym.evaluation import statistics
from wavegym.evaluation.comparison import BASELINE, FLOOR, Comparison
from wavegym.evaluation.statistics import Estimate
from wavegym.evaluation.worlds import word

PACKAGES = ("gymnasium", "numpy", "scipy", "numba", "stable-baselines3", "torch")


def summarise(comparison: Comparison) -> dict[str, Any]:
    """The summary in plain types; None (``null``) for a metric that the system lacks or an estimate that is undefined.

    Keys:
        env, settings (parameters other than the registered ones), worlds, seed, versions, and policies: for each name
        ``cost`` {mean, ci, iqm, median} of the episodes' mean cost per step; ``vs_myopic`` {percent, ci,
        geometric_percent, geometric_ci}, negative = cheaper than the one-step scheduler; ``score`` (0 = random,
        1 = myopic); ``rmse`` {mean, median, ci} of the position in m, and of several targets ``targets``, the mean of
        each; ``nees``, the mean; ``lost``, tracks lost per episode; with several sensors ``choices``, for each of them
        the share of every waveform that it transmitted, by label, the commonest first; ``us_per_decision``,
        microseconds for one decision in batches of worlds, the only figure taken from a clock, so another run does not
        repeat it. Intervals are [low, high] at 95 %.
    """
    costs = {name: comparison.cost(name) for name in comparison.played}
    return {
        "env": comparison.task.env_id,
        "settings": {key: _plain(value) for key, value in comparison.task.settings.items()},
        "worlds": len(comparison.seeds),
        "seed": comparison.root,
        "versions": versions(),
        "policies": {name: _policy(comparison, name, costs) for name in comparison.played},
    }


def _policy(comparison: Comparison, name: str, costs: dict[str, Array]) -> dict[str, Any]:
    # A generator of its own for every policy: its interval is the same in whatever company it is compared.
    rng = np.random.default_rng([comparison.root, word("bootstrap")])
    cost = costs[name]
    mean, rmse = statistics.mean(cost, rng), _matrix(comparison, name, "rmse")
    against = statistics.difference(cost, costs[BASELINE], rng)
    floor = statistics.average(costs[FLOOR]) if FLOOR in costs else None
    rmse_mean = statistics.mean(rmse, rng)
    return {
        "cost": {
            **_named("mean", "ci", mean),
            "iqm": statistics.interquartile_mean(cost),
            "median": statistics.median(cost),
        },
        "vs_myopic": {
            **_named("percent", "ci", against.percent),
            **_named("geometric_percent", "geometric_ci", against.geometric),
        },
        "score": statistics.score(mean.value, floor, statistics.average(costs[BASELINE])),
        "rmse": {**_named("mean", "ci", rmse_mean), "median": statistics.median(rmse), **_targets(comparison, name)},
        "nees": statistics.average(_matrix(comparison, name, "nees")),
        "lost": statistics.average(_matrix(comparison, name, "lost")),
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
    return {"targets": [statistics.average(column) if column.size else None for column in present]}


def _choices(comparison: Comparison, name: str) -> dict[str, Any]:
    """The share of each waveform by label, for every sensor; {} for a single sensor, or a box."""
    counts = np.sum([member.chosen.sum(axis=0) for member in comparison.played[name]], axis=0)  # (sensor, waveform)
    if len(counts) < 2:
        return {}
    labels = waveform_labels(comparison.task.system.actions)  # type: ignore[arg-type]  # a box has no counts
    orders, steps = np.argsort(-counts, axis=1, kind="stable"), counts[0].sum()
    shares = [
        {labels[i]: float(row[i] / steps) for i in order if row[i]} for row, order in zip(counts, orders, strict=True)
    ]
    return {"choices": shares}


def _matrix(comparison: Comparison, name: str, metric: str) -> Array:
    """A metric of every episode, (member, world)."""
    return np.stack([getattr(member, metric) for member in comparison.played[name]])


def _named(value: str, ci: str, estimate: Estimate) -> dict[str, Any]:
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
