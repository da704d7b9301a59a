from __future__ import annotations

import time

import numpy as np
import pytest

from wavegym.schedulers.heuristics.cma_search import (
    Budget,
    Interval,
    constants_on_fresh_worlds,
    minimised,
    searched_constants,
)

CENTRE = np.array([0.7, -1.3, 2.1])


def bowl(x):
    """Least, 1, at CENTRE; badly scaled."""
    return 1.0 + float(((x - CENTRE) ** 2 * np.array([1.0, 30.0, 900.0])).sum())


def test_the_minimum_of_a_badly_scaled_bowl_is_found():
    found = minimised(bowl, np.zeros(3), 0.5, Budget(900), 1.0, 0)
    np.testing.assert_allclose(found.point, CENTRE, atol=1e-3)
    np.testing.assert_allclose(found.mean, CENTRE, atol=1e-2)
    assert found.cost == bowl(found.point)


def test_one_coordinate_is_enough():
    found = minimised(lambda x: float((x[0] - 0.3) ** 2), np.zeros(1), 0.5, Budget(300), 1.0, 0)
    assert found.point.shape == (1,)
    assert found.point[0] == pytest.approx(0.3, abs=1e-3)


def test_the_result_is_never_worse_than_the_start_and_infinite_costs_do_no_harm():
    def cost(x):
        return np.inf if x[0] > 0.1 else float(((x + 1.0) ** 2).sum())

    found = minimised(cost, np.zeros(2), 0.5, Budget(400), 1.0, 0)
    np.testing.assert_allclose(found.point, -1.0, atol=1e-2)
    only = minimised(lambda x: 0.0 if not x.any() else np.inf, np.zeros(2), 0.5, Budget(50), 1.0, 0)
    assert not only.point.any()


def test_evaluations_are_counted_and_never_exceeded():
    calls = []

    def cost(x):
        calls.append(x)
        return bowl(x)

    budget = Budget(57)
    minimised(cost, np.zeros(3), 0.5, budget, 1.0, 0)
    assert len(calls) == budget.evaluations == 57


def test_a_share_of_the_budget_ends_a_search_and_leaves_the_rest():
    budget = Budget(100)
    ends = []
    for until in budget.parts(4):
        minimised(bowl, np.zeros(3), 0.5, budget, until, 0)
        ends.append(budget.evaluations)
    assert ends == [25, 50, 75, 100]


def test_the_same_seed_finds_the_same_and_another_seed_another_point():
    a, b, c = (minimised(bowl, np.zeros(3), 0.5, Budget(60), 1.0, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(a.point, b.point)
    assert not np.array_equal(a.point, c.point)


def test_no_global_random_numbers_are_drawn():
    before = np.random.get_state()[1].tobytes()  # noqa: NPY002
    minimised(bowl, np.zeros(3), 0.5, Budget(30), 1.0, 0)
    assert np.random.get_state()[1].tobytes() == before  # noqa: NPY002


def test_cpu_seconds_end_a_search():
    def slow(x):
        end = time.process_time() + 0.002
        while time.process_time() < end:
            pass
        return bowl(x)

    budget = Budget(seconds=0.1)
    minimised(slow, np.zeros(3), 0.5, budget, 1.0, 0)
    assert 5 <= budget.evaluations <= 51
    assert budget.used == pytest.approx(0.1, abs=0.05)


def test_constants_stay_within_their_intervals_and_the_best_start_counts():
    intervals = {"a": Interval(1.0, 1e4, is_log=True), "b": Interval(0.0, 2.0)}

    def cost(constants):
        return (np.log10(constants["a"]) - 2.5) ** 2 + (constants["b"] - 5.0) ** 2  # b: beyond its interval

    starts = [{"a": 1.0, "b": 1.0}, {"a": 100.0, "b": 1.0}]
    budget = Budget(300)
    found, least = searched_constants(cost, intervals, starts, budget, 0)
    assert found["b"] == 2.0
    assert found["a"] == pytest.approx(10**2.5, rel=0.05)
    assert least == cost(found)
    assert budget.evaluations <= 300
    first, _ = searched_constants(cost, intervals, starts, Budget(2), 0)
    assert first == starts[1]


@pytest.mark.parametrize("interval", [Interval(0.01, 1e7, is_log=True), Interval(-1.0, 3.0)])
def test_share_and_value_are_inverse(interval):
    for share in (0.0, 0.25, 1.0):
        assert interval.share(interval.value(share)) == pytest.approx(share, abs=1e-4)
    assert interval.value(-1.0) == interval.low
    assert interval.value(2.0) == interval.high


def test_constants_from_fresh_worlds_are_fitted_to_none_of_them():
    """Noise that differs between generations, not within one, cannot be fitted; the gain is that on other worlds."""
    met = set()

    def costs(generation, constants):
        met.add(generation)
        rng = np.random.default_rng(generation + 1)
        tilt, noise = rng.normal(size=2), rng.normal(size=50)
        x = np.array([constants["a"], np.log(constants["b"])])
        return float(((x - [0.3, 0.5]) ** 2).sum() + 0.02 * tilt @ x) + noise

    intervals = {"a": Interval(-2.0, 2.0), "b": Interval(0.1, 10.0, is_log=True)}
    start, budget = {"a": 0.0, "b": 1.0}, Budget(400)
    found, gained = constants_on_fresh_worlds(costs, intervals, start, budget, 0)
    assert found["a"] == pytest.approx(0.3, abs=0.05)
    assert np.log(found["b"]) == pytest.approx(0.5, abs=0.05)
    assert met == set(range(-1, max(met) + 1))
    assert len(met) > 400 // 10  # a generation has six points in two dimensions
    assert budget.evaluations >= 400
    want = costs(-1, found) - costs(-1, start)
    np.testing.assert_array_equal(gained, want)
    assert gained.mean() < 0.0
