"""Figures of environments in CSV files, which a command renews one environment at a time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from wavegym.core.files import write_whole
from wavegym.registration import SYSTEMS, stem


def read_rows(file: Path) -> list[list[str]]:
    """The rows below the heading; none if there is no file."""
    return [line.split(",") for line in file.read_text("utf-8").splitlines()[1:]] if file.exists() else []


def renew_rows(file: Path, head: str, name: str, rows: Sequence[Sequence[str]]) -> None:
    """Replace the rows of the environment ``name`` by ``rows``, which begin with this name; in the suite's order."""
    names = [stem(env_id) for env_id in SYSTEMS]
    found = [row for row in read_rows(file) if row[0] != name] + [list(row) for row in rows]
    found.sort(key=lambda row: names.index(row[0]))
    lines = [head, *(",".join(row) for row in found)]
    write_whole(file.parent, {file.name: "".join(f"{line}\n" for line in lines).encode()})
