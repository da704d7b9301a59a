"""Folding, the wrapped likelihood over fold numbers, several PRFs, ghosts and blind speeds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal, norm

from wavegym.core.errors import InputError
from wavegym.sensors import (
    agreeing_combinations,
    combined_interval,
    fold_hypotheses,
    fold_pair_update,
    fold_range,
    fold_update,
    fold_velocity,
    outside_notch,
    outside_notch_probability,
    resolve_folds,
    unfold,
)
from wavegym.sensors.folding import SIZE

values, widths = st.floats(-1e6, 1e6), st.floats(0.1, 1e5)
deviations = st.floats(0.01, 3.0)  # in widths


@given(value=values, width=widths)
def test_fold_and_unfold_round_trip(value, width):
    folded = fold_velocity(value, width)
    assert -width / 2 <= folded.apparent < width / 2
    assert unfold(folded.apparent, folded.fold, width) == pytest.approx(value, abs=1e-9 * max(abs(value), width))
    distance = fold_range(abs(value), width)
    assert 0 <= distance.apparent < width
    assert unfold(distance.apparent, distance.fold, width) == pytest.approx(
        abs(value), abs=1e-9 * max(abs(value), width)
    )


def test_values_at_the_borders():
    assert fold_range([0.0, 10.0, 20.0, 25.0], 10.0).apparent.tolist() == [0.0, 0.0, 0.0, 5.0]
    assert fold_range([0.0, 10.0, 20.0, 25.0], 10.0).fold.tolist() == [0, 1, 2, 2]
    assert fold_velocity([5.0, -5.0, 4.0, 14.0], 10.0).apparent.tolist() == [-5.0, -5.0, 4.0, 4.0]
    assert fold_velocity([3e4, -7.0], math.inf).apparent.tolist() == [3e4, -7.0]
    assert unfold(3.0, 0.0, math.inf) == 3.0
    assert 0 <= fold_range(np.nextafter(30.0, 0.0), 10.0).apparent < 10.0


def wrapped(z, predicted, deviation, width, size):
    """Brute force: unfolded values, their densities and moments."""
    n = np.arange(-60, 61) + round((predicted - z) / width)
    y = z + n * width - predicted
    inside = np.abs(y) <= size * deviation
    if not inside.any():
        nearest = np.sort(np.abs(y))[:2]
        assume(nearest[1] - nearest[0] > 1e-6)  # of two equally near ones either may stand alone
        inside = np.abs(y) == nearest[0]
    density = norm.pdf(y[inside], scale=deviation)
    p = density / max(density.sum(), 1e-300)
    return density.sum(), n[inside], y[inside], p


@given(z=st.floats(0, 1), predicted=st.floats(-20, 20), deviation=deviations, size=st.floats(1.0, 6.0))
def test_the_likelihood_is_the_sum_over_the_folds(z, predicted, deviation, size):
    density, n, y, p = wrapped(z, predicted, deviation, 1.0, size)
    border = np.abs(z + np.arange(-60, 61) + round(predicted - z) - predicted) - size * deviation
    assume(np.abs(border).min() > 1e-9)
    assume(density > 1e-250)
    got = fold_update(z, predicted, deviation**2, 1.0, size)
    assert got.log_likelihood == pytest.approx(math.log(density), abs=1e-9)
    assert got.probability == pytest.approx(p.max(), rel=1e-9)
    assert got.innovation == pytest.approx((p * y).sum(), abs=1e-9)
    assert got.spread == pytest.approx((p * y * y).sum() - (p * y).sum() ** 2, abs=1e-8)
    if p.max() > 0.5001:
        assert got.fold == n[p.argmax()]


def test_over_all_folds_the_likelihood_is_a_density_of_the_folded_measurement():
    """Its integral over the unambiguous interval is the Gaussian's probability within the gate."""
    z, step = np.linspace(0, 1, 4000, endpoint=False) + 1 / 8000, 1 / 4000
    for deviation in (0.05, 0.4, 2.0):
        got = fold_update(z, 13.7, deviation**2, 1.0)
        total = (np.exp(got.log_likelihood) * step * (got.inside > 0)).sum()
        assert total == pytest.approx(1 - 2 * norm.sf(4.0), abs=1e-4)


