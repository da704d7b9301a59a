"""Rebuild a paper's figures, data and picture.

    python -m wavegym.reproduce agile_clutter --runs 200 --tracker both --out DIR

Writes DIR/figure2.csv, figure2.png, figure3.csv, figure3.png and summary.json, all or none, and prints a table.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from wavegym.errors import choice
from wavegym.evaluation.command import Parser, guarded

PAPERS = ("agile_clutter",)
TRACKERS = ("jpda", "particle", "both")


def parser() -> Parser:
    """The options."""
    options = Parser(prog="python -m wavegym.reproduce", description="Rebuild a paper's figures, data and picture.")
    options.add_argument("paper", metavar="PAPER", help=f"which one: {', '.join(PAPERS)}")
    options.add_argument("--runs", type=int, default=200, metavar="N", help="Monte Carlo runs (default: %(default)s)")
    options.add_argument("--tracker", default="jpda", metavar="T", help="jpda, particle or both (default: jpda)")
    options.add_argument("--seed", type=int, default=0, metavar="S", help="another seed, other runs (default: 0)")
    options.add_argument("--jobs", type=int, default=-1, metavar="J", help="processes (default: one for each core)")
    options.add_argument("--out", type=Path, metavar="DIR", help="folder for the results (default: out/PAPER)")
    return options


def reproduce(arguments: Sequence[str] | None) -> None:
    """Play, write, print."""
    options = parser().read(arguments)
    paper, tracker = choice("paper", options.paper, PAPERS), choice("tracker", options.tracker, TRACKERS)
    # Imports that a misspelt option need not wait for.
    from wavegym.reproduce.agile_clutter import play
    from wavegym.reproduce.agile_clutter_files import write
    from wavegym.reproduce.agile_clutter_table import markdown

    out = options.out or Path("out") / paper
    out.mkdir(parents=True, exist_ok=True)
    trackers = TRACKERS[:2] if tracker == "both" else (tracker,)
    study = play(trackers, runs=options.runs, root=options.seed, jobs=options.jobs)
    print(markdown(write(study, out)))
    print(f"\nwritten to {out}: figure2.csv, figure3.csv, figure2.png, figure3.png, summary.json")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    return guarded(lambda: reproduce(arguments))


if __name__ == "__main__":
    sys.exit(main())
