"""What is said of the street follows the numbers."""

from __future__ import annotations

import copy

import pytest
from told import heading_of

from papers.claims import EXTRA, HOLDS, NOT, PART
from papers.urban.study import (
    CLOSED,
    LOOSE,
    MYOPIC,
    NCV,
    NCV1,
    SETTINGS,
    SHORT,
    STRICT,
    TURNS,
    VSIMM,
    Runs,
    Study,
)
from papers.urban.claims import findings
from papers.urban.numbers import summarise
from papers.urban.table import markdown
from wavegym.reproduce.urban_words import both, change, figures, origins, percents, phase_of


def told(summary):
    """The findings in one line, and where they stand."""
    text = findings(summary)
    return " ".join(text.split()), lambda words: heading_of(text, words)


def of_ratio(low, high):
    return {"ratio": (low + high) / 2, "ci": [low, high], "geometric": None, "geometric_ci": None, "runs": 5}


def of_mean(low, high):
    return {"mean": (low + high) / 2, "ci": [low, high]}


@pytest.mark.parametrize(
    ("confirmed", "rmse", "words", "heading"),
    [
        ((1.08, 1.16), (0.34, 0.41), "better by as much as in the paper", HOLDS),
        ((1.16, 1.20), (0.30, 0.34), "better, by more than in the paper", PART),
        ((1.02, 1.08), (0.50, 0.60), "better, by less than in the paper", PART),
        ((0.98, 1.12), (0.50, 1.10), "no difference can be told", NOT),
        ((0.90, 0.95), (1.10, 1.20), "the closed loop is worse", NOT),
    ],
)
def test_the_headline_holds_if_its_interval_meets_the_paper_s(street_summary, confirmed, rmse, words, heading):
    other = copy.deepcopy(street_summary)
    over = figures(other, LOOSE, CLOSED)["over_open"]
    over["confirmed"], over["rmse"] = of_ratio(*confirmed), of_ratio(*rmse)
    _, where = told(other)
    assert where(f"Confirmed tracks: {words}") == heading
    assert where(f"Position error: {words}") == heading


@pytest.mark.parametrize(
    ("least", "average", "since", "words", "heading"),
    [
        ((0.81, 0.9), (0.9, 0.95), 104, "NCV is known", HOLDS),
        ((0.79, 0.9), (0.9, 0.95), 104, "NCV is known on average", PART),
        ((0.5, 0.6), (0.9, 0.95), 108, "NCV is known, but later", PART),
        ((0.5, 0.6), (0.75, 0.85), None, "NCV is not known", NOT),
    ],
)
def test_a_model_is_known_if_every_scan_says_so(street_summary, least, average, since, words, heading):
    other = copy.deepcopy(street_summary)
    for setting in SETTINGS:
        found = phase_of(other, setting, "driving on")
        found["least"] = {**of_mean(*least), "scan": 105}
        found["mean"]["NCV"], found["known_from"] = of_mean(*average), since
    text, where = told(other)
    assert where(f"Target 1, driving on: {words}") == heading
    assert ("at no scan for good" in text) == (
        since is None or "at no scan for good" in " ".join(findings(street_summary).split())
    )


@pytest.mark.parametrize(
    ("loose", "strict", "held", "words", "heading"),
    [
        ((0.1, 0.2), (0.0, 0.1), 1.0, "in either setting", HOLDS),
        ((1.1, 1.2), (0.0, 0.1), 1.0, "with strict starts only", PART),
        ((1.1, 1.2), (0.2, 0.4), 1.0, "in no setting", NOT),
        ((0.1, 0.2), (0.0, 0.1), 0.9, "in either setting", NOT),  # at the price of true tracks
    ],
)
def test_false_tracks_are_few_only_where_the_interval_says_so(street_summary, loose, strict, held, words, heading):
    other = copy.deepcopy(street_summary)
    for setting, ends in ((LOOSE, loose), (STRICT, strict)):
        figures(other, setting, CLOSED)["false_tracks"].update(of_mean(*ends))
        figures(other, setting, CLOSED, ghosts=False)["false_tracks"].update(of_mean(1.0, 2.0))
        other["settings"][setting]["ghosts_over_none"]["closed"]["held"] = of_ratio(held, held + 0.01)
    text, where = told(other)
    assert where(f"Fewer than 0.3 false confirmed tracks in a run with ghost logic: {words}") == heading
    assert "not the ghost logic" not in text
    figures(other, STRICT, CLOSED, ghosts=False)["false_tracks"].update(of_mean(*strict))
    assert ("not the ghost logic" in told(other)[0]) == (words == "with strict starts only")


