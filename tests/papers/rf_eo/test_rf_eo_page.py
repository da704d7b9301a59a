"""What the RF/EO page says of the results kept, and that they bear out what it says."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from papers.claims import lies, side
from papers.page import END, START, block, main
from papers.rf_eo.study import ADAPTIVE, CONSTANT, FAR, INFORMATION, POLICIES, PROPOSED, PUBLISHED, SCENES
from papers.rf_eo.claims import ALTERNATES
from wavegym.reproduce.rf_eo_words import angles, both, jumped, slots

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "results" / "rf_eo" / "summary.json"
PAGE = ROOT / "docs" / "reproduce_rf_eo.md"


@pytest.fixture(scope="module")
def kept():
    return json.loads(RESULTS.read_text())


@pytest.fixture(scope="module")
def policies(kept):
    return {scene: kept["scenes"][scene]["policies"] for scene in SCENES}


def test_the_page_is_made_from_the_results_kept(kept):
    assert block(kept) in PAGE.read_text()
    assert kept["runs"] >= 20
    assert {scene: found["horizon"] for scene, found in kept["scenes"].items()} == {PUBLISHED: 1000, FAR: 200}


def test_the_page_names_every_policy():
    text = PAGE.read_text()
    for name in {name.partition(":")[0] for scene in SCENES for name in POLICIES[scene]} - {"fixed"}:
        assert f"*{name}" in text
    assert f"*{PROPOSED}*" in text


def test_adapting_beats_the_tuned_constant(policies):
    for scene in SCENES:
        assert policies[scene][CONSTANT]["over_myopic"]["ci"][0] > 1


def test_the_fixed_settings_err_ten_times_as_much(policies):
    assert policies[PUBLISHED][PROPOSED]["late_over_myopic"]["ci"][0] > 10


def test_the_prf_alternates_before_far_targets_only(policies):
    """Of both platforms' steps together, by the interval, as the finding has it."""
    for name in (ADAPTIVE, INFORMATION):
        assert policies[PUBLISHED][name]["jumps"]["mean"] == 0
        assert policies[FAR][name]["jumps"]["ci"][0] > ALTERNATES


def test_the_pixel_angle_adapts(kept):
    for found in kept["scenes"][PUBLISHED]["adaptation"].values():
        assert all(factor["geometric_ci"][0] > 2 for factor in found["factor"])


def test_the_filter_is_consistent_from_the_first_step(policies):
    for scene in SCENES:
        nees = policies[scene][ADAPTIVE]["nees"]
        assert nees["band"][0] <= nees["first"] <= nees["band"][1]
        assert nees["inside"] >= 0.9
        assert nees["inside_settled"] >= 0.9


def test_a_deeper_lookahead_costs_more_time_and_less_trace(kept):
    for found in kept["scenes"].values():
        ahead = found["lookahead"]
        assert ahead["10"]["us_per_decision"] > ahead["2"]["us_per_decision"]
        assert ahead["10"]["ci"][0] > 0
        assert ahead["1"]["percent"] == pytest.approx(0, abs=1e-6)


def test_the_block_is_renewed_and_the_rest_left(kept, tmp_path):
    page, old = tmp_path / "page.md", f"{START}\n\n{block(kept)}\n\n{END}"
    page.write_text("before\n" + re.sub(r"\d(?=\d)", "7", old) + "\nafter\n")
    assert main([str(RESULTS), str(page)]) == 0
    assert page.read_text() == f"before\n{old}\nafter\n"


def test_numbers_in_words():
    assert [side(ci, 1.0) for ci in ([1.1, 2], [0.1, 0.9], [0.5, 1.5], None)] == ["above", "below", "around", "unknown"]
    assert lies([1.1, 2], 1.0) == "the interval lies above 1"
    assert lies([0.5, 2], 1.0) == "the interval holds 1"
    assert angles([1e-4, 2e-4, 3e-3]) == "0.20 (0.10 to 3.00)"
    share = {"mean": 0.25, "ci": [0.1, 0.5]}
    told = "25.0 % (10.0 to 50.0)"
    assert jumped({**share, "platforms": [share, share]}) == f"{told}: {told} at platform 1, {told} at platform 2"
    assert slots([[[1e3, 2e7, 1e-3], [2e3, 2e7, 1e-4]]]) == "1 kHz 20 MHz 1 mrad / 2 kHz 20 MHz 0.1 mrad"
    summary = {"scenes": {PUBLISHED: {"x": 1}, FAR: {"x": 2}}}
    assert both(summary, str, "x") == "1 in the published scene and 2 in the far one"
    assert both(summary, lambda x: "so", "x") == "so in either scene"
