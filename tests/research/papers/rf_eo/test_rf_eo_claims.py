"""The verdicts on the RF/EO platforms follow the numbers."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import pytest
from planted import of_mean, of_ratio, verdict_on

from research.papers.rf_eo.claims import OBJECTIVES, check_claims
from research.papers.rf_eo.study import ADAPTIVE, CONSTANT, FAR, INFORMATION, PROPOSED, PUBLISHED

RESULTS = Path(__file__).parents[4] / "results" / "rf_eo" / "summary.json"
LEAST, PAPER = OBJECTIVES[ADAPTIVE], OBJECTIVES[INFORMATION]


@pytest.fixture
def summary(rf_eo_summary):
    return copy.deepcopy(rf_eo_summary)


def test_verdicts_on_the_results():
    """All claims hold but these."""
    rows = check_claims(json.loads(RESULTS.read_text()))
    others = {(row.text.partition(":")[0], row.case): row.verdict for row in rows if row.verdict != "yes"}
    alternates = {
        (f"The PRF alternates, {steps}", f"published, {objective}"): "no"
        for steps in ("all steps", "last half")
        for objective in OBJECTIVES.values()
    }
    finest = {
        ("Platform 2 has the finest pixels over the last half", f"published, {objective}"): "undecided"
        for objective in OBJECTIVES.values()
    }
    assert others == {
        **alternates,
        **finest,
        ("Fixed and adaptive tracks are the same at first", "published, steps 1 to 10"): "no",
        ("The adaptive RMSE falls", "published, steps 101 to 500"): "undecided",
        ("The adaptive RMSE falls", "published, steps 501 to 1000"): "no",
        ("A hard penalty costs less than the logistic one", "far"): "undecided",
    }


@pytest.mark.parametrize(
    ("ci", "verdict"), [((11.0, 20.0), "yes"), ((8.0, 20.0), "undecided"), ((2.0, 9.0), "no"), ((0.1, 0.5), "no")]
)
@pytest.mark.slow
def test_an_order_of_magnitude(summary, ci, verdict):
    summary["scenes"][PUBLISHED]["policies"][PROPOSED]["late_over_myopic"] = of_ratio(*ci)
    assert verdict_on(check_claims(summary), "The fixed settings have a larger RMSE", PUBLISHED) == verdict


def of_jumps(low, high):
    return {**of_mean(low, high), "platforms": [of_mean(low, high)] * 2}


@pytest.mark.parametrize("scene", [PUBLISHED, FAR])
@pytest.mark.parametrize(
    ("jumps", "verdict"),
    [
        (of_jumps(0.3, 0.5), "yes"),
        (of_jumps(0.08, 0.16), "undecided"),
        (of_jumps(0.01, 0.03), "no"),
        ({**of_jumps(0.0, 0.17), "mean": 0.0}, "no"),
    ],
)
def test_the_prf_alternates(summary, scene, jumps, verdict):
    """A PRF that never jumped does not alternate, however wide the interval of a few runs is."""
    summary["scenes"][scene]["policies"][INFORMATION]["jumps"] = jumps
    assert verdict_on(check_claims(summary), "The PRF alternates, all steps", f"{scene}, {PAPER}") == verdict


def test_single_platforms_do_not_decide(summary):
    """One platform below a tenth and one above; both together above."""
    jumps = {**of_mean(0.105, 0.125), "platforms": [of_mean(0.08, 0.1), of_mean(0.13, 0.15)]}
    summary["scenes"][FAR]["policies"][ADAPTIVE]["jumps"] = jumps
    assert verdict_on(check_claims(summary), "The PRF alternates, all steps", f"{FAR}, {LEAST}") == "yes"


@pytest.mark.parametrize(("low", "verdict"), [(0.1, "yes"), (-0.1, "undecided"), (-4.0, "no")])
def test_the_deepest_lookahead_decides(summary, low, verdict):
    """The gains of the other depths do not matter."""
    for depth, gain in summary["scenes"][FAR]["lookahead"].items():
        gain["percent"], gain["ci"] = (low + 1, [low, low + 2]) if depth == "10" else (2.0, [1.0, 3.0])
    assert verdict_on(check_claims(summary), "Lookahead of 10 steps", FAR) == verdict


@pytest.mark.parametrize(
    ("ci", "verdict"), [((1.2, 1.6), "yes"), ((0.9, 1.6), "undecided"), ((0.5, 0.8), "no"), (None, "undecided")]
)
def test_adapting_against_the_tuned_constant(summary, ci, verdict):
    ratio = of_ratio(*ci) if ci else {**of_ratio(1.0, 2.0), "ci": None}
    summary["scenes"][FAR]["policies"][CONSTANT]["over_myopic"] = ratio
    assert verdict_on(check_claims(summary), "Myopic has a smaller cost than the tuned constant", FAR) == verdict


@pytest.mark.parametrize(("last", "verdict"), [((5.0, 6.0), "yes"), ((3.5, 6.0), "undecided"), ((1.0, 2.0), "no")])
def test_tracks_are_lost_later_if_the_last_interval_is_above_the_first(summary, last, verdict):
    windows = summary["scenes"][PUBLISHED]["policies"][PROPOSED]["windows"]
    windows[0]["over_myopic"], windows[-1]["over_myopic"] = of_ratio(3.0, 4.0), of_ratio(*last)
    case = f"published, steps {windows[-1]['first']} to {windows[-1]['last']}"
    assert verdict_on(check_claims(summary), "The fixed settings lose the targets later", case) == verdict