def test_a_wide_prior_spreads_and_a_narrow_one_decides():
    wide, narrow = fold_update(0.0, [0.5, 0.1], [25.0, 1e-4], 1.0), fold_update(0.3, 5.31, 1e-4, 1.0)
    assert wide.inside.tolist() == [40, 1] or wide.inside[0] >= 40
    assert wide.probability[0] < 0.1
    assert (narrow.fold, narrow.probability, narrow.inside) == (5, 1.0, 1)
    assert narrow.innovation == pytest.approx(-0.01)
    assert narrow.spread == 0.0
    far = fold_update(0.5, 5.0, 1e-4, 1.0)  # 50 standard deviations
    assert far.inside == 0
    assert np.isfinite(far.log_likelihood)


@pytest.mark.parametrize("deviation", [0.1, 0.3, 0.7, 2.0])
def test_the_probability_of_a_fold_is_a_frequency(deviation):
    """Targets drawn from the prediction and measured with noise: how often the most probable fold is the true one."""
    rng, count, noise = np.random.default_rng(0), 100_000, 0.05
    predicted = rng.uniform(5, 6, count)
    truth = predicted + deviation * rng.standard_normal(count)
    noisy = truth + noise * rng.standard_normal(count)
    z = noisy - np.floor(noisy)
    got = fold_update(z, predicted, deviation**2 + noise**2, 1.0, size=6.0)
    right = got.fold == np.floor(noisy)
    assert right.mean() == pytest.approx(got.probability.mean(), abs=5 * 0.5 / math.sqrt(count))
    error = noisy - predicted - got.innovation  # of the moment-matched innovation, whose variance is the spread
    assert (error**2).mean() == pytest.approx(got.spread.mean(), rel=0.05, abs=1e-3)


def test_nothing_folds_in_an_infinite_interval():
    got = fold_update(7.0, 5.0, 4.0, math.inf)
    assert got.log_likelihood == pytest.approx(norm.logpdf(1.0, scale=1.0) - math.log(2.0))
    assert (got.fold, got.innovation, got.spread, got.probability) == (0, 2.0, 0.0, 1.0)


@st.composite
def correlated(draw):
    s, t, rho = draw(deviations), draw(deviations), draw(st.floats(-0.98, 0.98))
    return np.array([[s * s, rho * s * t], [rho * s * t, t * t]])


def pairs(z, predicted, S, size):
    """Brute force over 81 x 81 pairs of folds in intervals of 1."""
    n = np.stack(np.meshgrid(*(np.arange(-40, 41) + round(p - x) for p, x in zip(predicted, z, strict=True))), -1)
    n = n.reshape(-1, 2)
    y = z + n - predicted
    squared = np.einsum("ni,ij,nj->n", y, np.linalg.inv(S), y)
    keep = squared <= size * size
    if not keep.any():
        nearest = np.sort(squared)[:2]
        assume(nearest[1] - nearest[0] > 1e-6 * nearest[1])  # of two equally near ones either may stand alone
        assume(math.sqrt(nearest[0] * S.diagonal().max()) < 35)  # within the folds tried here
        keep = squared == nearest[0]
    density = multivariate_normal.pdf(y[keep], cov=S)
    return np.atleast_1d(density), n[keep], y[keep], squared


