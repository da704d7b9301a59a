"""The results in the repository bear out the notes on the page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from research.papers.agile_clutter.study import BEST_FIXED, FREE, FULL, LINEAR, SHAPES
from research.papers.agile_clutter.table import markdown

ROOT = Path(__file__).parents[4]
RESULTS = ROOT / "results" / "agile_clutter" / "summary.json"


@pytest.fixture(scope="module")
def summary():
    return json.loads(RESULTS.read_text())


@pytest.fixture(params=["jpda", "particle"])
def settings(summary, request):
    """(in clutter, without)"""
    return summary["trackers"][request.param]["clutter"], summary["trackers"][request.param]["no clutter"]


def test_the_results_have_the_runs_of_the_paper(summary):
    assert summary["runs"] == 500


def test_the_gain_is_one_in_clutter(settings):
    clutter, without = settings
    assert clutter["policies"][LINEAR]["ratio_kept"]["ci"][0] > 1
    others = {name: policy["ratio_all"] for name, policy in without["policies"].items() if name != FULL}
    assert others[FREE]["geometric_ci"][1] < 1.1
    assert all(ratio["ci"][1] < 1.1 for name, ratio in others.items() if name != FREE)
    assert clutter["policies"][LINEAR]["clutter_1"]["ci"][0] > 5 * clutter["policies"][FULL]["clutter_1"]["ci"][1]


def test_with_several_shapes_the_chirp_still_changes(settings):
    choices = settings[0]["choices"][FREE]
    assert choices["kind"]["all"]["HFM"]["ci"][1] < 0.01
    assert choices["share"]["early"]["EFM0.1"]["ci"][0] > 0.5
    assert choices["share"]["jump"]["EFM0.1"]["ci"][0] > 0.5
    assert choices["share"]["late"]["PFM3"]["ci"][0] > 0.5
    assert settings[0]["policies"][FREE]["ratio_kept"]["ci"][1] < 0.7


def test_the_best_fixed_chirp_is_as_good_with_particles_and_worse_with_jpda(summary):
    found = (summary["trackers"][name]["clutter"]["policies"][BEST_FIXED] for name in ("particle", "jpda"))
    particle, jpda = (policy["ratio_kept"]["ci"] for policy in found)
    assert particle[1] < 1.2
    assert jpda[0] > 1


def test_the_mean_is_above_the_median(settings):
    everything = settings[0]["policies"][FULL]["mse_all"]
    assert everything["mean"] > 2 * everything["median"]


def test_the_errata_list_the_shapes():
    text = (ROOT / "docs" / "errata.md").read_text()
    shapes = {kind: [s.partition(":")[2] for s in SHAPES if s.startswith(kind)] for kind in ("pfm", "hfm", "efm")}
    assert f"kappa {', '.join(shapes['pfm'])} and g {', '.join(shapes['hfm'])}" in text
    assert shapes["hfm"] == shapes["efm"]


def test_a_tracker_alone_has_tables_too(summary):
    alone = markdown({**summary, "trackers": {"jpda": summary["trackers"]["jpda"]}, "convergence": {}})
    assert "particle" not in alone
    assert "best fixed, shapes free" in alone


def test_small_shares_are_not_listed(summary):
    assert "| jpda | clutter | fully agile | 20 to 25 | PFM3 93.9, HFM 6.1 |" in markdown(summary)
