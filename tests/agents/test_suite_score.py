"""Figures over a suite against their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from agents import board
from agents.suite_score import over_suite, profile, suite_score
from wavegym.evaluation import submission

SUITE = ["a", "b", "c"]


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_figures_are_those_of_their_definitions() -> None:
    logs = {"a": np.log([0.5, 1.0, 2.0, 0.8]), "b": np.log([0.9, 0.9, 0.9, 0.9])}
    found, ratios = suite_score(logs, SUITE, rng()), [0.5, 1.0, 2.0, 0.8, 0.9, 0.9, 0.9, 0.9, 1.0, 1.0, 1.0, 1.0]
    assert found.mean.value == pytest.approx(100.0 * (np.prod(ratios) ** (1.0 / 12.0) - 1.0))
    middle = sorted(ratios)[3:9]
    assert found.interquartile.value == pytest.approx(100.0 * (np.prod(middle) ** (1.0 / 6.0) - 1.0))
    assert found.improvement.value == pytest.approx((6 + 0.5 * 5) / 12)
    table = over_suite(logs, SUITE)
    assert table.shape == (3, 4)
    shares = profile(table, np.array([-50.1, -50.0 + 1e-9, -10.0 + 1e-9, 0.0, 100.0 + 1e-9]))
    np.testing.assert_allclose(shares * 12.0, [0, 1, 6, 11, 12])


@pytest.mark.slow
def test_intervals_cover_the_mean_as_often_as_they_say() -> None:
    """Of 200 suites of normal logarithms; 95 % of a binomial of 200 lie above 184."""
    draws, covered = np.random.default_rng(1), 0
    for _ in range(200):
        logs = {name: draws.normal(-0.1, 0.3, 60) for name in SUITE}
        found = suite_score(logs, SUITE, rng()).mean
        assert found.ci is not None
        covered += found.ci[0] <= 100.0 * np.expm1(-0.1) <= found.ci[1]
    assert covered > 180


def test_the_board_lists_the_cheapest_first_and_draws_all() -> None:
    def record(name: str, ratio: float) -> dict[str, object]:
        simple = [1.0, 2.0, 4.0]
        own = {"cost": [ratio * cost for cost in simple], "simple_cost": simple}
        own["bound"] = [0.8**2 * cost for cost in simple]
        found = {**own, "error": [None] * 3, "simple_error": [None] * 3, "microseconds": 5.0}
        declared = {"steps": 10, "cpu_seconds": None}
        environments = {"wavegym/EnergyBudgetKnown-v0": {**found, **declared}}
        return {"name": name, "code": "here", "seed": 1, "worlds": 3, "environments": environments}

    records = [record("dear", 1.2), record("cheap", 0.8)]
    lines = board.scores(records).splitlines()
    assert [line.split("|")[1].strip() for line in lines[2:]] == ["cheap", "dear"]
    (own,) = submission.table(records[1]).splitlines()[2:]
    cells = [cell.strip() for cell in own.split("|")[1:-1]]
    assert cells == [
        "EnergyBudgetKnown-v0",
        "-20.0",
        "-20.0 to -20.0",
        "",
        "",
        "-36.0",
        "50 %",
        "50 to 50",
        "5",
        "10",
        "",
    ]
    assert board.picture(records).startswith(b"\x89PNG")
