"""Docstrings as Markdown: doctests are fenced, because a line that begins with ``>`` is a quotation there."""

from __future__ import annotations

import re
from textwrap import dedent
from typing import Any

import griffe

DOCTEST = re.compile(r"^>>> .*(?:\n(?!\s*$).+)*", re.MULTILINE)  # an unindented example and its output
LITERAL = re.compile(r"::$", re.MULTILINE)  # reStructuredText's sign of a block of code
BOUND = re.compile(r"^( +(?:[\w, ]+: )?)>(?!>>)", re.MULTILINE)  # "horizon: > 0"
SECTION = re.compile(r"^(Description|Rewards|Starting state|Episode end|References)\n((?: {4}.*\n?|\n)+)", re.MULTILINE)


class Markdown(griffe.Extension):
    """Rewrites docstrings on the way into the documentation; the source stays as it is."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite one object's docstring: the sections of a system, the examples, signs of Markdown."""
        if obj.docstring:
            text = SECTION.sub(lambda part: f"**{part[1]}**\n\n{dedent(part[2])}", obj.docstring.value)
            text = DOCTEST.sub(lambda example: f"```pycon\n{example[0]}\n```", text)
            obj.docstring.value = BOUND.sub(r"\1\>", LITERAL.sub(":", text))
