"""Claims checked with numbers: a verdict follows from an interval and a limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from research.papers.cells import NONE, between, written
from wavegym.envs.describe import table
from wavegym.evaluation.statistics import Estimate

YES, PARTLY, NO, UNDECIDED = "yes", "partly", "no", "undecided"
HEAD = ("claim", "case", "measured", "95 %", "paper", "limit", "verdict")


class Limit(NamedTuple):
    """The range in which a claim holds, and the wider one in which the claim holds partly."""

    low: float = -math.inf
    high: float = math.inf
    partly: tuple[float, float] | None = None

    def __str__(self) -> str:
        wider = "" if self.partly is None else f" (partly: {_range(*self.partly)})"
        return _range(self.low, self.high) + wider


class Claim(NamedTuple):
    """A row of the table of claims.

    Attributes:
        text: the claim, a fixed string.
        case: the scene, setting or tracker in which the claim is checked.
        measured: the estimate with its 95 % interval, in the unit that ``text`` names.
        limit: the range in which the estimate should be.
        paper: what the paper says; ``NONE`` for our own claim.
        digits: after the decimal point.
        verdict: ``YES``, ``PARTLY``, ``NO`` or ``UNDECIDED``.
    """

    text: str
    case: str
    measured: Estimate
    limit: Limit
    paper: str
    digits: int
    verdict: str


def claim(text: str, case: str, measured: Estimate, limit: Limit, paper: str = NONE, digits: int = 2) -> Claim:
    """A claim with the verdict that follows from the interval and the limit; arguments as in ``Claim``."""
    return Claim(text, case, measured, limit, paper, digits, verdict(measured.ci, limit))


def verdict(ci: Sequence[float] | None, limit: Limit) -> str:
    """``YES`` if the whole interval is inside the range, ``NO`` if outside, ``UNDECIDED`` if it contains an edge.

    Instead of the last two: ``PARTLY`` if the whole interval is inside the wider range.
    """
    if ci is None:
        return UNDECIDED
    if _inside(ci, limit.low, limit.high):
        return YES
    if limit.partly is not None and _inside(ci, *limit.partly):
        return PARTLY
    return NO if ci[1] < limit.low or ci[0] > limit.high else UNDECIDED


def markdown(claims: Sequence[Claim]) -> str:
    """The claims as a Markdown table."""
    return table(HEAD, [_row(row) for row in claims])


def mean_of(found: dict[str, Any]) -> Estimate:
    """A mean or a share of a summary."""
    return _estimate(found["mean"], found["ci"])


def ratio_of(found: dict[str, Any]) -> Estimate:
    """A ratio of means of a summary."""
    return _estimate(found["ratio"], found["ci"])


def geometric_of(found: dict[str, Any]) -> Estimate:
    """A geometric mean of ratios of a summary."""
    return _estimate(found["geometric"], found["geometric_ci"])


def percent_of(share: Estimate) -> Estimate:
    """A share in percent."""
    return _scaled(share, 100.0, 0.0)


def increase_of(ratio: Estimate) -> Estimate:
    """By how many percent a ratio is above 1."""
    return _scaled(ratio, 100.0, -100.0)


def decrease_of(ratio: Estimate) -> Estimate:
    """By how many percent a ratio is below 1."""
    return _scaled(ratio, -100.0, 100.0)


def _estimate(value: float | None, ci: Sequence[float] | None) -> Estimate:
    return Estimate(value, None if ci is None else (ci[0], ci[1]))


def _scaled(estimate: Estimate, factor: float, offset: float) -> Estimate:
    value, ci = estimate
    ends = None if ci is None else sorted(offset + factor * end for end in ci)
    return _estimate(None if value is None else offset + factor * value, ends)


def _inside(ci: Sequence[float], low: float, high: float) -> bool:
    return low < ci[0] and ci[1] < high


def _row(row: Claim) -> tuple[str, ...]:
    value, ci = row.measured
    cells = (written(value, row.digits), between(ci, row.digits))
    return (row.text, row.case, *cells, row.paper, str(row.limit), row.verdict)


def _range(low: float, high: float) -> str:
    if low == -math.inf:
        return f"< {high:.3g}"
    return f"> {low:.3g}" if high == math.inf else f"{low:.3g} to {high:.3g}"
