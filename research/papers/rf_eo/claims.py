"""The claims of O'Rourke and Swindlehurst, and our own, checked with the summary."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from research.papers.claims import NO, Claim, Limit, claim, geometric_of, mean_of, percent_of, ratio_of
from research.papers.rf_eo.study import ADAPTIVE, CONSTANT, CYCLE, DEPTHS, INFORMATION, MARGIN, PROPOSED, PUBLISHED
from wavegym.evaluation.statistics import Estimate

ORDER = Limit(low=10.0)  # the paper: at least an order of magnitude
ALTERNATES = Limit(low=10.0)  # percent of the steps at which the PRF jumps
ADAPTS = Limit(low=2.0)  # greatest over smallest pixel angle of a run
MORE, LESS, SAME, MOST, GAIN = Limit(low=1.0), Limit(high=1.0), Limit(0.9, 1.1), Limit(low=50.0), Limit(low=0.0)
OBJECTIVES = {ADAPTIVE: "least trace", INFORMATION: "the paper's objective"}


def check_claims(summary: dict[str, Any]) -> list[Claim]:
    """The claims of the paper, then our own."""
    scenes = summary["scenes"]
    return [
        *_fixed(scenes[PUBLISHED]),
        *_angles(scenes[PUBLISHED]),
        *(row for name, scene in scenes.items() for row in _alternation(name, scene["policies"])),
        *(row for name, scene in scenes.items() for row in _others(name, scene)),
    ]


def _fixed(scene: dict[str, Any]) -> Iterator[Claim]:
    """The fixed settings against the adaptive ones, for each part of the run."""
    fixed, adaptive = (scene["policies"][name] for name in (PROPOSED, ADAPTIVE))
    text = "The fixed settings have a larger RMSE over the last half: ratio to myopic"
    yield claim(text, PUBLISHED, ratio_of(fixed["late_over_myopic"]), ORDER, "at least 10", 1)
    first, last = (fixed["windows"][part] for part in (0, -1))
    text = "Fixed and adaptive tracks are the same at first: ratio of RMSE"
    yield claim(text, _steps(first), ratio_of(first["over_myopic"]), SAME, "identical", 1)
    start = first["over_myopic"]["ci"]
    if start is not None:
        text = "The fixed settings lose the targets later: ratio of RMSE, against the interval of the first part"
        yield claim(text, _steps(last), ratio_of(last["over_myopic"]), Limit(low=start[1]), "lost", 1)
    for window in adaptive["windows"][1:]:
        text = "The adaptive RMSE falls: ratio to the part before"
        yield claim(text, _steps(window), ratio_of(window["fall"]), LESS, "falls")


def _angles(scene: dict[str, Any]) -> Iterator[Claim]:
    for platform, factor in enumerate(scene["adaptation"][ADAPTIVE]["factor"], 1):
        text = "The pixel angle adapts: greatest over smallest of a run, geometric mean"
        yield claim(text, f"{PUBLISHED}, platform {platform}", geometric_of(factor), ADAPTS, "adapts", 1)
    for policy, objective in OBJECTIVES.items():
        share = percent_of(mean_of(scene["adaptation"][policy]["finest"]))
        text = "Platform 2 has the finest pixels over the last half: % of runs"
        yield claim(text, f"{PUBLISHED}, {objective}", share, MOST, "platform 2", 1)


def _alternation(name: str, policies: dict[str, Any]) -> Iterator[Claim]:
    for policy, objective in OBJECTIVES.items():
        for key, steps in (("jumps", "all steps"), ("jumps_late", "last half")):
            text = f"The PRF alternates, {steps}: % of steps with a jump"
            share = percent_of(mean_of(policies[policy][key]))
            paper = "alternates at first" if name == PUBLISHED and key == "jumps" else "–"
            row = claim(text, f"{name}, {objective}", share, ALTERNATES, paper, 1)
            yield row._replace(verdict=NO) if share.value == 0.0 else row  # the interval is of runs, not of their steps


def _others(name: str, scene: dict[str, Any]) -> Iterator[Claim]:
    """Questions that the paper does not ask."""
    policies = scene["policies"]
    for policy, words in (
        (CONSTANT, "the tuned constant"),
        (CYCLE, "the tuned cycle"),
        (INFORMATION, "the paper's objective"),
        (MARGIN[name], "myopic with the other margin"),
    ):
        text = f"Myopic has a smaller cost than {words}: ratio of the other to myopic"
        yield claim(text, name, ratio_of(policies[policy]["over_myopic"]), MORE)
    deepest = scene["lookahead"][str(DEPTHS[-1])]
    gain = Estimate(deepest["percent"], None if deepest["ci"] is None else tuple(deepest["ci"]))
    yield claim(f"Lookahead of {DEPTHS[-1]} steps reduces the cost: %", name, gain, GAIN)
    hard = ratio_of(scene["penalties"]["hard"]["over_logistic"])
    yield claim("A hard penalty costs less than the logistic one: ratio", name, hard, LESS, digits=3)


def _steps(window: dict[str, Any]) -> str:
    return f"{PUBLISHED}, steps {window['first']} to {window['last']}"
