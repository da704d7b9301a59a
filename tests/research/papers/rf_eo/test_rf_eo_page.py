"""The results in the repository bear out the notes on the page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from research.papers.rf_eo.claims import ALTERNATES
from research.papers.rf_eo.study import ADAPTIVE, FAR, INFORMATION, MARGIN, POLICIES, PROPOSED, PUBLISHED, SCENES

ROOT = Path(__file__).parents[4]
RESULTS = ROOT / "results" / "rf_eo" / "summary.json"
PAGE = ROOT / "docs" / "papers" / "rf_eo.md"


@pytest.fixture(scope="module")
def summary():
    return json.loads(RESULTS.read_text())


@pytest.fixture(scope="module")
def policies(summary):
    return {scene: summary["scenes"][scene]["policies"] for scene in SCENES}


def test_the_results_are_of_whole_runs(summary):
    assert summary["runs"] >= 20
    assert {scene: found["horizon"] for scene, found in summary["scenes"].items()} == {PUBLISHED: 1000, FAR: 200}


def test_the_page_names_every_policy():
    text = PAGE.read_text()
    for name in {name.partition(":")[0] for scene in SCENES for name in POLICIES[scene]} - {"fixed"}:
        assert f"*{name}" in text
    assert f"*{PROPOSED}*" in text


def test_the_prf_alternates_before_far_targets_only(policies):
    for name in (ADAPTIVE, INFORMATION):
        assert policies[PUBLISHED][name]["jumps"]["mean"] == 0
        assert policies[FAR][name]["jumps"]["ci"][0] > ALTERNATES.low / 100


def test_the_objectives_agree_in_the_published_scene_only(summary):
    agreement = {scene: found["agreement"] for scene, found in summary["scenes"].items()}
    assert agreement[PUBLISHED]["both"]["ci"][0] > 0.8
    assert agreement[FAR]["prf"]["ci"][1] < 0.2


def test_a_few_runs_without_a_margin_dominate_the_mean(policies):
    with_margin, without = (policies[FAR][name] for name in (ADAPTIVE, MARGIN[FAR]))
    assert without["missed_first"]["mean"] > 0 == with_margin["missed_first"]["mean"]
    assert without["cost"]["mean"] > 10 * with_margin["cost"]["mean"]
    assert without["cost"]["median"] < 1.1 * with_margin["cost"]["median"]


def test_the_filter_is_consistent_from_the_first_step(policies):
    for scene in SCENES:
        nees = policies[scene][ADAPTIVE]["nees"]
        assert nees["band"][0] <= nees["first"] <= nees["band"][1]
        assert nees["inside"] >= 0.9
        assert nees["inside_settled"] >= 0.9


def test_a_deeper_lookahead_costs_more_time_and_less_trace(summary):
    for found in summary["scenes"].values():
        ahead = found["lookahead"]
        assert ahead["10"]["us_per_decision"] > ahead["2"]["us_per_decision"]
        assert ahead["10"]["ci"][0] > 0
        assert ahead["1"]["percent"] == pytest.approx(0, abs=1e-6)
