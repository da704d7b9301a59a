"""What a paper claims, told under headings: the numbers decide which of its findings hold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from wavegym.reproduce.words import bullet

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
