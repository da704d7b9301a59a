from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import gmean, trim_mean, ttest_rel

from wavegym.evaluation import statistics

positive = st.floats(1e-3, 1e3)
matrices = arrays(np.float64, st.tuples(st.integers(1, 3), st.integers(2, 12)), elements=positive)


def rng():
    return np.random.default_rng(7)


def inside(value, interval, slack=0.0):
    return interval[0] - slack <= value <= interval[1] + slack


def test_the_interval_of_a_mean_covers_it_as_often_as_promised():
    data = np.random.default_rng(1)
    trials = 300
    covered = sum(inside(3.0, statistics.mean(data.normal(3.0, 2.0, (1, 40)), rng()).ci) for _ in range(trials))
    # Binomial(300, 0.94): bootstrap intervals of 40 values are a little narrow; three standard deviations are 0.041.
    assert 0.90 <= covered / trials <= 0.98


@pytest.mark.slow
def test_the_interval_over_worlds_covers_the_mean_of_log_normal_costs_as_often_as_promised():
    data = np.random.default_rng(11)
    trials, worlds, sigma = 400, 200, 0.5
    true = np.exp(sigma**2 / 2)
    ends = np.array([statistics.mean(data.lognormal(0.0, sigma, (1, worlds)), rng()).ci for _ in range(trials)])
    covered = ((ends[:, 0] <= true) & (true <= ends[:, 1])).mean()
    # Binomial(400, 0.95): three standard deviations. BCa's own error is of the order of 1/worlds, 0.5 %.
    assert abs(covered - statistics.LEVEL) < 3 * np.sqrt(0.95 * 0.05 / trials) + 1 / worlds


@pytest.mark.slow
def test_the_interval_of_a_paired_ratio_covers_it_although_worlds_differ_far_more_than_policies():
    data = np.random.default_rng(2)
    trials, covered, widths = 200, 0, []
    for _ in range(trials):
        baseline = data.lognormal(0.0, 1.0, (1, 60))
        policy = 0.85 * baseline * data.lognormal(-0.005, 0.1, (1, 60))
        percent = statistics.difference(policy, baseline, rng()).percent
        covered += inside(-15.0, percent.ci)
        widths.append(np.ptp(percent.ci))
    assert 0.87 <= covered / trials <= 0.99
    assert np.mean(widths) < 8.0  # unpaired, the two means alone would each be uncertain by +-33 %


def test_the_width_of_an_interval_is_the_normal_one_where_the_sample_is_large():
    data = np.random.default_rng(3).normal(0.0, 1.0, (1, 4000))
    low, high = statistics.mean(data, rng()).ci
    assert high - low == pytest.approx(2 * 1.95996 * data.std() / np.sqrt(4000), rel=0.08)  # 2000 resamples: sd 3 %


def test_a_ratio_of_means_takes_the_episodes_that_have_both_numbers():
    values, others = np.arange(1.0, 61.0).reshape(2, 30), np.full((2, 30), 2.0)
    values[0, 3], others[1, 29] = np.nan, np.nan
    estimate = statistics.ratio(values, others, rng())
    assert estimate.value == pytest.approx((sum(range(1, 61)) - 4 - 60) / (58 * 2.0))
    assert inside(estimate.value, estimate.ci)
    assert statistics.ratio(np.full((1, 5), np.nan), np.ones((1, 5)), rng()) == (None, None)


def test_the_interval_of_a_ratio_covers_that_of_the_means():
    data = np.random.default_rng(12)
    trials, covered = 200, 0
    for _ in range(trials):
        others = data.lognormal(0.0, 0.5, (1, 60))
        values = 1.5 * others * data.lognormal(-0.125, 0.5, (1, 60))  # a factor of mean 1
        covered += inside(1.5, statistics.ratio(values, others, rng()).ci)
    assert 0.87 <= covered / trials <= 0.99  # as for paired ratios above


def test_a_ratio_meets_the_same_worlds_above_and_below():
    """Where one cost is always twice the other, no resample has another ratio."""
    costs = np.exp(rng().standard_normal((1, 50)))
    found = statistics.ratio(2.0 * costs, costs, rng())
    np.testing.assert_allclose([found.value, *found.ci], 2.0, rtol=1e-12)


