"""The verdicts on the urban loops follow the numbers."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import pytest
from planted import of_mean, of_ratio, verdict_on

from research.papers.urban.claims import MODELS_ALONE, ONE_MODEL, SCHEDULER_ALONE, check_claims
from research.papers.urban.numbers import figures_of, phase_of
from research.papers.urban.study import CLOSED, LOOSE, SETTINGS, STRICT

RESULTS = Path(__file__).parents[4] / "results" / "urban" / "summary.json"
EMERGENT = "The gain is emergent"


@pytest.fixture
def summary(urban_summary):
    return copy.deepcopy(urban_summary)


def test_verdicts_on_the_results():
    """All claims hold but these."""
    rows = check_claims(json.loads(RESULTS.read_text()))
    others = {(row.text.partition(":")[0], row.case): row.verdict for row in rows if row.verdict != "yes"}
    both = {
        (text, setting): verdict
        for setting in SETTINGS
        for text, verdict in (
            ("The closed loop confirms more tracks than the open loop", "partly"),
            ("The closed loop has less RMS error than the open loop", "partly"),
            ("NCV is known, driving on", "no"),  # in the lowest scan
            ("One NCV model of 1 m/s² in an open loop has no larger error than the closed loop", "undecided"),
        )
    }
    emergent = {(EMERGENT, f"{setting}, {key}"): "no" for setting in SETTINGS for key in ("confirmed", "rmse")}
    assert others == {
        **both,
        **emergent,
        ("The closed loop has few false tracks", LOOSE): "no",
        ("The scheduler alone can confirm more tracks than the open loop", LOOSE): "undecided",
        ("The scheduler alone can confirm more tracks than the open loop", STRICT): "no",
        ("The scheduler alone can reduce the RMS error of the open loop", LOOSE): "no",
        ("The scheduler alone can reduce the RMS error of the open loop", STRICT): "undecided",
    }


@pytest.mark.parametrize(
    ("confirmed", "rmse", "verdict"),
    [
        ((1.11, 1.14), (0.36, 0.44), "yes"),
        ((1.16, 1.20), (0.30, 0.34), "partly"),
        ((1.02, 1.08), (0.50, 0.60), "partly"),
        ((0.98, 1.12), (0.43, 1.10), "undecided"),
        ((0.90, 0.95), (1.10, 1.20), "no"),
    ],
)
@pytest.mark.slow
def test_the_headline(summary, confirmed, rmse, verdict):
    over = figures_of(summary, LOOSE, CLOSED)["over_open"]
    over["confirmed"], over["rmse"] = of_ratio(*confirmed), of_ratio(*rmse)
    rows = check_claims(summary)
    assert verdict_on(rows, "The closed loop confirms more tracks", LOOSE) == verdict
    assert verdict_on(rows, "The closed loop has less RMS error", LOOSE) == verdict


@pytest.mark.parametrize(("ci", "verdict"), [((0.81, 0.9), "yes"), ((0.79, 0.9), "undecided"), ((0.5, 0.6), "no")])
def test_a_model_is_known(summary, ci, verdict):
    """At every scan, and on average over the phase."""
    found = phase_of(summary, STRICT, "driving on")
    text = "NCV is known, driving on: mean probability, "
    found["least"] = {**of_mean(*ci), "scan": 105}
    assert verdict_on(check_claims(summary), f"{text}lowest scan", STRICT) == verdict
    found["mean"]["NCV"] = of_mean(*ci)
    assert verdict_on(check_claims(summary), f"{text}all scans", STRICT) == verdict


@pytest.mark.parametrize(
    ("false", "held", "few", "keeps"),
    [((0.1, 0.2), 1.0, "yes", "yes"), ((0.2, 0.4), 0.98, "undecided", "no"), ((1.1, 1.2), 0.9, "no", "no")],
)
def test_false_tracks_and_ghost_logic(summary, false, held, few, keeps):
    figures_of(summary, LOOSE, CLOSED)["false_tracks"].update(of_mean(*false))
    summary["settings"][LOOSE]["ghosts_over_none"]["closed"]["held"] = of_ratio(held - 0.001, held + 0.001)
    rows = check_claims(summary)
    assert verdict_on(rows, "The closed loop has few false tracks", LOOSE) == few
    assert verdict_on(rows, "Ghost logic keeps the held targets", LOOSE) == keeps


@pytest.mark.parametrize(
    ("models", "scheduler", "verdict"),
    [((0.3, 0.4), (0.9, 1.1), "no"), ((0.3, 0.4), (0.35, 0.5), "undecided"), ((0.8, 0.9), (0.3, 0.4), "yes")],
)
def test_the_gain_is_emergent_unless_the_models_alone_gain_more(summary, models, scheduler, verdict):
    for loop, ends in ((MODELS_ALONE, models), (SCHEDULER_ALONE, scheduler)):
        figures_of(summary, STRICT, loop)["over_open"]["rmse"] = of_ratio(*ends)
    assert verdict_on(check_claims(summary), EMERGENT, f"{STRICT}, rmse") == verdict


@pytest.mark.parametrize(("rmse", "verdict"), [((0.8, 0.9), "yes"), ((0.9, 1.1), "undecided"), ((1.1, 1.2), "no")])
def test_one_model_has_no_larger_error(summary, rmse, verdict):
    figures_of(summary, LOOSE, ONE_MODEL)["over_closed"]["rmse"] = of_ratio(*rmse)
    assert (
        verdict_on(check_claims(summary), "One NCV model of 1 m/s² in an open loop has no larger error", LOOSE)
        == verdict
    )


@pytest.mark.parametrize(("ci", "verdict"), [((1.05, 1.2), "yes"), ((0.95, 1.2), "undecided"), ((0.8, 0.9), "no")])
def test_the_worth_of_scheduling_is_the_loss_of_round_robin(summary, ci, verdict):
    figures_of(summary, LOOSE, MODELS_ALONE)["over_closed"]["rmse"] = of_ratio(*ci)
    assert verdict_on(check_claims(summary), "With the four models, round robin", LOOSE) == verdict


@pytest.mark.parametrize(("last", "verdict"), [((1.0, 1.1), "yes"), ((1.1, 1.3), "undecided"), ((1.65, 1.7), "no")])
def test_the_gain_is_larger_with_strict_starts(summary, last, verdict):
    for found, ends in ((summary["starts"][0], (1.2, 1.6)), (summary["starts"][-1], last)):
        found["over_open"]["confirmed"] = of_ratio(*ends)
    text = "The gain in confirmed tracks is larger with strict starts"
    assert verdict_on(check_claims(summary), text, "strictest start") == verdict
