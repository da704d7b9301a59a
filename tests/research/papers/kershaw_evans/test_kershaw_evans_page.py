"""The results in the repository bear out the notes on the page, which holds no range of its own."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from research.papers.claims import YES
from research.papers.kershaw_evans.claims import check_claims
from research.papers.kershaw_evans.study import BEST, GRID_GATE, POLICIES, POSITION, RATE, SCENES, TRACE
from research.papers.page import END, START, block
from wavegym.systems.kershaw_evans.system import KershawEvans

ROOT = Path(__file__).parents[4]
RESULTS = ROOT / "results" / "kershaw_evans" / "summary.json"
PAGE = (ROOT / "docs" / "papers" / "kershaw_evans.md").read_text("utf-8")


@pytest.fixture(scope="module")
def summary():
    return json.loads(RESULTS.read_text())


def test_the_tables_are_those_of_the_results(summary):
    assert block(summary) in PAGE


def test_the_results_are_of_the_scenes_as_they_are(summary):
    assert summary["runs"] >= 200
    for scene, kind in SCENES.items():
        found = summary["scenes"][scene]
        assert found["start_range"] == list(kind.start_range)
        assert (found["reference_range"], found["q"]) == (kind.reference_range, kind.q)


def test_the_page_names_every_policy_and_no_range():
    written = PAGE[: PAGE.index(START)] + PAGE[PAGE.index(END) :]
    for policy in POLICIES:
        assert f"*{policy}*" in written
    assert not re.search(r"\d\s?km\b|\d\s?us\b", written)
    assert issubclass(SCENES[POSITION], KershawEvans)


def test_the_closed_forms_are_the_optimum(summary):
    exact = [row for row in check_claims(summary) if row.text.endswith("ppm")]
    assert len(exact) == 4 * len(SCENES)
    assert {row.verdict for row in exact} == {YES}


def test_the_notes(summary):
    """A corner in one scene, agility in the other, and the price of the smallest gate."""
    rate, position = (summary["scenes"][scene] for scene in (RATE, POSITION))
    assert rate["closed_forms"]["trace_interior"] == 0.0
    assert rate["policies"][TRACE]["waveforms"]["mean"] == 1.0
    assert rate["policies"][BEST]["cost_ratio"]["ci"][1] < 1.01
    assert position["closed_forms"]["trace_interior"] > 0.5
    assert position["policies"][BEST]["cost_ratio"]["ci"][0] > 1.0
    for scene in (rate, position):
        assert scene["policies"][GRID_GATE]["cost_ratio"]["ci"][0] > 2.0