@given(
    z=st.tuples(st.floats(0, 1), st.floats(0, 1)),
    predicted=st.tuples(st.floats(-9, 9), st.floats(-9, 9)),
    S=correlated(),
    size=st.floats(1.0, 5.0),
)
def test_pairs_of_folds_against_brute_force(z, predicted, S, size):
    z, predicted = np.array(z), np.array(predicted)
    density, _, y, squared = pairs(z, predicted, S, size)
    assume(np.abs(squared - size * size).min() > 1e-7)
    assume(density.sum() > 1e-200)
    p = density / density.sum()
    got = fold_pair_update(z, predicted, S, [1.0, 1.0], size)
    assert got.log_likelihood == pytest.approx(math.log(density.sum()), abs=1e-7)
    assert got.inside == ((squared <= size * size).sum())
    mean = p @ y
    np.testing.assert_allclose(got.innovation, mean, atol=1e-7)
    np.testing.assert_allclose(got.spread, (y * p[:, None]).T @ y - np.outer(mean, mean), atol=1e-6)
    listed = fold_hypotheses(z, predicted, S, [1.0, 1.0], size)
    assert listed.probability.sum() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(np.sort(listed.probability)[::-1], np.sort(p)[::-1], atol=1e-7)
    np.testing.assert_allclose(listed.probability @ listed.innovation, mean, atol=1e-7)
    assert got.probability == pytest.approx(listed.probability[0])


@given(z=st.floats(0, 1), predicted=st.floats(-9, 9), deviation=deviations)
def test_a_pair_without_correlation_is_the_product(z, predicted, deviation):
    """The second quantity does not fold: densities multiply, and folds of the first are those of one alone.

    The ellipse of the pair is the interval of the one if the second quantity is where it was predicted.
    """
    reach = np.array([-SIZE, SIZE]) * deviation + predicted - z
    assume(np.abs(reach - np.rint(reach)).min() > 1e-9)  # rounding decides about a fold on the gate itself
    one = fold_update(z, predicted, deviation**2, 1.0)
    two = fold_pair_update([z, 3.0], [predicted, 3.0], np.diag([deviation**2, 4.0]), [1.0, math.inf])
    assert two.inside == one.inside
    assert two.log_likelihood == pytest.approx(one.log_likelihood + norm.logpdf(0.0, scale=2.0), abs=1e-9)
    assert two.fold.tolist() == [one.fold, 0]
    assert two.spread[0, 0] == pytest.approx(one.spread, abs=1e-9)


def test_a_moment_matched_update_is_the_mixture_of_kalman_updates():
    """Mean and variance of the Gaussian mixture over the folds, each updated by itself."""
    mean, P, R, width, z = 5.2, 0.5, 0.01, 1.0, 0.4
    S = P + R
    got = fold_update(z, mean, S, width, size=6.0)
    _, n, y, p = wrapped(z, mean, math.sqrt(S), width, 6.0)
    K = P / S
    updated = mean + K * y
    want_mean = (p * updated).sum()
    want_variance = (1 - K) * P + (p * updated**2).sum() - want_mean**2
    assert mean + K * got.innovation == pytest.approx(want_mean, rel=1e-12)
    assert (1 - K) * P + K * got.spread * K == pytest.approx(want_variance, rel=1e-12)
    assert len(n) > 3


def test_a_batch_equals_its_elements_bit_for_bit():
    rng = np.random.default_rng(0)
    z, p, s, w = rng.random((5, 1)), 9 * rng.random(4), 0.1 + rng.random((5, 4)), np.array([1.0, 2.0, math.inf, 0.3])
    together = fold_update(z, p, s, w)
    S = np.zeros((5, 4, 2, 2))
    S[..., 0, 0], S[..., 1, 1], S[..., 0, 1], S[..., 1, 0] = s, 1.0, 0.1, 0.1
    Z, Pp, Ww = np.stack([z * np.ones(4), p * np.ones((5, 1))], -1), np.stack([p, p], -1), np.stack([w, w + 1], -1)
    both = fold_pair_update(Z, Pp, S, Ww)
    for i, j in np.ndindex(5, 4):
        for whole, one in zip(together, fold_update(z[i, 0], p[j], s[i, j], w[j]), strict=True):
            assert whole[i, j] == one
        for whole, one in zip(both, fold_pair_update(Z[i, j], Pp[j], S[i, j], Ww[j]), strict=True):
            np.testing.assert_array_equal(whole[i, j], one)


