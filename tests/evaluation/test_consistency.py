"""Consistent, overconfident and underconfident trackers are each called by the right word.

Policies that belief and truth rank differently are named, others are not.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from evaluation_systems import Walker

from wavegym.core.worlds import world_seeds
from wavegym.evaluation import summarise
from wavegym.evaluation.comparison import Comparison
from wavegym.evaluation.consistency import consistency, flag_of, flag_of_ratio, nees_bounds, reversals, steps_outside
from wavegym.evaluation.play import EpisodeResults, Task, merged, play, results_of
from wavegym.evaluation.statistics import Estimate
from wavegym.evaluation.table import markdown, order_sentence
from wavegym.schedulers import Fixed, Myopic

SEEDS = world_seeds(0, "test", 300)


def rng():
    return np.random.default_rng(0)


def task(believed):
    return Task("tests/Walker-v0", Walker(believed=believed), None, {})


def moments(believed, noise):
    """The error's true variance and the variance by belief after each step, from the recursion of both, (H,) each."""
    true, variance, found = 0.0, 0.0, []
    for _ in range(30):
        gain = (variance + 1.0) / (variance + 1.0 + (believed * noise) ** 2)
        true = (1.0 - gain) ** 2 * (true + 1.0) + gain**2 * noise**2
        variance = (1.0 - gain) * (variance + 1.0)
        found.append((true, variance))
    return np.array(found).T


@pytest.mark.parametrize(("believed", "flag"), [(1.0, ""), (0.5, "high"), (2.0, "low")])
def test_a_wrong_measurement_noise_is_flagged_and_the_right_one_is_not(believed, flag):
    played = play(task(believed), Fixed(1), SEEDS)
    found = consistency(results_of([played]), 1, rng())
    true, variance = moments(believed, 2.0)
    low, high = found.nees.ci
    assert low < (true / variance).mean() < high
    assert high - low < 0.35 * found.nees.value
    assert found.flag == flag
    low, high = found.true_over_believed.ci
    assert low < true.mean() / variance.mean() < high
    assert (low < 1.0 < high) == (not flag)
    assert found.ratio_flag == flag


def test_one_step_in_twenty_of_a_consistent_tracker_is_outside_its_bounds():
    shares = [steps_outside([play(task(1.0), Fixed(1), world_seeds(seed, "test", 100))], 1) for seed in range(40)]
    # The spread of the shares between comparisons holds the correlation of steps; five standard errors.
    assert abs(np.mean(shares) - 0.05) < 5 * np.std(shares, ddof=1) / np.sqrt(len(shares))
    assert np.mean(shares) < 0.08
    assert steps_outside([play(task(0.5), Fixed(1), SEEDS)], 1) > 0.9


def test_bounds_hold_the_mean_as_often_as_promised():
    means = (np.random.default_rng(1).normal(size=(4000, 7, 3)) ** 2).sum(axis=2).mean(axis=1)
    low, high = nees_bounds(7, 3)
    assert abs(((low < means) & (means < high)).mean() - 0.95) < 5 * np.sqrt(0.95 * 0.05 / 4000)
    np.testing.assert_allclose(np.array(nees_bounds(np.array([7, 9]), 3))[:, 0], [low, high])


@pytest.mark.parametrize(
    ("mean", "ci", "dimension", "flag"),
    [
        (4.41, (4.01, 5.0), 4, "high"),
        (4.39, (4.01, 5.0), 4, "(high)"),
        (4.39, (3.99, 5.0), 4, ""),
        (3.59, (3.0, 3.99), 4, "low"),
        (3.61, (3.0, 3.99), 4, "(low)"),
        (3.61, (3.0, 4.01), 4, ""),
        (60.0, (1.0, 90.0), 4, ""),
        (60.0, (50.0, 90.0), None, ""),
        (4.0, None, 4, ""),
        (None, None, 4, ""),
    ],
)
def test_a_mean_is_flagged_where_its_interval_excludes_what_is_expected(mean, ci, dimension, flag):
    """Weakly if the mean itself is less than a tenth off; a ratio is then not flagged."""
    assert flag_of(Estimate(mean, ci), dimension) == flag
    if dimension and mean and ci:
        ratio = Estimate(mean / dimension, tuple(end / dimension for end in ci))
        assert flag_of_ratio(ratio) == (flag if "(" not in flag else "")


def test_steps_without_a_target_do_not_count():
    played = play(task(1.0), Fixed(1), SEEDS[:3])
    nobody = played._replace(nees_sum=0.0 * played.nees_sum, nees_count=0 * played.nees_count)
    assert steps_outside([nobody], 1) is None
    assert steps_outside([played], None) is None
    found = consistency(results_of([nobody]), 1, rng())
    assert (found.nees, found.flag) == (Estimate(None, None), "")
    once = merged([played, nobody])
    assert consistency(results_of([once]), 1, rng()).nees.value == pytest.approx(played.nees.mean())


def test_a_report_shows_the_flag_and_what_is_expected():
    members = {name: [play(task(0.5), policy, SEEDS)] for name, policy in {"myopic": Myopic(), "bad": Fixed(2)}.items()}
    summary = summarise(Comparison(task(0.5), 0, SEEDS, members))
    assert summary["nees_dimension"] == 1
    assert [policy["nees"]["flag"] for policy in summary["policies"].values()] == ["high", "high"]
    text = markdown(summary)
    assert "Consistency of the tracker (expected NEES: 1):" in text
    assert text.count(" high |") == 4  # NEES and true over believed
    assert "true over believed" in text


WORLDS = 200
RNG = np.random.default_rng(0)
LEVEL = RNG.lognormal(0.0, 1.0, (1, WORLDS))  # of each world, the same for all policies


def results(cost, error, members=1, gospa=None):
    """Episodes at these factors of the worlds' levels, with noise of a tenth."""
    noise = RNG.lognormal(0.0, 0.1, (2, members, WORLDS))
    nothing = np.full((members, WORLDS), np.nan)
    reported = nothing if gospa is None else np.sqrt(gospa * LEVEL * noise[1])
    root = np.sqrt(error * LEVEL * noise[1])
    return EpisodeResults(cost * LEVEL * noise[0], root, nothing, reported, *[nothing] * 5)


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
