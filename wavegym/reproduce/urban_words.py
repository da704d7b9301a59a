"""How the street's numbers are written."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from wavegym.reproduce.urban import GHOSTS, LOOSE, STRICT
from wavegym.reproduce.words import mean, written

NAMES = {LOOSE: "with loose starts", STRICT: "with strict ones"}


def figures(summary: dict[str, Any], setting: str, loop: tuple[str, str], ghosts: bool = True) -> dict[str, Any]:
    """Of one filter and policy."""
    of, policy = loop
    found: dict[str, Any] = summary["settings"][setting]["systems"][GHOSTS[ghosts]][of][policy]
    return found


def both(tell: Callable[[str], str]) -> str:
    """What is to be told of either setting."""
    return "; ".join(f"{name} {tell(setting)}" for setting, name in NAMES.items())


def change(found: dict[str, Any]) -> str:
    """A ratio as so many percent more (+) or less (-)."""
    times, ci = found["ratio"], percents(found)
    value = _signed(None if times is None else 100.0 * (times - 1.0))
    if ci is None:
        return f"{value} %"
    return f"{value} % ({_signed(ci[0], math.floor)} to {_signed(ci[1], math.ceil)})"


def percents(found: dict[str, Any], sign: float = 1.0) -> list[float] | None:
    """The interval of a ratio as a change in percent; of sign -1 as a reduction."""
    ci = found["ci"]
    return None if ci is None else sorted(sign * 100.0 * (end - 1.0) for end in ci)


def phase_of(summary: dict[str, Any], setting: str, phase: str) -> dict[str, Any]:
    """The first target's models in one phase."""
    found: dict[str, Any] = next(of for of in summary["settings"][setting]["models"][0] if of["phase"] == phase)
    return found


def metres(found: dict[str, Any]) -> str:
    """A mean in m."""
    return mean(found, 2, " m")


def origins(false_tracks: dict[str, Any]) -> str:
    """A mean number in a run, and what it is made of."""
    of = ", ".join(f"{written(found['mean'], 2)} {name}" for name, found in false_tracks["origins"].items())
    return f"{mean(false_tracks, 2)}: {of}"


def _signed(value: float | None, way: Callable[[float], float] = round) -> str:
    text = written(value, 1, way)
    return f"+{text}" if value is not None and value > 0.0 else text
