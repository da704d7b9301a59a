"""What the page says of the results kept, and that they bear out what it says."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from papers.agile_clutter.study import BEST_FIXED, BEST_FREE, FREE, FULL, LINEAR, SHAPES
from wavegym.reproduce.agile_clutter_words import commonest, each, never, spans
from papers.page import END, START, block, main, renewed
from papers.cells import between, written

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "results" / "agile_clutter" / "summary.json"
PAGE = ROOT / "docs" / "reproduce.md"


@pytest.fixture(scope="module")
def kept():
    return json.loads(RESULTS.read_text())


@pytest.fixture(params=["jpda", "particle"])
def settings(kept, request):
    """(in clutter, without)"""
    return kept["trackers"][request.param]["clutter"], kept["trackers"][request.param]["no clutter"]


def test_the_page_is_made_from_the_results_kept(kept):
    assert block(kept) in PAGE.read_text()
    assert kept["runs"] == 500


def test_the_agile_scheduler_beats_lfm_in_clutter_and_only_there(settings):
    clutter, without = settings
    assert clutter["policies"][LINEAR]["ratio_kept"]["ci"][0] > 4
    assert without["policies"][LINEAR]["ratio_all"]["ci"][1] < 1.1
    assert clutter["policies"][LINEAR]["ratio_all"]["ci"][0] > 1


def test_the_error_jumps_and_drops(settings):
    assert settings[0]["jump"]["ci"][0] > 1
    assert settings[0]["drop"]["ci"][1] < 1


def test_hfm_is_chosen_early_and_pfm_late_of_one_shape_each(settings):
    choices = settings[0]["choices"][FULL]
    for window, kind in (("early", "HFM"), ("jump", "HFM"), ("late", "PFM")):
        assert choices["kind"][window][kind]["ci"][0] > 0.5
    assert choices["kind"]["all"]["LFM"]["ci"][1] < 0.01
    assert choices["linear"]["ci"][1] < 0.01


def test_with_the_shapes_free_the_chirp_still_changes_but_is_another(settings):
    choices = settings[0]["choices"][FREE]
    assert choices["kind"]["all"]["HFM"]["ci"][1] < 0.01
    assert choices["kind"]["all"]["LFM"]["ci"][1] < 0.01
    assert choices["share"]["early"]["EFM0.1"]["ci"][0] > 0.5
    assert choices["share"]["jump"]["EFM0.1"]["ci"][0] > 0.5
    assert choices["share"]["late"]["PFM3"]["ci"][0] > 0.5
    assert settings[0]["policies"][FREE]["ratio_kept"]["ci"][1] < 0.7


def test_the_best_fixed_chirp_is_no_worse_than_a_fifth(settings):
    assert settings[0]["policies"][BEST_FIXED]["ratio_kept"]["ci"][1] < 1.2


def test_the_errata_list_the_shapes():
    text = (ROOT / "docs" / "errata.md").read_text()
    shapes = {kind: [s.partition(":")[2] for s in SHAPES if s.startswith(kind)] for kind in ("pfm", "hfm", "efm")}
    assert f"kappa {', '.join(shapes['pfm'])} and g {', '.join(shapes['hfm'])}" in text
    assert shapes["hfm"] == shapes["efm"]


@given(st.floats(-1e6, 1e6), st.floats(0, 1e6), st.integers(0, 3))
def test_intervals_are_rounded_outwards(low, width, digits):
    first, last = (float(end) for end in between([low, low + width], digits).split(" to "))
    assert first <= low + 1e-6
    assert last >= low + width - 1e-6
    assert last - first <= width + 2.0001 * 10**-digits


def test_numbers_in_words():
    assert written(0.945, 1) == "0.9"
    assert written(None, 1) == between(None, 1) == "–"
    assert spans([["HFM", "HFM", "PFM3"], ["HFM", "HFM", "PFM3"]]) == "HFM at k = 1 to 2, PFM3 at k = 3"
    assert spans([["HFM"], ["EFM"]]) == "at sensor A HFM at k = 1; at sensor B EFM at k = 1"
    assert commonest({"LFM": {"mean": 0.0}, "HFM": {"mean": 0.25}, "EFM": {"mean": 0.746}}) == "EFM 74.6 %, HFM 25.0 %"
    linear = {"choices": 0, "of": 640, "runs": 0, "kept": 10, "ci": [0.0, 0.3085]}
    assert never(linear) == "0 of 640 choices (0 of 10 runs: 0.00 to 30.85 %)"
    summary = {"trackers": {"jpda": {"clutter": {"x": 1}}, "particle": {"clutter": {"x": 2}}}}
    assert each(summary, str, "x") == "1 with JPDA and 2 with the particle filter"
    assert each(summary, lambda x: "so", "x") == "so with either tracker"


def test_the_block_is_renewed_and_the_rest_left(kept, tmp_path, capsys):
    page = tmp_path / "page.md"
    old = f"{START}\n\n{block(kept)}\n\n{END}"
    page.write_text("before\n" + re.sub(r"\d(?=\d)", "7", old) + "\nafter\n")
    assert main([str(RESULTS), str(page)]) == 0
    assert page.read_text() == f"before\n{old}\nafter\n"
    page.write_text("no block")
    assert main([str(RESULTS), str(page)]) == main([str(RESULTS)]) == 2
    assert page.read_text() == "no block"
    assert all(line.startswith("error: ") for line in capsys.readouterr().err.splitlines())
    assert renewed(old, kept) == old


def test_a_tracker_alone_is_told_too(kept):
    told = block({**kept, "trackers": {"jpda": kept["trackers"]["jpda"]}, "convergence": {}})
    assert "particle" not in told
    assert BEST_FREE in told