INTERVALS = np.array([7.0, 8.0, 9.0])


@given(value=st.floats(0, 500))
def test_coprime_intervals_resolve_up_to_their_least_common_multiple(value):
    """The Chinese remainder theorem, against a search over all cells."""
    got = resolve_folds(fold_range(value, INTERVALS).apparent, INTERVALS, np.full(3, 1e-4), 0.0, 503.9)
    assert got.value[0] == pytest.approx(value, abs=1e-6)
    assert (
        got.fold[0].tolist() == fold_range(value, INTERVALS).fold.tolist() or value % 1 > 1 - 1e-6 or value % 1 < 1e-6
    )
    assert got.probability[0] > 0.99
    assert combined_interval(INTERVALS, 0.01, 1e4) == 504.0


def test_beyond_it_the_measurement_is_ambiguous_not_an_error():
    got = resolve_folds(fold_range(100.3, INTERVALS).apparent, INTERVALS, np.full(3, 1e-4), 0.0, 1200.0)
    assert sorted(got.value) == pytest.approx([100.3, 604.3, 1108.3])
    assert got.probability == pytest.approx([1 / 3] * 3)
    alone = resolve_folds([2.0], [7.0], [1.0], 0.0, 20.0)
    assert sorted(alone.value) == [2.0, 9.0, 16.0]
    assert alone.probability == pytest.approx([1 / 3] * 3)
    assert len(resolve_folds([0.0, 4.5], [7.0, 7.0], [1e-4, 1e-4], 0.0, 70.0).value) == 0  # no target looks so


@given(seed=st.integers(0, 2**31), value=st.floats(5, 495))
def test_noisy_folds_are_resolved_by_maximum_likelihood(seed, value):
    """Noise of 0.05 in cells of 1: against brute force over a fine grid of values."""
    noisy = value + np.random.default_rng(seed).normal(0, 0.05, 3)
    z = fold_range(np.abs(noisy), INTERVALS).apparent
    got = resolve_folds(z, INTERVALS, np.full(3, 0.05**2), 0.0, 504.0)
    grid = np.arange(0, 504, 0.01)
    off = grid[:, None] - z
    squares = ((off - INTERVALS * np.rint(off / INTERVALS)) ** 2).sum(axis=1) / 0.05**2
    assume(np.sort(squares)[0] < 18)  # within the gate, 18.4
    assert got.value[0] == pytest.approx(grid[squares.argmin()], abs=0.011)
    assert got.chi_square[0] == pytest.approx(squares.min(), abs=0.1)
    assert got.value[0] == pytest.approx(value, abs=0.2)


def test_two_targets_and_two_prfs_make_ghosts_and_a_third_prf_removes_them():
    targets, cells = np.array([12.0, 31.0]), np.array([7.0, 8.0])
    two = agreeing_combinations([fold_range(targets, w).apparent for w in cells], cells, [1e-4, 1e-4], 0.0, 56.0)
    brute = [x for x in range(56) if all(np.any(np.isclose(x % w, targets % w)) for w in cells)]
    assert sorted(np.rint(two.value).astype(int)) == brute
    assert len(brute) == 4  # two targets, two ghosts
    third = agreeing_combinations(
        [fold_range(targets, w).apparent for w in INTERVALS], INTERVALS, np.full(3, 1e-4), 0, 56
    )
    assert sorted(third.value) == pytest.approx([12.0, 31.0])
    assert third.detection.tolist() in ([[0, 0, 0], [1, 1, 1]], [[1, 1, 1], [0, 0, 0]])


