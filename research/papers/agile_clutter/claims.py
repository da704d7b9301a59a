"""The claims of Sira et al., and our own, checked with the summary."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from research.papers.agile_clutter.numbers import DROP, JUMP, WINDOWS
from research.papers.agile_clutter.study import BEST_FIXED, FREE, FULL, LINEAR
from research.papers.claims import Claim, Limit, claim, mean_of, percent_of, ratio_of

MOST, NEVER = Limit(low=50.0), Limit(high=1.0)  # percent
LARGE = Limit(low=4.0, partly=(1.0, float("inf")))  # the gain over the agile LFM chirp
MORE, LESS, SAME = Limit(low=1.0), Limit(high=1.0), Limit(0.9, 1.1)
EARLY, LATE = (f"k = {WINDOWS[window][0]} to {WINDOWS[window][1]}" for window in ("early", "late"))


def check_claims(summary: dict[str, Any]) -> list[Claim]:
    """A row for each claim and each tracker."""
    return [
        row
        for tracker, settings in summary["trackers"].items()
        for row in (*_errors(tracker, settings), *_choices(tracker, settings["clutter"]), *_others(tracker, settings))
    ]


def _errors(tracker: str, settings: dict[str, Any]) -> Iterator[Claim]:
    clutter, without = settings["clutter"], settings["no clutter"]
    linear = clutter["policies"][LINEAR]
    text = "The agile LFM chirp has a larger MSE than the fully agile scheduler: ratio"
    yield claim(f"{text}, kept runs", tracker, ratio_of(linear["ratio_kept"]), LARGE, "agile is better")
    yield claim(f"{text}, all runs", tracker, ratio_of(linear["ratio_all"]), LARGE)
    text = "Without clutter the agile LFM chirp has the same MSE as the fully agile scheduler: ratio"
    yield claim(text, tracker, ratio_of(without["policies"][LINEAR]["ratio_all"]), SAME)
    text = f"The error jumps when target 2 appears: k = {JUMP} over k = {JUMP - 1}"
    yield claim(text, tracker, ratio_of(clutter["jump"]), MORE, "jumps")
    text = f"The error drops when target 1 leaves: k = {DROP} over k = {DROP - 1}"
    yield claim(text, tracker, ratio_of(clutter["drop"]), LESS, "drops")


def _choices(tracker: str, clutter: dict[str, Any]) -> Iterator[Claim]:
    """The phase functions in kept runs, with one shape each and with several."""
    for policy, name, ours in ((FULL, "one shape each", False), (FREE, "several shapes each", True)):
        kind = clutter["choices"][policy]["kind"]
        for window, steps, law in (("early", EARLY, "HFM"), ("jump", f"k = {JUMP}", "HFM"), ("late", LATE, "PFM")):
            paper = "–" if ours else f"{law} selected"
            share = percent_of(mean_of(kind[window][law]))
            yield claim(f"{law} is chosen at {steps}, {name}: %", tracker, share, MOST, paper, 1)
        linear = clutter["choices"][policy]["linear"]
        share = percent_of(mean_of({"mean": _share(linear), "ci": linear["ci"]}))
        text = f"LFM is never chosen, {name}: % of runs with an LFM chirp"
        yield claim(text, tracker, share, NEVER, "–" if ours else "never", 2)


def _share(linear: dict[str, Any]) -> float | None:
    """The share of kept runs in which LFM was chosen at least once."""
    return linear["runs"] / linear["kept"] if linear["kept"] else None


def _others(tracker: str, settings: dict[str, Any]) -> Iterator[Claim]:
    clutter = settings["clutter"]
    text = "More shapes reduce the MSE of the agile scheduler: ratio, kept runs"
    yield claim(text, tracker, ratio_of(clutter["policies"][FREE]["ratio_kept"]), LESS)
    text = "The best fixed chirp has a larger MSE than the agile scheduler: ratio, kept runs, one shape each"
    yield claim(text, tracker, ratio_of(clutter["policies"][BEST_FIXED]["ratio_kept"]), MORE)
    text = "The best fixed chirp has a larger MSE than the agile scheduler: ratio, kept runs, several shapes each"
    yield claim(text, tracker, ratio_of(clutter["best_free"]["ratio_kept"]), MORE)
