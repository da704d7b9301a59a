"""How the RF/EO platforms' numbers are written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from wavegym.reproduce.rf_eo import FAR, PUBLISHED
from wavegym.reproduce.words import share, written


def both(summary: dict[str, Any], tell: Callable[[Any], str], *keys: str) -> str:
    """What ``tell`` makes of what either scene has at ``keys``; once where it is the same."""
    told = {}
    for scene in (PUBLISHED, FAR):
        found = summary["scenes"][scene]
        for key in keys:
            found = found[key]
        told[scene] = tell(found)
    if told[PUBLISHED] == told[FAR]:
        return f"{told[PUBLISHED]} in either scene"
    return f"{told[PUBLISHED]} in the published scene and {told[FAR]} in the far one"


def jumped(found: dict[str, Any]) -> str:
    """A share of the platforms' steps, and of each platform's."""
    each = ", ".join(f"{share(of)} at platform {j}" for j, of in enumerate(found["platforms"], 1))
    return f"{share(found)}: {each}"


def angles(quantiles: Sequence[float]) -> str:
    """A pixel angle's 10, 50 and 90 % quantiles in mrad."""
    low, middle, high = (written(1e3 * angle, 2) for angle in quantiles)
    return f"{middle} ({low} to {high})"


def setting(values: Sequence[float]) -> str:
    """PRF, bandwidth and pixel angle of a platform."""
    prf, bandwidth, angle = values
    return f"{prf * 1e-3:.3g} kHz {bandwidth * 1e-6:.3g} MHz {angle * 1e3:.3g} mrad"


def slots(settings: Sequence[Sequence[Sequence[float]]]) -> str:
    """What is transmitted in turn: platforms apart by a slash, slots by "then"."""
    return ", then ".join(" / ".join(map(setting, slot)) for slot in settings)