def test_a_blind_prf_is_allowed_for():
    """One PRF does not see the target: two of three agree."""
    z = fold_range(123.4, INTERVALS).apparent
    got = agreeing_combinations([[z[0]], [], [z[2]]], INTERVALS, np.full(3, 1e-4), 0.0, 200.0, needed=2)
    assert sorted(got.value) == pytest.approx([60.4, 123.4, 186.4])  # 7 and 9 have the multiple 63
    assert got.detection.tolist() == [[0, -1, 0]] * 3
    assert got.fold[:, 1].tolist() == [0] * 3
    assert len(agreeing_combinations([[], [], []], INTERVALS, np.ones(3), 0.0, 200.0).value) == 0


def test_intervals_of_any_ratio():
    assert combined_interval([10.0, 15.0], 1e-6, 1e3) == 30.0
    assert combined_interval([10.0, 10.1], 0.05, 1e3) == math.inf or combined_interval([10.0, 10.1], 0.05, 1e3) > 100
    assert combined_interval([1.0, math.sqrt(2.0)], 0.01, 1e3) == pytest.approx(70 * math.sqrt(2), rel=1e-12)
    assert combined_interval([5.0], 0.0, 1e3) == 5.0


@given(v=st.floats(-300, 300), notch=st.floats(0.1, 7.0))
def test_a_speed_in_the_notch_is_not_seen(v, notch):
    folded = (v + 7.5) % 15 - 7.5
    if abs(abs(folded) - notch) > 1e-9:
        assert outside_notch(v, 15.0, notch) == (abs(folded) > notch)
    assert outside_notch(v, math.inf, notch) == (abs(v) > notch)


@pytest.mark.parametrize("deviation", [0.0, 0.3, 3.0, 40.0, 400.0])
def test_the_probability_of_a_visible_speed_against_draws(deviation):
    predicted, count = np.array([-33.0, 0.0, 3.0, 15.0, 22.5]), 100_000
    draws = predicted + deviation * np.random.default_rng(0).standard_normal((count, 1))
    for width in (15.0, math.inf):
        got = outside_notch_probability(predicted, deviation**2, width, 2.0)
        assert ((got >= 0) & (got <= 1)).all()
        np.testing.assert_allclose(got, outside_notch(draws, width, 2.0).mean(axis=0), atol=5 * 0.5 / math.sqrt(count))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: fold_range(-1.0, 10.0), r"range_m is -1\.0"),
        (lambda: fold_range(1.0, 0.0), r"unambiguous_range is 0\.0, expected a number > 0, or inf where nothing folds"),
        (lambda: fold_velocity(np.ones(2), np.ones(3)), "expected shapes that broadcast"),
        (lambda: fold_update(1.0, 1.0, 0.0, 1.0), r"variance is 0\.0"),
        (lambda: fold_pair_update(np.ones(2), np.ones(2), -np.eye(2), np.ones(2)), "S has the eigenvalue"),
        (lambda: fold_hypotheses(np.ones((3, 2)), np.ones(2), np.eye(2), np.ones(2)), "measurement, predicted, S and"),
        (lambda: resolve_folds([1.0], [2.0, 3.0], [1.0], 0.0, 9.0), r"widths has shape \(2,\), expected one for each"),
        (lambda: resolve_folds([1.0], [2.0], [1.0], 9.0, 0.0), "expected low < high"),
        (lambda: resolve_folds([1.0], [1e-6], [1.0], 0.0, 9.0), "holds 9e.06 folds, expected at most 1,000,000"),
        (lambda: agreeing_combinations([[1.0]], [2.0], [1.0], 0, 9, needed=2), r"needed is 2, .* \(nearest: 1\)"),
        (lambda: agreeing_combinations([[1.0]], [2.0], [1.0], 0, 9, gate_probability=1), "gate_probability is 1"),
        (lambda: combined_interval([1.0], 0.0, 1e9), "a million intervals"),
        (lambda: outside_notch_probability(1.0, 1.0, 4.0, 3.0), "notch is 3.0, expected at most half"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_in_one_line(wrong, message):
    with pytest.raises(InputError, match=message) as caught:
        wrong()
    assert "\n" not in str(caught.value)
