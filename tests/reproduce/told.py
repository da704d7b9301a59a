"""Where findings are told."""

from __future__ import annotations


def heading_of(text, words):
    """The heading under which the one bullet stands whose title starts with ``words``."""
    found, heading = {}, ""
    for line in text.splitlines():
        if line.startswith("### "):
            heading = line[4:]
        elif line.startswith("- **"):
            found[line[4:].partition("**")[0].rstrip(".")] = heading
    (heading,) = {heading for title, heading in found.items() if title.startswith(words)}
    return heading
