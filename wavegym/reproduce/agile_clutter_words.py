"""How the agile chirps' numbers are written."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import groupby
from typing import Any

from wavegym.reproduce.words import NONE, between_percent, mean, percent

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


def area(found: dict[str, Any]) -> str:
    """A mean in m²."""
    return mean(found, unit=" m²")


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
