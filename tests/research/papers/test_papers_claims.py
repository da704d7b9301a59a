"""Verdicts follow from intervals and limits, and the table shows both."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from research.papers.cells import between, written
from research.papers.claims import (
    HEAD,
    NO,
    PARTLY,
    UNDECIDED,
    YES,
    Limit,
    claim,
    decrease_of,
    geometric_of,
    increase_of,
    markdown,
    mean_of,
    percent_of,
    ratio_of,
    verdict,
)
from wavegym.evaluation.statistics import Estimate

ABOVE, BELOW, RANGE = Limit(low=10.0), Limit(high=1.0), Limit(10.0, 15.0, partly=(0.0, float("inf")))


@pytest.mark.parametrize(
    ("ci", "limit", "wanted"),
    [
        ((11.0, 20.0), ABOVE, YES),
        ((8.0, 20.0), ABOVE, UNDECIDED),
        ((2.0, 9.0), ABOVE, NO),
        (None, ABOVE, UNDECIDED),
        ((0.8, 0.9), BELOW, YES),
        ((0.8, 1.1), BELOW, UNDECIDED),
        ((1.1, 1.2), BELOW, NO),
        ((11.0, 14.0), RANGE, YES),
        ((16.0, 20.0), RANGE, PARTLY),
        ((2.0, 8.0), RANGE, PARTLY),
        ((8.0, 16.0), RANGE, PARTLY),
        ((-1.0, 12.0), RANGE, UNDECIDED),
        ((-1.0, 8.0), RANGE, NO),
        ((-5.0, -1.0), RANGE, NO),
    ],
)
def test_a_verdict_follows_from_the_interval(ci, limit, wanted):
    assert verdict(ci, limit) == wanted


@given(st.floats(-50, 50), st.floats(0, 20), st.floats(-50, 50), st.floats(0.1, 20))
def test_yes_and_no_need_the_whole_interval(low, width, edge, span):
    """Each point of the interval agrees with the verdict; an undecided interval contains an edge."""
    ci, limit = (low, low + width), Limit(edge, edge + span)
    inside = [limit.low < end < limit.high for end in ci]
    found = verdict(ci, limit)
    assert (found == YES) == all(inside)
    if found == NO:
        assert not any(inside)
    if found == UNDECIDED:
        assert any(ci[0] <= end <= ci[1] for end in (limit.low, limit.high))


def test_the_value_itself_does_not_decide():
    assert claim("", "", Estimate(12.0, (9.0, 15.0)), ABOVE).verdict == UNDECIDED
    assert claim("", "", Estimate(12.0, None), ABOVE).verdict == UNDECIDED


def test_the_table_shows_measurement_limit_and_verdict():
    row = claim("A beats B: ratio", "far", Estimate(1.2345, (1.1011, 1.3019)), Limit(low=1.0), "better")
    head, _, line = markdown([row]).splitlines()
    assert [cell.strip() for cell in head.split("|")[1:-1]] == list(HEAD)
    cells = [cell.strip() for cell in line.split("|")[1:-1]]
    assert cells == ["A beats B: ratio", "far", "1.23", "1.10 to 1.31", "better", "> 1", "yes"]
    assert [str(limit) for limit in (ABOVE, BELOW, RANGE)] == ["> 10", "< 1", "10 to 15 (partly: > 0)"]


def test_estimates_come_from_a_summary():
    ratio = {"ratio": 0.4, "ci": [0.35, 0.5], "geometric": 0.3, "geometric_ci": [0.2, 0.4]}
    assert ratio_of(ratio) == (0.4, (0.35, 0.5))
    assert geometric_of(ratio) == (0.3, (0.2, 0.4))
    assert mean_of({"mean": None, "ci": None}) == (None, None)
    assert percent_of(mean_of({"mean": 0.5, "ci": [0.25, 0.75]})) == (50.0, (25.0, 75.0))
    assert increase_of(ratio_of(ratio)) == (pytest.approx(-60.0), pytest.approx((-65.0, -50.0)))
    assert decrease_of(ratio_of(ratio)) == (pytest.approx(60.0), pytest.approx((50.0, 65.0)))
    assert decrease_of(Estimate(None, None)) == (None, None)


@given(st.floats(-1e6, 1e6), st.floats(0, 1e6), st.integers(0, 3))
def test_intervals_are_rounded_outwards(low, width, digits):
    first, last = (float(end) for end in between([low, low + width], digits).split(" to "))
    assert first <= low + 1e-6
    assert last >= low + width - 1e-6
    assert last - first <= width + 2.0001 * 10**-digits


def test_numbers_as_cells():
    assert written(0.945, 1) == "0.9"
    assert written(None, 1) == between(None, 1) == "–"