def test_the_filter_is_named_only_where_it_alone_explains_the_gain(street_summary):
    other = copy.deepcopy(street_summary)
    for setting in SETTINGS:
        for loop, confirmed, rmse in (
            ((VSIMM, TURNS), (1.1, 1.2), (0.3, 0.4)),
            ((NCV, MYOPIC), (0.98, 1.02), (0.9, 1.1)),
        ):
            over = figures(other, setting, loop)["over_open"]
            over["confirmed"], over["rmse"] = of_ratio(*confirmed), of_ratio(*rmse)
    _, where = told(other)
    assert where("The improvement does not emerge from the whole: it is the filter") == NOT
    figures(other, STRICT, (NCV, MYOPIC))["over_open"]["rmse"] = of_ratio(0.35, 0.5)
    _, where = told(other)
    assert where("The improvement may emerge from the whole") == PART


@pytest.mark.parametrize(
    ("rmse", "words"), [((0.9, 1.1), "is enough"), ((0.8, 0.9), "is enough"), ((1.1, 1.2), "is not enough")]
)
def test_one_model_is_enough_if_its_error_is_no_greater(street_summary, rmse, words):
    other = copy.deepcopy(street_summary)
    for setting in SETTINGS:
        over = figures(other, setting, (NCV1, TURNS))["over_closed"]
        over["confirmed"], over["rmse"] = of_ratio(0.99, 1.01), of_ratio(*rmse)
    text, where = told(other)
    assert where(f"One model that expects 1 m/s² in place of .25 {words}") == EXTRA
    assert ("one setting of its filter" in text) == (words == "is enough")
    figures(other, LOOSE, (NCV1, TURNS))["over_closed"]["confirmed"] = of_ratio(0.7, 0.8)
    assert "is not enough" in told(other)[0]


@pytest.mark.parametrize(
    ("loose", "strict", "words"),
    [
        ((1.05, 1.2), (1.05, 1.2), "some of the error"),
        ((1.05, 1.2), (0.95, 1.2), "some of the error with loose starts only"),
        ((0.9, 1.2), (0.95, 1.2), "nothing that can be told"),
    ],
)
def test_what_scheduling_is_worth_is_what_round_robin_loses(street_summary, loose, strict, words):
    other = copy.deepcopy(street_summary)
    for setting, ends in ((LOOSE, loose), (STRICT, strict)):
        figures(other, setting, (VSIMM, TURNS))["over_closed"]["rmse"] = of_ratio(*ends)
        figures(other, setting, (VSIMM, SHORT))["over_closed"]["rmse"] = of_ratio(1.3, 1.4)  # does not decide
    _, where = told(other)
    assert where(f"With the four models, scheduling is worth {words}") == EXTRA


@pytest.mark.parametrize(("last", "words"), [((1.0, 1.1), "is a matter"), ((1.1, 1.3), "is not a matter")])
def test_starts_matter_if_strict_and_loosest_differ(street_summary, last, words):
    other = copy.deepcopy(street_summary)
    for found, ends in ((other["starts"][0], (1.2, 1.4)), (other["starts"][-1], last)):
        found["over_open"]["confirmed"] = of_ratio(*ends)
    assert f"How many more tracks are confirmed {words} of how tracks begin" in told(other)[0]


def test_a_single_run_has_no_interval_and_is_told_all_the_same(street_study):
    one = {case: Runs(*(array[:1] for array in runs)) for case, runs in street_study.runs.items()}
    summary = summarise(Study(street_study.root, one))
    assert figures(summary, LOOSE, CLOSED)["rmse"]["ci"] is None
    text = f"{findings(summary)}{markdown(summary)}"
    assert "nan" not in text
    assert "None" not in text


def test_numbers_of_the_street_in_words():
    assert both(lambda setting: setting.upper()) == "with loose starts LOOSE; with strict ones STRICT"
    assert change({"ratio": 1.2, "ci": [1.1501, 1.2499]}) == "+20.0 % (+15.0 to +25.0)"
    assert change({"ratio": 0.4, "ci": [0.35, 0.45]}) == "-60.0 % (-65.0 to -55.0)"
    assert change({"ratio": 1.01, "ci": None}) == "+1.0 %"
    assert percents({"ci": [0.35, 0.45]}, -1.0) == pytest.approx([55.0, 65.0])
    made_of = {"a": {"mean": 1.0}, "b": {"mean": 0.5}}
    assert origins({"mean": 1.5, "ci": [1.0, 2.0], "origins": made_of}) == "1.50 (1.00 to 2.00): 1.00 a, 0.50 b"
