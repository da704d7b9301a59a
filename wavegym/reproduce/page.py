"""The part of the docs' page that is made from results: ``python -m wavegym.reproduce.page SUMMARY PAGE``."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from wavegym.core.command_line import guarded
from wavegym.core.errors import InputError
from wavegym.evaluation import blocks
from wavegym.evaluation.files import write_whole
from wavegym.reproduce import (
    agile_clutter_findings,
    agile_clutter_table,
    rf_eo_findings,
    rf_eo_table,
    urban_findings,
    urban_table,
)

PAPERS: dict[str, tuple[Callable[..., str], Callable[..., str]]] = {  # table and findings
    "agile_clutter": (agile_clutter_table.markdown, agile_clutter_findings.findings),
    "rf_eo": (rf_eo_table.markdown, rf_eo_findings.findings),
    "urban": (urban_table.markdown, urban_findings.findings),
}
START, END = "<!-- made by `make reproduce PAGE=1`: -->", "<!-- to here -->"


def block(summary: dict[str, Any]) -> str:
    """What stands between the markers: the command, the table, the findings."""
    markdown, findings = PAPERS[summary["command"].split()[3]]  # python -m wavegym.reproduce PAPER ...
    command = f"```\n{summary['command']}\n```"
    return f"{command}\n\n{markdown(summary)}\n\n{findings(summary)}"


def renewed(page: str, summary: dict[str, Any]) -> str:
    """The page with its block made afresh; InputError where it has none."""
    return blocks.renewed(page, START, END, block(summary))


def main(arguments: list[str]) -> int:
    """The command; returns its exit status."""

    def renew() -> None:
        if len(arguments) != 2:
            raise InputError("expected two arguments: python -m wavegym.reproduce.page SUMMARY PAGE")
        summary, page = (Path(argument) for argument in arguments)
        text = renewed(page.read_text(encoding="utf-8"), json.loads(summary.read_text(encoding="utf-8")))
        write_whole(page.parent, {page.name: text.encode()})

    return guarded(renew)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
