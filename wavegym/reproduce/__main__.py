"""Rebuild a paper's figures, data and picture.

    python -m wavegym.reproduce agile_clutter --runs 200 --tracker both --out DIR
    python -m wavegym.reproduce rf_eo --out DIR
    python -m wavegym.reproduce urban --out DIR

Writes a CSV and a PNG of each figure and summary.json into DIR, all or none, and prints a table.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError, choice

RUNS = {"agile_clutter": 200, "rf_eo": 20, "urban": 50}
TRACKERS = ("jpda", "particle", "both")


def parser() -> Parser:
    """The options."""
    runs = ", ".join(f"{paper} {count}" for paper, count in RUNS.items())
    options = Parser(prog="python -m wavegym.reproduce", description="Rebuild a paper's figures, data and picture.")
    options.add_argument("paper", metavar="PAPER", help=f"which one: {', '.join(RUNS)}")
    options.add_argument("--runs", type=int, metavar="N", help=f"Monte Carlo runs (default: {runs})")
    options.add_argument("--tracker", metavar="T", help="of agile_clutter: jpda, particle or both (default: jpda)")
    options.add_argument("--seed", type=int, default=0, metavar="S", help="another seed, other runs (default: 0)")
    options.add_argument("--jobs", type=int, default=-1, metavar="J", help="processes (default: one for each core)")
    options.add_argument("--out", type=Path, metavar="DIR", help="folder for the results (default: out/PAPER)")
    return options


def reproduce(arguments: Sequence[str] | None) -> None:
    """Play, write, print."""
    options = parser().read(arguments)
    paper = choice("paper", options.paper, RUNS)
    if options.runs is None:
        options.runs = RUNS[paper]
    out = options.out or Path("out") / paper
    table, files = PAPERS[paper](options, out)
    print(table)
    print(f"\nwritten to {out}: {', '.join(files)}")


# Imports below are those that a misspelt option need not wait for.


def _agile_clutter(options: argparse.Namespace, out: Path) -> tuple[str, Sequence[str]]:
    tracker = choice("tracker", options.tracker or TRACKERS[0], TRACKERS)
    from wavegym.reproduce.agile_clutter import play
    from wavegym.reproduce.agile_clutter_files import FILES, write
    from wavegym.reproduce.agile_clutter_table import markdown

    out.mkdir(parents=True, exist_ok=True)
    trackers = TRACKERS[:2] if tracker == "both" else (tracker,)
    study = play(trackers, runs=options.runs, root=options.seed, jobs=options.jobs)
    return markdown(write(study, out)), FILES


def _rf_eo(options: argparse.Namespace, out: Path) -> tuple[str, Sequence[str]]:
    _no_tracker(options, "rf_eo has one")
    from wavegym.reproduce.rf_eo import play
    from wavegym.reproduce.rf_eo_files import FILES, write
    from wavegym.reproduce.rf_eo_table import markdown
    from wavegym.reproduce.work import kept

    with kept(out) as store:
        study = play(options.runs, options.seed, options.jobs, store=store)
        return markdown(write(study, out)), FILES


def _urban(options: argparse.Namespace, out: Path) -> tuple[str, Sequence[str]]:
    _no_tracker(options, "urban plays all of its own")
    from wavegym.reproduce.urban import play
    from wavegym.reproduce.urban_files import FILES, write
    from wavegym.reproduce.urban_table import markdown

    out.mkdir(parents=True, exist_ok=True)
    return markdown(write(play(options.runs, options.seed, options.jobs), out)), FILES


def _no_tracker(options: argparse.Namespace, why: str) -> None:
    if options.tracker is not None:
        raise InputError(f"--tracker is {options.tracker!r}, expected none: {why}")


PAPERS: dict[str, Callable[[argparse.Namespace, Path], tuple[str, Sequence[str]]]] = {
    "agile_clutter": _agile_clutter,
    "rf_eo": _rf_eo,
    "urban": _urban,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    return guarded(lambda: reproduce(arguments))


if __name__ == "__main__":
    sys.exit(main())