def test_constant_ratio_is_exact():
    baseline = np.random.default_rng(4).lognormal(0.0, 1.0, (1, 30))
    result = statistics.difference(0.85 * baseline, baseline, rng())
    for estimate in result:
        assert estimate.value == pytest.approx(-15.0, abs=1e-12)
        assert estimate.ci == pytest.approx((-15.0, -15.0), abs=1e-12)


@settings(max_examples=25)
@given(values=matrices, factor=positive)
def test_what_the_estimates_are(values, factor):
    baseline = np.flip(values, axis=1) * factor
    result = statistics.difference(values, baseline[:1], rng())
    assert result.percent.value == pytest.approx(100 * (values.mean() / baseline[0].mean() - 1), rel=1e-9, abs=1e-9)
    assert result.geometric.value == pytest.approx(
        100 * (gmean(values / baseline[0], axis=None) - 1), rel=1e-9, abs=1e-9
    )
    assert statistics.interquartile_mean(values) == pytest.approx(trim_mean(values, 0.25, axis=None), rel=1e-12)
    assert statistics.mean(values, rng()).value == pytest.approx(values.mean(), rel=1e-12)
    assert values.min() * (1 - 1e-12) <= statistics.mean(values[:1], rng()).ci[0]


def test_the_geometric_difference_does_not_care_how_costly_a_world_is():
    data = np.random.default_rng(5)
    baseline, ratio, level = (
        data.lognormal(0, 1, (1, 25)),
        data.lognormal(0, 0.1, (1, 25)),
        data.lognormal(0, 3, (1, 25)),
    )
    plain = statistics.difference(ratio * baseline, baseline, rng()).geometric
    scaled = statistics.difference(ratio * baseline * level, baseline * level, rng()).geometric
    assert plain.value == pytest.approx(scaled.value, rel=1e-9)
    assert plain.ci == pytest.approx(scaled.ci, rel=1e-9)


def test_training_runs_are_level_with_themselves():
    costs = np.random.default_rng(5).lognormal(0, 1, (3, 50))
    assert statistics.difference(costs, costs, rng()).geometric.value == pytest.approx(0.0, abs=1e-9)


def test_a_spread_between_training_runs_widens_the_interval():
    data = np.random.default_rng(6)
    baseline = data.lognormal(0, 0.5, (1, 200))
    noise = data.lognormal(0, 0.02, (4, 200))
    alike, unlike = np.ones((4, 1)), np.array([[0.8], [0.9], [1.1], [1.2]])
    narrow = statistics.difference(alike * noise * baseline, baseline, rng()).percent
    wide = statistics.difference(unlike * noise * baseline, baseline, rng()).percent
    # Student's t of four runs whose factors have logarithms of standard deviation 0.1849.
    assert np.ptp(np.log1p(np.array(wide.ci) / 100)) == pytest.approx(2 * 3.1824 * 0.1849 / 2, rel=0.02)
    assert np.ptp(narrow.ci) < 2.0


def test_a_spread_between_training_runs_of_the_reference_widens_the_interval_as_much():
    data = np.random.default_rng(6)
    unlike = np.array([[0.1], [0.3], [0.5]]) * data.lognormal(0, 0.5, (1, 200))
    one = data.lognormal(0, 0.02, (1, 200)) * unlike.mean(axis=0)
    there, back = (statistics.difference(*pair, rng()) for pair in ((unlike, one), (one, unlike)))
    for low, high in ((1 + each.ci[0] / 100, 1 + each.ci[1] / 100) for each in there):
        assert 0.0 < low < high  # no policy costs 100 % less than another
    widths = [np.diff(np.log1p(np.array(each.geometric.ci) / 100)) for each in (there, back)]
    assert widths[0] == pytest.approx(widths[1], rel=1e-3)  # on the logarithmic scale; BCa's ends differ a little
    assert statistics.p_value(unlike, one) == pytest.approx(statistics.p_value(one, unlike), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("spread", [0.0, 0.02, 0.1])
@pytest.mark.parametrize(("members", "others"), [(3, 0), (10, 0), (0, 3), (3, 3)])
def test_the_interval_over_training_runs_covers_the_figure_of_a_training(members, others, spread):
    """Runs differ by ``spread``, worlds by 1, and a run in a world by 0.2, all in logarithms; no run at all: a rule."""
    data = np.random.default_rng([members, others, int(100 * spread)])
    trials, worlds, covered, rejected = 300, 60, 0, 0

    def drawn(count):
        if not count:
            return level
        runs = data.normal(0.0, spread, (count, 1)) + data.normal(0.0, 0.2, (count, worlds))
        return level * np.exp(runs)

    for _ in range(trials):
        level = np.exp(data.normal(0.0, 1.0, (1, worlds)))
        own, reference = drawn(members), drawn(others)
        covered += inside(0.0, statistics.difference(own, reference, rng()).geometric.ci)
        rejected += statistics.p_value(own, reference) < 0.05
    # The two parts add in squares, so that coverage is 95 % or more; three standard errors of a share are 0.038.
    assert covered / trials > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / trials)
    assert rejected / trials < 0.05 + 3.0 * np.sqrt(0.95 * 0.05 / trials)


