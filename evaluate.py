"""Compare policies on the same worlds.

    python evaluate.py KershawEvansPosition-v0 --policies best-fixed,random,lookahead:2 --worlds 200 --out DIR

Writes DIR/summary.json, episodes.csv, table.md and comparison.png, all or none, and prints the table.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from agents.compare import evaluate
from wavegym.evaluation.command import guarded


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    return guarded(lambda: evaluate(arguments))


if __name__ == "__main__":
    sys.exit(main())
