"""How the papers' numbers are written: intervals rounded outwards, never inwards."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

NONE = "–"  # where there is nothing to tell
WIDTH = 118


def written(value: float | None, digits: int, way: Callable[[float], float] = round) -> str:
    """A number with so many digits after the point, rounded by ``way``; ``NONE`` for None."""
    if value is None:
        return NONE
    return f"{way(round(value * 10**digits, 6)) / 10**digits:.{digits}f}"


def between(ci: Sequence[float] | None, digits: int) -> str:
    """LOW to HIGH, rounded outwards."""
    return NONE if ci is None else f"{written(ci[0], digits, math.floor)} to {written(ci[1], digits, math.ceil)}"


def percent(share: float | None, digits: int = 1) -> str:
    """A share in percent."""
    return written(None if share is None else 100.0 * share, digits)


def between_percent(ci: Sequence[float] | None, digits: int = 1) -> str:
    """An interval of a share in percent."""
    return between(None if ci is None else [100.0 * end for end in ci], digits)


def ratio(found: dict[str, Any], digits: int = 2) -> str:
    """A ratio of means."""
    return _with(written(found["ratio"], digits), between(found["ci"], digits))


def geometric(found: dict[str, Any]) -> str:
    """A geometric mean of ratios."""
    return _with(written(found["geometric"], 2), between(found["geometric_ci"], 2))


def compared(found: dict[str, Any], digits: int = 2) -> str:
    """A ratio of means, and a word where its interval holds 1."""
    ci = found["ci"]
    tie = ci is not None and ci[0] <= 1.0 <= ci[1]
    return _with(written(found["ratio"], digits), between(ci, digits) + (", no difference to be told" if tie else ""))


def share(found: dict[str, Any]) -> str:
    """A share in percent."""
    return _with(f"{percent(found['mean'])} %", between_percent(found["ci"]))


def mean(found: dict[str, Any], digits: int = 0, unit: str = "") -> str:
    """A mean."""
    return _with(f"{written(found['mean'], digits)}{unit}", between(found["ci"], digits))


def bullet(text: str) -> str:
    """An entry of a Markdown list."""
    return textwrap.fill(f"- {text}", WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _with(value: str, interval: str) -> str:
    return value if interval.startswith(NONE) else f"{value} ({interval})"