def test_a_p_value_of_one_run_is_that_of_the_paired_t_test():
    data = np.random.default_rng(3)
    baseline = data.lognormal(0.0, 1.0, (1, 40))
    values = baseline * data.lognormal(0.05, 0.2, (1, 40))
    wanted = ttest_rel(np.log(values[0]), np.log(baseline[0])).pvalue
    assert statistics.p_value(values, baseline) == pytest.approx(wanted, rel=1e-12)
    assert statistics.p_value(baseline, baseline) == 1.0
    assert statistics.p_value(-values, baseline) is None
    assert statistics.p_value(values[:, :1], baseline[:, :1]) is None


def test_holm_rejects_the_smallest_at_a_share_of_the_level_and_stops_at_the_first_that_fails():
    assert statistics.established([0.04, 0.012, None, 0.02]) == [True, True, False, True]
    assert statistics.established([0.04, 0.018, None, 0.02]) == [False, False, False, False]
    assert statistics.established([0.01, 0.03, 0.04]) == [True, False, False]
    assert statistics.established([]) == []


def test_members_that_are_the_same_are_as_good_as_one():
    one = np.random.default_rng(8).lognormal(0, 1, (1, 80))
    low, high = statistics.mean(one, rng()).ci
    low3, high3 = statistics.mean(np.repeat(one, 3, axis=0), rng()).ci
    assert (low3, high3) == pytest.approx((low, high), rel=0.05)  # other resamples of the same worlds


def test_the_same_generator_gives_the_same_interval():
    values = np.random.default_rng(9).lognormal(0, 1, (2, 30))
    assert statistics.mean(values, rng()) == statistics.mean(values, rng())


@pytest.mark.parametrize("members", [1, 3])
def test_degenerate_samples_give_none_or_width_zero_and_no_warning(members):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        alone = statistics.mean(np.full((members, 1), 2.0), rng())
        alike = statistics.mean(np.full((members, 9), 2.0), rng())
        ratio = statistics.difference(np.full((members, 9), 2.0), np.full((1, 9), 2.0), rng())
        zero = statistics.difference(np.full((members, 9), 2.0), np.zeros((1, 9)), rng())
        negative = statistics.difference(np.full((members, 9), -2.0), np.full((1, 9), 2.0), rng())
        broken = statistics.mean(np.full((members, 9), np.nan), rng())
        two = statistics.mean(np.array([[1.0, 3.0]] * members), rng())
    assert alone == (2.0, None)
    assert alike == (2.0, (2.0, 2.0))
    assert ratio == ((0.0, (0.0, 0.0)), (0.0, (0.0, 0.0)))
    assert zero == ((None, None), (None, None))
    assert negative == ((None, None), (None, None))
    assert broken == (None, None)
    assert two.value == 2.0
    assert inside(2.0, two.ci)
    assert statistics.finite(np.median(np.full((1, 3), np.nan))) is None


@pytest.mark.parametrize(
    ("costs", "want"),
    [
        ((5.0, 9.0, 5.0), 1.0),
        ((9.0, 9.0, 5.0), 0.0),
        ((4.0, 9.0, 5.0), 1.25),
        ((11.0, 9.0, 5.0), -0.5),
        ((4.0, 5.0, 5.0), None),
        ((4.0, None, 5.0), None),
        ((None, 9.0, 5.0), None),
    ],
)
def test_score_is_0_for_random_and_1_for_the_baseline(costs, want):
    assert statistics.score(*costs) == want
