"""Generated parts of pages, between two marker lines, and functions that several such parts share."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from wavegym.core.errors import InputError
from wavegym.core.files import write_whole
from wavegym.evaluation.table import order_sentence


def renewed(page: str, start: str, end: str, text: str) -> str:
    """The page with ``text`` between its markers.

    Args:
        page: the whole page.
        start, end: the marker lines, which stay.
        text: the new text between the markers.

    Raises:
        InputError: the page has no such markers.
    """
    before, found, rest = page.partition(start)
    _, closing, after = rest.partition(end)
    if not (found and closing):
        raise InputError(f"the page has no lines {start!r} and {end!r}, expected both")
    return f"{before}{start}\n\n{text}\n\n{end}{after}"


def renew(file: Path, start: str, end: str, text: str) -> None:
    """Put ``text`` between the markers of the page in ``file``; see ``renewed``."""
    page = renewed(file.read_text(encoding="utf-8"), start, end, text)
    write_whole(file.parent, {file.name: page.encode()})


def read_results(file: Path) -> dict[str, Any]:
    """The content of a JSON file of results, {} where there is none."""
    found: dict[str, Any] = json.loads(file.read_text("utf-8")) if file.exists() else {}
    return found


def add_result(file: Path, key: str, found: Any) -> None:
    """Add an entry to a JSON file of results, or replace it."""
    content = json.dumps(read_results(file) | {key: found}, indent=1) + "\n"
    write_whole(file.parent, {file.name: content.encode()})


def both(belief: str, truth: str) -> str:
    """Two tables of the same form."""
    return f"By belief:\n\n{belief}\n\nBy truth:\n\n{truth}"


def order_list(reversals: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """``order_sentence`` for several comparisons by name; comparisons without such a pair are not listed."""
    told = {name: order_sentence(pairs) for name, pairs in reversals.items()}
    none = order_sentence([])
    return "\n".join(f"- {name}: {sentence}" for name, sentence in told.items() if sentence != none) or none
