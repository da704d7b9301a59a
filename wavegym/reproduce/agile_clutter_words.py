"""How the agile chirps' numbers are written: intervals rounded outwards, never inwards."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from typing import Any

NONE = "–"  # where there is nothing to tell
TRACKERS = {"jpda": "JPDA", "particle": "the particle filter"}
NAMED = 0.005  # shares from here on are named


def each(summary: dict[str, Any], tell: Callable[[Any], str], *keys: str, clutter: str = "clutter") -> str:
    """What ``tell`` makes of what every tracker has at ``keys``; once where it is the same."""
    told = {}
    for tracker, settings in summary["trackers"].items():
        found = settings[clutter]
        for key in keys:
            found = found[key]
        told[TRACKERS[tracker]] = tell(found)
    if len(told) > 1 and len(set(told.values())) == 1:
        return f"{next(iter(told.values()))} with either tracker"
    return " and ".join(f"{text} with {tracker}" for tracker, text in told.items())


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


def ratio(found: dict[str, Any]) -> str:
    """A ratio of means."""
    return _with(written(found["ratio"], 2), between(found["ci"], 2))


def geometric(found: dict[str, Any]) -> str:
    """A geometric mean of ratios."""
    return _with(written(found["geometric"], 2), between(found["geometric_ci"], 2))


def compared(found: dict[str, Any]) -> str:
    """A ratio of means, and a word where its interval holds 1."""
    ci = found["ci"]
    tie = ci is not None and ci[0] <= 1.0 <= ci[1]
    return _with(written(found["ratio"], 2), between(ci, 2) + (", no difference to be told" if tie else ""))


def share(found: dict[str, Any]) -> str:
    """A share in percent."""
    return _with(f"{percent(found['mean'])} %", between_percent(found["ci"]))


def mean(found: dict[str, Any], digits: int = 0) -> str:
    """A mean."""
    return _with(written(found["mean"], digits), between(found["ci"], digits))


def area(found: dict[str, Any]) -> str:
    """A mean in m²."""
    return _with(f"{written(found['mean'], 0)} m²", between(found["ci"], 0))


def never(linear: dict[str, Any]) -> str:
    """How often LFM was chosen, with the interval of the share of runs in which it was at all."""
    bound = "" if linear["ci"] is None else f": {between_percent(linear['ci'], 2)} %"
    return f"{linear['choices']} of {linear['of']} choices ({linear['runs']} of {linear['kept']} runs{bound})"


def commonest(shares: dict[str, dict[str, Any]]) -> str:
    """The phase functions that have a share, the commonest first."""
    found = sorted(((of["mean"], law) for law, of in shares.items() if (of["mean"] or 0.0) >= NAMED), reverse=True)
    return ", ".join(f"{law} {percent(part)} %" for part, law in found) or NONE


def spans(sensors: list[list[str]]) -> str:
    """What each sensor chose step by step, equal steps together; once where the sensors agree."""
    told = [", ".join(_spans(laws)) for laws in sensors]
    if len(set(told)) == 1:
        return told[0]
    return "; ".join(f"at sensor {chr(ord('A') + i)} {text}" for i, text in enumerate(told))


def _spans(laws: Iterable[str]) -> Iterable[str]:
    for law, steps in groupby(enumerate(laws, 1), key=lambda step: step[1]):
        k = [step for step, _ in steps]
        yield f"{law} at k = {k[0]}" + (f" to {k[-1]}" if k[1:] else "")


def _with(value: str, interval: str) -> str:
    return value if interval.startswith(NONE) else f"{value} ({interval})"
