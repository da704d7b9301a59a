"""The verdicts on the agile chirps follow the numbers."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import pytest
from planted import of_mean, of_ratio, verdict_on

from research.papers.agile_clutter.claims import check_claims
from research.papers.agile_clutter.study import BEST_FIXED, FULL, LINEAR

RESULTS = Path(__file__).parents[4] / "results" / "agile_clutter" / "summary.json"


@pytest.fixture
def summary():
    return json.loads(RESULTS.read_text())


def test_verdicts_on_the_results(summary):
    """All claims hold but these."""
    others = {(row.text, row.case): row.verdict for row in check_claims(summary) if row.verdict != "yes"}
    several = {
        (f"HFM is chosen at k = {k}, several shapes each: %", tracker): "no"
        for tracker in ("jpda", "particle")
        for k in ("1 to 3", "8")
    }
    best = "The best fixed chirp has a larger MSE than the agile scheduler: ratio, kept runs, "
    lfm = "The agile LFM chirp has a larger MSE than the fully agile scheduler: ratio, all runs"
    assert others == {
        **several,
        (lfm, "jpda"): "partly",
        ("The error drops when target 1 leaves: k = 26 over k = 25", "jpda"): "undecided",
        (f"{best}several shapes each", "jpda"): "undecided",
        (f"{best}one shape each", "particle"): "no",
    }


@pytest.mark.parametrize(
    ("ci", "verdict"),
    [((4.1, 6.0), "yes"), ((3.0, 5.0), "partly"), ((2.0, 3.0), "partly"), ((0.9, 3.0), "no"), ((0.8, 0.9), "no")],
)
@pytest.mark.parametrize("runs", ["kept", "all"])
def test_the_gain_over_lfm(summary, runs, ci, verdict):
    """An interval that is below 4 and contains 1 is not partly a gain."""
    summary["trackers"]["jpda"]["clutter"]["policies"][LINEAR][f"ratio_{runs}"] = of_ratio(*ci)
    text = f"The agile LFM chirp has a larger MSE than the fully agile scheduler: ratio, {runs} runs"
    assert verdict_on(check_claims(summary), text, "jpda") == verdict


@pytest.mark.parametrize(("ci", "verdict"), [((0.6, 0.7), "yes"), ((0.4, 0.6), "undecided"), ((0.1, 0.2), "no")])
def test_a_phase_function_is_chosen_in_most_transmissions(summary, ci, verdict):
    choices = summary["trackers"]["particle"]["clutter"]["choices"][FULL]["kind"]
    for window, law, steps in (("early", "HFM", "1 to 3"), ("jump", "HFM", "8"), ("late", "PFM", "20 to 25")):
        choices[window][law] = of_mean(*ci)
        text = f"{law} is chosen at k = {steps}, one shape each"
        assert verdict_on(check_claims(summary), text, "particle") == verdict


def test_a_single_lfm_run_is_not_never(summary):
    linear = summary["trackers"]["jpda"]["clutter"]["choices"][FULL]["linear"]
    linear.update(runs=40, choices=80, ci=[0.07, 0.12])
    rows = check_claims(summary)
    assert verdict_on(rows, "LFM is never chosen, one shape each", "jpda") == "no"
    (row,) = (row for row in rows if row.case == "jpda" and row.text.startswith("LFM is never chosen, one"))
    assert row.measured.value == pytest.approx(100 * 40 / linear["kept"])


def test_a_tracker_alone_has_its_claims_only(summary):
    alone = copy.deepcopy(summary)
    del alone["trackers"]["particle"]
    assert {row.case for row in check_claims(alone)} == {"jpda"}
    alone["trackers"]["jpda"]["clutter"]["policies"][BEST_FIXED]["ratio_kept"] = of_ratio(1.1, 1.2)
    text = "The best fixed chirp has a larger MSE than the agile scheduler: ratio, kept runs, one shape each"
    assert verdict_on(check_claims(alone), text, "jpda") == "yes"
