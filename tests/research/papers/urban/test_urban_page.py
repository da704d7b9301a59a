"""The results in the repository bear out the notes on the page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from research.papers.urban.false_tracks import ORIGINS
from research.papers.urban.numbers import figures_of, phase_of
from research.papers.urban.study import CLOSED, LONG, LOOSE, MYOPIC, NCV, NCV1, POLICIES, SETTINGS, STRICT, TURNS, VSIMM

ROOT = Path(__file__).parents[4]
RESULTS = ROOT / "results" / "urban" / "summary.json"
PAGE = ROOT / "docs" / "papers" / "urban.md"


@pytest.fixture(scope="module")
def summary():
    return json.loads(RESULTS.read_text())


def test_the_results_are_of_whole_runs(summary):
    assert summary["runs"] >= 100  # the paper's number
    assert summary["scans"] == 140


def test_the_page_names_every_policy_and_every_kind_of_false_track():
    text = PAGE.read_text()
    for name in (*POLICIES, *SETTINGS, *ORIGINS, VSIMM, NCV, NCV1):
        assert f"*{name}*" in text


@pytest.mark.parametrize("setting", SETTINGS)
def test_the_closed_loop_beats_the_open_one(summary, setting):
    over = figures_of(summary, setting, CLOSED)["over_open"]
    assert over["confirmed"]["ci"][0] > 1.1
    assert over["rmse"]["ci"][1] < 0.4
    assert over["held"]["ci"][0] > 1.5
    assert over["gospa"]["ci"][1] < 1


@pytest.mark.parametrize("setting", SETTINGS)
def test_the_gain_comes_from_the_filter(summary, setting):
    """Either half by itself; and one NCV that expects more, in an open loop."""
    assert figures_of(summary, setting, (VSIMM, TURNS))["over_open"]["rmse"]["ci"][1] < 0.4
    assert figures_of(summary, setting, (NCV, MYOPIC))["over_open"]["rmse"]["ci"][0] > 0.95
    one_model = figures_of(summary, setting, (NCV1, TURNS))["over_closed"]["rmse"]
    assert one_model["ci"][0] < 1 if setting == STRICT else 1 < one_model["ci"][0] < one_model["ratio"] < 1.06
    assert figures_of(summary, setting, (VSIMM, LONG))["over_closed"]["rmse"]["ci"][0] < 1.05
    assert figures_of(summary, setting, CLOSED)["long"]["mean"] == 1


@pytest.mark.parametrize("setting", SETTINGS)
def test_the_models_know_the_turn_and_the_acceleration_and_later_the_straight(summary, setting):
    for phase in ("left turn", "speeding up"):
        found = phase_of(summary, setting, phase)
        assert found["least"]["ci"][0] > 0.8
    on = phase_of(summary, setting, "driving on")
    assert 105 < on["known_from"] <= 110
    braking = phase_of(summary, setting, "braking")["mean"]
    assert 0.2 < braking["NCA"]["mean"] < 0.6
    assert 0.4 < braking["CT left"]["mean"] < 0.7


def test_the_looser_the_start_the_more_the_open_loop_confirms(summary):
    more = [of["over_open"]["confirmed"]["ratio"] for of in summary["starts"]]
    assert more == sorted(more, reverse=True)
    assert more[0] > 1.5 > 1.2 > more[-1]
    assert all(of["over_open"]["rmse"]["ci"][1] < 0.4 for of in summary["starts"])


def test_strict_starts_leave_few_false_tracks(summary):
    assert figures_of(summary, STRICT, CLOSED)["false_tracks"]["ci"][1] < 0.3
    assert figures_of(summary, LOOSE, CLOSED)["false_tracks"]["ci"][0] > 0.3
    for setting in SETTINGS:
        assert summary["settings"][setting]["ghosts_over_none"]["closed"]["held"]["ci"][0] > 0.99
