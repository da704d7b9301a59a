"""The manual in the docstrings: sections by heading, and what is said of each parameter."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable

SECTIONS = ("Description", "Rewards", "Starting state", "Episode end", "References")


def summary(cls: type) -> str:
    """First line of the docstring."""
    return inspect.cleandoc(cls.__doc__ or "").partition("\n")[0]


def section(cls: type, heading: str) -> str:
    """The text under ``heading`` in the docstring of ``cls``, or of the nearest base class that has it; else ""."""
    for base in cls.__mro__:
        text = _section(inspect.cleandoc(base.__doc__ or ""), heading)
        if text:
            return text
    return ""


def meanings(cls: type, names: Iterable[str]) -> dict[str, str]:
    """What the docstrings of ``cls`` and its bases say of each of ``names``.

    A meaning stands behind ``"name: "`` or ``"name, other: "`` under "Arguments", "Args" or "Attributes", also where
    the line ends there, and ends where the next one begins.
    """
    known = "|".join(re.escape(name) for name in names)
    starts = re.compile(rf"(?:(?<=\s)|^)((?:{known})(?:,\s+(?:{known}))*|^\**\w+):\s", re.MULTILINE)
    found: dict[str, str] = {}
    for base in cls.__mro__:
        doc = inspect.cleandoc(base.__doc__ or "")
        for heading in ("Arguments", "Args:", "Attributes:"):
            text = _section(doc, heading)
            marks = list(starts.finditer(text))
            for i, mark in enumerate(marks):
                end = marks[i + 1].start() if i + 1 < len(marks) else len(text)
                for name in re.split(r",\s+", mark.group(1)):
                    found.setdefault(name, _one_line(text[mark.end() : end]))
    return found


def mention(cls: type, name: str) -> str:
    """Where else the docstrings speak of ``name``: ``"see Starting state"``, ``"see above"`` (arguments), or ``""``."""
    for heading in (*SECTIONS, "Arguments"):
        if re.search(rf"\b{re.escape(name)}\b", section(cls, heading)):
            return f"see {heading}" if heading in SECTIONS else "see above"
    return ""


def _section(doc: str, heading: str) -> str:
    """Indented block under the line ``heading``, its indentation removed."""
    match = re.search(rf"^{re.escape(heading)}\n((?:[ \t]+.*\n?|\n)+)", doc, re.MULTILINE)
    return inspect.cleandoc(match.group(1)).strip() if match else ""


def _one_line(text: str) -> str:
    return " ".join(text.split()).rstrip(".")
