"""Policies that belief and truth rank differently are named, others are not."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from wavegym.evaluation.consistency import reversals
from wavegym.evaluation.play import EpisodeResults
from wavegym.evaluation.table import order_sentence

WORLDS = 200
RNG = np.random.default_rng(0)
LEVEL = RNG.lognormal(0.0, 1.0, (1, WORLDS))  # of each world, the same for all policies


def results(cost, error, members=1, gospa=None):
    """Episodes at these factors of the worlds' levels, with noise of a tenth."""
    noise = RNG.lognormal(0.0, 0.1, (2, members, WORLDS))
    nothing = np.full((members, WORLDS), np.nan)
    reported = nothing if gospa is None else np.sqrt(gospa * LEVEL * noise[1])
    root = np.sqrt(error * LEVEL * noise[1])
    return EpisodeResults(cost * LEVEL * noise[0], root, nothing, reported, nothing, nothing, nothing)


def test_a_pair_with_two_orders_is_named():
    by_policy = {"honest": results(1.0, 1.0), "flattered": results(0.8, 1.3, members=3), "worse": results(2.0, 2.0)}
    (pair,) = reversals(by_policy, 0)
    assert (pair["policy"], pair["reference"]) == ("honest", "flattered")
    # The geometric mean of 3 noisy members against one: 1/8 of a noise of 0.1 each way, over 200 worlds.
    assert pair["belief"] == pytest.approx(25.0, abs=4.0)
    assert pair["truth"] == pytest.approx(-23.1, abs=4.0)
    text = order_sentence([pair])
    assert text.startswith("Belief and truth rank these policies differently: honest against flattered +2")
    assert text.endswith(" % by truth.")


def test_a_difference_within_the_noise_is_not_named():
    alike = {f"policy {i}": results(1.0, 1.0) for i in range(8)}
    logs = [[np.log(a.cost).mean(), np.log(a.squared_error).mean()] for a in alike.values()]
    assert any((x[0] - y[0]) * (x[1] - y[1]) < 0.0 for x, y in combinations(logs, 2))
    # Both intervals of one of 28 pairs would exclude 0, on opposite sides, in one such comparison of thirty.
    assert reversals(alike, 0) == []
    assert reversals({"honest": results(1.0, 1.0), "same": results(0.8, 1.0), "also": results(1.0, 1.4)}, 0) == []
    assert order_sentence([]).startswith("Wherever both differences")


def test_policies_that_played_alike_are_named_once():
    honest = results(1.0, 1.0)
    found = reversals({"first": honest, "alias": honest, "flattered": results(0.8, 1.3)}, 0)
    assert [(pair["policy"], pair["reference"]) for pair in found] == [("first", "flattered")]


def test_the_gospa_distance_decides_where_it_is_reported():
    by_position = {"a": results(1.0, 1.0), "b": results(0.8, 1.3)}
    by_gospa = {"a": results(1.0, 1.0, gospa=2.0), "b": results(0.8, 1.3, gospa=1.0)}
    assert by_gospa["a"].in_gospa
    assert len(reversals(by_position, 0)) == 1
    assert reversals(by_gospa, 0) == []


def test_without_errors_by_truth_there_is_no_second_order():
    nothing = results(1.0, np.nan)
    assert reversals({"a": nothing, "b": results(0.5, np.nan)}, 0) == []
