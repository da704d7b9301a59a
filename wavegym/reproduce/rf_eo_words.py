"""How the RF/EO platforms' numbers are written, and what an interval says of a limit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from wavegym.reproduce.rf_eo import FAR, PUBLISHED
from wavegym.reproduce.words import bullet, share, written

HOLDS, GIVEN, PART, NOT, EXTRA = (
    "What is reproduced",
    "What holds by construction",
    "What is reproduced only in part",
    "What is not",
    "What the paper does not ask",
)
HEADINGS = (HOLDS, GIVEN, PART, NOT, EXTRA)
Finding = tuple[str, str]  # under which heading, Markdown
Teller = Callable[[dict[str, Any]], Finding]


def listed(summary: dict[str, Any], tellers: Sequence[Teller]) -> str:
    """Findings under their headings."""
    told = [tell(summary) for tell in tellers]
    parts = {heading: [text for under, text in told if under == heading] for heading in HEADINGS}
    return "\n\n".join(
        f"### {heading}\n\n" + "\n".join(map(bullet, texts)) for heading, texts in parts.items() if texts
    )


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


def side(ci: Sequence[float] | None, limit: float) -> str:
    """Where an interval lies: "above" a limit, "below" it, or "around" it; "unknown" without one."""
    if ci is None:
        return "unknown"
    return "above" if ci[0] > limit else "below" if ci[1] < limit else "around"


def lies(ci: Sequence[float] | None, limit: float) -> str:
    """The same in words."""
    where = side(ci, limit)
    if where == "unknown":
        return f"what it is against {limit:g} is not known"
    return f"the interval holds {limit:g}" if where == "around" else f"the interval lies {where} {limit:g}"


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
