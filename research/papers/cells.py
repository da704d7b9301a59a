"""Numbers as table cells: intervals are rounded outwards, never inwards."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

NONE = "–"  # where there is no number


def written(value: float | None, digits: int, rounding: Callable[[float], float] = round) -> str:
    """A number with ``digits`` digits after the point; ``NONE`` for None."""
    if value is None:
        return NONE
    return f"{rounding(round(value * 10**digits, 6)) / 10**digits:.{digits}f}"


def between(ci: Sequence[float] | None, digits: int) -> str:
    """LOW to HIGH, rounded outwards."""
    return NONE if ci is None else f"{written(ci[0], digits, math.floor)} to {written(ci[1], digits, math.ceil)}"


def percent(share: float | None, digits: int = 1) -> str:
    """A share in percent."""
    return written(None if share is None else 100.0 * share, digits)


def between_percent(ci: Sequence[float] | None, digits: int = 1) -> str:
    """An interval of a share in percent."""
    return between(None if ci is None else [100.0 * end for end in ci], digits)


def mean_cells(found: dict[str, Any], digits: int = 2) -> tuple[str, str]:
    """A mean and its interval."""
    return written(found["mean"], digits), between(found["ci"], digits)


def share_cells(found: dict[str, Any], digits: int = 1) -> tuple[str, str]:
    """A share and its interval, in percent."""
    return percent(found["mean"], digits), between_percent(found["ci"], digits)


def ratio_cells(found: dict[str, Any], digits: int = 2) -> tuple[str, str]:
    """A ratio of means and its interval."""
    return written(found["ratio"], digits), between(found["ci"], digits)
