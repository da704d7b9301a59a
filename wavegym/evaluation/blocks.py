"""Pages of which a part, between two marker lines, is made from results."""

from __future__ import annotations

from wavegym.errors import InputError


def renewed(page: str, start: str, end: str, text: str) -> str:
    """The page with ``text`` between its markers.

    Args:
        page: the whole page.
        start, end: the marker lines, which stay.
        text: what stands between them from now on.

    Raises:
        InputError: the page has no such markers.
    """
    before, found, rest = page.partition(start)
    _, closing, after = rest.partition(end)
    if not (found and closing):
        raise InputError(f"the page has no lines {start!r} and {end!r}, expected both")
    return f"{before}{start}\n\n{text}\n\n{end}{after}"
