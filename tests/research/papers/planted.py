"""Estimates planted in a summary, and the verdict on a claim."""

from __future__ import annotations


def of_ratio(low, high):
    return {"ratio": (low + high) / 2, "ci": [low, high], "geometric": low, "geometric_ci": [low, high], "runs": 5}


def of_mean(low, high):
    return {"mean": (low + high) / 2, "ci": [low, high]}


def verdict_on(rows, text, case):
    """The verdict on the one claim with this case whose text starts with ``text``."""
    (found,) = {row.verdict for row in rows if row.case == case and row.text.startswith(text)}
    return found
