"""Docstrings as Markdown: a line that begins with ``>`` is a quotation there, so doctests are fenced."""

from __future__ import annotations

import re
from typing import Any

import griffe

DOCTEST = re.compile(r"^>>> .*(?:\n(?!\s*$).+)*", re.MULTILINE)  # an unindented example and its output
LITERAL = re.compile(r"::$", re.MULTILINE)  # reStructuredText's sign of a block of code
BOUND = re.compile(r"^( +[\w, ]+: )>", re.MULTILINE)  # "horizon: > 0"


class DoctestFences(griffe.Extension):
    """Rewrites docstrings on the way into the documentation; the source stays as it is."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Fence the examples of one object's docstring."""
        if obj.docstring:
            fenced = DOCTEST.sub(lambda example: f"```pycon\n{example.group()}\n```", obj.docstring.value)
            obj.docstring.value = BOUND.sub(r"\1\>", LITERAL.sub(":", fenced))
