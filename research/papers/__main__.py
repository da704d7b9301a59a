"""Rebuild a paper's figures, data and pictures.

    python -m research.papers agile_clutter --runs 200 --tracker both --out DIR
    python -m research.papers kershaw_evans --out DIR
    python -m research.papers rf_eo --out DIR
    python -m research.papers urban --out DIR

Writes a CSV and a PNG of each figure and summary.json into DIR, all or none, and prints the tables. After an
interruption the same command continues.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from research.papers.catalogue import RUNS, Paper, load
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError, check_choice


def parser() -> Parser:
    """The options."""
    runs = ", ".join(f"{paper} {count}" for paper, count in RUNS.items())
    options = Parser(prog="python -m research.papers", description="Rebuild a paper's figures, data and pictures.")
    options.add_argument("paper", metavar="PAPER", help=f"which one: {', '.join(RUNS)}")
    options.add_argument("--runs", type=int, metavar="N", help=f"Monte Carlo runs (default: {runs})")
    options.add_argument("--tracker", metavar="T", help="of agile_clutter: jpda, particle or both (default: jpda)")
    options.add_argument("--seed", type=int, default=0, metavar="S", help="another seed, other runs (default: 0)")
    options.add_argument("--jobs", type=int, default=-1, metavar="J", help="processes (default: one for each core)")
    options.add_argument("--out", type=Path, metavar="DIR", help="folder for the results (default: out/PAPER)")
    return options


def rebuild(arguments: Sequence[str] | None) -> None:
    """Play, write, print."""
    options = parser().read(arguments)
    name = check_choice("paper", options.paper, RUNS)
    paper = load(name)
    settings = _tracker(options, paper)
    from research.papers.page import tables
    from research.papers.work import cache_folder

    out = options.out or Path("out") / name
    runs = RUNS[name] if options.runs is None else options.runs
    with cache_folder(out) as store:
        summary = paper.write(paper.play(runs, options.seed, options.jobs, store=store, **settings), out)
    print(tables(summary))
    print(f"\nwritten to {out}: {', '.join(paper.FILES)}")


def _tracker(options: argparse.Namespace, paper: Paper) -> dict[str, str]:
    """The argument of ``play`` that ``--tracker`` sets, if it is given."""
    if options.tracker is None:
        return {}
    if not paper.TRACKERS:
        raise InputError(f"--tracker is {options.tracker!r}, expected none: {options.paper} has no choice of tracker")
    return {"tracker": check_choice("tracker", options.tracker, paper.TRACKERS)}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    return guarded(lambda: rebuild(arguments))


if __name__ == "__main__":
    sys.exit(main())
