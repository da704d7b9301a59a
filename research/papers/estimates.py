"""Estimates over runs with 95 % intervals, as in the papers' ``summary.json``."""

from __future__ import annotations

from typing import Any

import numpy as np

from research.papers.seeds import BOOTSTRAP
from wavegym.core.arrays import Array
from wavegym.core.worlds import word
from wavegym.evaluation import statistics
from wavegym.evaluation.statistics import LEVEL, Estimate


def mean_estimate(values: Array, seed: int) -> Estimate:
    """The mean of (run,) values. All calls use the same resamples, so an interval depends on its own values only."""
    return statistics.mean(values[None], _generator(seed)) if len(values) else Estimate(None, None)


def share_estimate(values: Array, seed: int) -> Estimate:
    """The mean of (run,) shares. If all runs agree, or each has 0 or 1, a bootstrap interval is too narrow.

    The interval is then the exact one for a count in n runs. If all runs agree on a share between 0 and 1, some runs
    outside the sample may differ: their share is at most the upper bound for a count of 0 in n. The interval is the
    resulting range of the mean.
    """
    if not len(values) or not (np.isin(values, (0.0, 1.0)).all() or (values == values[0]).all()):
        return mean_estimate(values, seed)
    from scipy.stats import (
        binomtest,
    )  # half a second, which worker processes do not need

    share = float(values.mean())
    if 0.0 < share < 1.0 and (values == values[0]).all():
        other = float(binomtest(0, len(values)).proportion_ci(LEVEL, method="exact").high)
        return Estimate(share, (share * (1.0 - other), share + (1.0 - share) * other))
    exact = binomtest(int(values.sum()), len(values)).proportion_ci(LEVEL, method="exact")
    return Estimate(share, (float(exact.low), float(exact.high)))


def ratio_estimates(values: Array, reference: Array, seed: int) -> dict[str, Any]:
    """The ratio of means and the geometric mean of the runs' ratios, with paired intervals; both arguments (run,)."""
    if not len(values):
        return {"ratio": None, "ci": None, "geometric": None, "geometric_ci": None, "runs": 0}
    found = statistics.difference(values[None], reference[None], _generator(seed))
    (ratio, ci), (geometric, geometric_ci) = (_from_percent(estimate) for estimate in found)
    return {"ratio": ratio, "ci": ci, "geometric": geometric, "geometric_ci": geometric_ci, "runs": len(values)}


def rms_estimate(squares: Array, counts: Array, seed: int) -> Estimate:
    """Root mean square: ``squares`` (run,) are the sums of squares, ``counts`` (run,) their numbers."""
    return statistics.of_worlds(lambda runs: _rms(squares, counts, runs), len(squares), _generator(seed))


def rms_ratio(ours: tuple[Array, Array], reference: tuple[Array, Array], seed: int) -> dict[str, Any]:
    """The ratio of two root mean squares of the same worlds; (squares, counts) as for ``rms_estimate``."""
    found = statistics.of_worlds(
        lambda runs: _rms(*ours, runs) / _rms(*reference, runs), len(ours[0]), _generator(seed)
    )
    return {"ratio": found.value, "ci": None if found.ci is None else list(found.ci)}


def plain(estimate: Estimate) -> dict[str, Any]:
    """An estimate as plain types for JSON."""
    return {"mean": estimate.value, "ci": None if estimate.ci is None else list(estimate.ci)}


def _from_percent(estimate: Estimate) -> tuple[float | None, list[float] | None]:
    value, ci = estimate
    return None if value is None else 1.0 + value / 100.0, None if ci is None else [1.0 + end / 100.0 for end in ci]


def _rms(squares: Array, counts: Array, runs: Array) -> Array:
    return np.asarray(np.sqrt(squares[runs].sum(axis=-1) / counts[runs].sum(axis=-1)))


def _generator(seed: int) -> np.random.Generator:
    return np.random.default_rng([seed, word(BOOTSTRAP)])
