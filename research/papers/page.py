"""The generated part of a page, from results: ``python -m research.papers.page SUMMARY PAGE``."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from agents import blocks
from research.papers import claims
from research.papers.catalogue import load
from wavegym.core.command_line import guarded
from wavegym.core.errors import InputError

START, END = "<!-- made by `make papers PAGE=1`: -->", "<!-- to here -->"


def block(summary: dict[str, Any]) -> str:
    """The text between the markers: the command, the tables of numbers, the table of claims."""
    return f"```\n{summary['command']}\n```\n\n{tables(summary)}"


def tables(summary: dict[str, Any]) -> str:
    """The tables of numbers and the table of claims, as Markdown."""
    paper = load(summary["command"].split()[3])  # python -m research.papers PAPER ...
    return f"{paper.markdown(summary)}\n\nClaims\n\n{claims.markdown(paper.check_claims(summary))}"


def main(arguments: list[str]) -> int:
    """The command; returns its exit status."""

    def renew() -> None:
        if len(arguments) != 2:
            raise InputError("expected two arguments: python -m research.papers.page SUMMARY PAGE")
        summary, page = (Path(argument) for argument in arguments)
        blocks.renew(page, START, END, block(json.loads(summary.read_text(encoding="utf-8"))))

    return guarded(renew)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
