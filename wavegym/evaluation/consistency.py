"""Belief against truth: whether a tracker's errors are as large as it says, and whether both rank policies alike.

The normalised estimation error squared (NEES) of a consistent tracker has the mean n, the number of elements of the
error. If errors are Gaussian, it is chi-square distributed with n degrees of freedom (Bar-Shalom, Li and Kirubarajan,
*Estimation with Applications to Tracking and Navigation*, 2001, section 5.4.2). The steps of an episode are correlated,
so the interval of a mean over steps is a bootstrap over worlds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.worlds import word
from wavegym.evaluation import statistics
from wavegym.evaluation.play import EpisodeResults, Played
from wavegym.evaluation.statistics import LEVEL, Estimate

TOLERANCE = 0.1  # of what is expected
HIGH, LOW = "high", "low"  # flags of a figure: the tracker is overconfident, underconfident


class Consistency(NamedTuple):
    """How well a tracker knows its errors."""

    nees: Estimate  # mean over episodes
    flag: str  # of the mean NEES, see ``flag_of``
    true_over_believed: Estimate  # mean squared position error over the mean of its variance by belief
    ratio_flag: str  # of that ratio, see ``flag_of_ratio``


def consistency(results: EpisodeResults, dimension: int | None, rng: np.random.Generator) -> Consistency:
    """The consistency of the tracker under one policy.

    Args:
        results: of the policy.
        dimension: the mean NEES of a consistent tracker; without it nothing is flagged.
        rng: of the bootstrap.
    """
    nees = statistics.ratio(results.nees, np.ones(results.nees.shape), rng)
    ratio = statistics.ratio(np.square(results.rmse), np.square(results.believed_rmse), rng)
    return Consistency(nees, flag_of(nees, dimension), ratio, flag_of_ratio(ratio))


def flag_of(found: Estimate, expected: float | None) -> str:
    """HIGH or LOW where the interval excludes what is expected, in parentheses if it is within TOLERANCE, else ""."""
    value, ci = found
    if expected is None or value is None or ci is None or ci[0] <= expected <= ci[1]:
        return ""
    word = HIGH if ci[0] > expected else LOW
    return word if abs(value / expected - 1.0) > TOLERANCE else f"({word})"


def flag_of_ratio(found: Estimate) -> str:
    """HIGH or LOW where a ratio is off 1 by more than TOLERANCE and its interval excludes 1, else ""."""
    flag = flag_of(found, 1.0)
    return flag if flag in (HIGH, LOW) else ""


def steps_outside(members: Sequence[Played], dimension: int | None) -> float | None:
    """The share of steps whose mean NEES over worlds and targets is outside its own 95 % bounds; mean over members.

    One step in twenty is expected of a consistent tracker. Targets and worlds count as independent.
    """
    if dimension is None:
        return None
    shares = []
    for member in members:
        total, count = member.nees_sum.sum(axis=0), member.nees_count.sum(axis=0)
        counted = count > 0
        if counted.any():
            low, high = nees_bounds(count[counted], dimension)
            mean = total[counted] / count[counted]
            shares.append(np.mean((mean < low) | (mean > high)))
    return float(np.mean(shares)) if shares else None


def nees_bounds(count: Array | int, dimension: int) -> tuple[Array, Array]:
    """The interval that holds the mean of ``count`` independent NEES with probability 95 %, shaped as ``count``."""
    from scipy.stats import chi2  # half a second that a worker process need not spend

    low, high = (chi2.ppf(tail, dimension * np.asarray(count)) / count for tail in ((1 - LEVEL) / 2, (1 + LEVEL) / 2))
    return low, high


def reversals(by_policy: Mapping[str, EpisodeResults], seed: int) -> list[dict[str, Any]]:
    """The pairs of which one policy costs less by belief and has the larger error by truth, as plain types.

    Both differences are geometric means of paired ratios, and both intervals exclude 0. Of policies that played alike
    the first stands for all.

    Args:
        by_policy: results on the same worlds.
        seed: of the comparison; the bootstrap follows from it.

    Returns:
        For each pair ``policy``, ``reference``, and the differences ``belief`` and ``truth`` in per cent.
    """
    distinct: dict[str, EpisodeResults] = {}
    for name, results in by_policy.items():
        if not any(np.array_equal(results.cost, other.cost) for other in distinct.values()):
            distinct[name] = results
    found = []
    for (name, results), (other, reference) in combinations(distinct.items(), 2):
        pairs = (results.cost, reference.cost), (results.squared_error, reference.squared_error)
        if np.prod([_sign(*pair) for pair in pairs]) != -1.0:
            continue  # the same order; the bootstrap is slow
        belief, truth = (_established(*pair, seed) for pair in pairs)
        if belief is not None and truth is not None:
            found.append({"policy": name, "reference": other, "belief": belief, "truth": truth})
    return found


def _sign(values: Array, reference: Array) -> float:
    """-1, 0 or 1: the geometric mean of the ratios is below, at or above one; NaN where it is undefined."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.sign(np.log(values / reference.mean(axis=0)).mean()))


def _established(values: Array, reference: Array, seed: int) -> float | None:
    """The geometric difference in per cent if its interval excludes 0, else None."""
    rng = np.random.default_rng([seed, word("bootstrap")])
    value, ci = statistics.difference(values, reference, rng).geometric
    return value if ci is not None and ci[0] * ci[1] > 0.0 else None
