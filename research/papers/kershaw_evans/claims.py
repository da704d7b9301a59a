"""Claims about Kershaw and Evans's loop, checked with the summary.

The text of the paper is not available to us. A claim is the paper's only if literature that quotes it shows the form of
the solution. All other claims are ours: they follow from the formulas of R and of the Kalman filter.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from research.papers.claims import Claim, Limit, claim, mean_of, ratio_of
from research.papers.kershaw_evans.study import (
    BEST,
    DETERMINANT,
    GATE,
    GRID_GATE,
    LONG,
    RATE,
    SHORT,
    TRACE,
)
from wavegym.evaluation.statistics import Estimate

EXACT = Limit(high=1.0)  # parts per million
TIE, MORE, NO_MORE = Limit(0.99, 1.01), Limit(low=1.0), Limit(high=1.01)  # ratios


def check_claims(summary: dict[str, Any]) -> list[Claim]:
    """A row for each claim and each scene."""
    return [
        row
        for scene, found in summary["scenes"].items()
        for row in (*_closed(scene, found["closed_forms"]), *_policies(scene, found["policies"]))
    ]


def _closed(scene: str, found: dict[str, Any]) -> Iterator[Claim]:
    text = "det R is the same for all pulses: greatest over least, less 1, ppm"
    yield claim(text, scene, _exact(found["det_spread"]), EXACT)
    if found["proportion"]["mean"] is not None:
        text = "Where the pulse of the smallest gate is inside the box, R is proportional to H P H': difference, ppm"
        yield claim(text, scene, _exact(found["proportion"]), EXACT, "R = const. H P H'")
    text = "No pulse of a dense grid has a smaller gate than the closed form: excess, ppm"
    yield claim(text, scene, _exact(found["gate_excess"]), EXACT)
    text = "No pulse of a dense grid has a smaller trace than the quadratic's solution: excess, ppm"
    yield claim(text, scene, _exact(found["trace_excess"]), EXACT, "quadratic in the chirp rate")


def _policies(scene: str, policies: dict[str, Any]) -> Iterator[Claim]:
    def cost(policy: str) -> Estimate:
        return ratio_of(policies[policy]["cost_ratio"])

    def gate(policy: str) -> Estimate:
        return ratio_of(policies[policy]["gate_ratio"])

    if scene == RATE:
        text = "One fixed pulse has the same trace as the one-step scheduler: ratio"
        yield claim(text, scene, cost(BEST), TIE, digits=3)
    else:
        text = "The best fixed pulse has a larger trace than the one-step scheduler: ratio"
        yield claim(text, scene, cost(BEST), MORE)
    for policy in (LONG, SHORT):
        yield claim(f"The {policy} has a larger trace than the one-step scheduler: ratio", scene, cost(policy), MORE)
        yield claim(f"The {policy} has a larger gate than the scheduler of the gate: ratio", scene, gate(policy), MORE)
    text = "The box has no larger trace than the library: ratio"
    yield claim(text, scene, cost(TRACE), NO_MORE, digits=3)
    text = "The box has no larger gate than the library: ratio"
    yield claim(text, scene, gate(GATE), NO_MORE, digits=3)
    text = "The smallest gate does not give the least trace: its trace over the least"
    yield claim(text, scene, cost(GRID_GATE), MORE)
    text = "The smallest det P does not give the smallest gate: its gate over the smallest"
    yield claim(text, scene, gate(DETERMINANT), MORE)


def _exact(found: dict[str, Any]) -> Estimate:
    """A number that does not depend on chance, in parts per million."""
    value, ci = mean_of(found)
    return Estimate(None if value is None else 1e6 * value, None if ci is None else (1e6 * ci[0], 1e6 * ci[1]))
