"""The papers by name, and what the package of each paper offers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

if TYPE_CHECKING:
    from research.papers.claims import Claim

# Monte Carlo runs unless the user names another number
RUNS = {"agile_clutter": 200, "kershaw_evans": 200, "rf_eo": 20, "urban": 50}


class Paper(Protocol):
    """What ``research.papers.NAME`` offers for each NAME in ``RUNS``.

    Attributes:
        TRACKERS: values of ``--tracker``; empty if the user has no choice.
        FILES: names of the files that ``write`` makes; the last one is ``summary.json``.
        play: play(runs, seed, jobs, *, store, ...) plays the study.
    """

    TRACKERS: Sequence[str]
    FILES: Sequence[str]
    play: Callable[..., Any]

    def write(self, study: Any, folder: Path) -> dict[str, Any]:
        """Write ``FILES`` and return the summary."""
        ...

    def markdown(self, summary: dict[str, Any]) -> str:
        """The tables of numbers."""
        ...

    def check_claims(self, summary: dict[str, Any]) -> list[Claim]:
        """The claims of the paper, and our own, each with its verdict."""
        ...


def load(name: str) -> Paper:
    """The package of a paper; the import takes a second, so a mistake in the arguments is reported before it."""
    return cast("Paper", import_module(f"research.papers.{name}"))
