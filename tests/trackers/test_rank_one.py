"""Updates one scalar at a time against the information form of whole matrices, and their laws."""

from __future__ import annotations

import re

import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.trackers import scalar_updates, update

EPS = np.finfo(float).eps
SIZES = [(1, 1), (2, 3), (4, 3), (4, 6)]  # each pair is compiled once


def problem(n, m, lead=(), seed=0):
    """x, P, y, H and variances over six decades, with leading axes ``lead``."""
    rng = np.random.default_rng([n, m, seed])
    x, P = rng.standard_normal((*lead, n)), oracles.random_covariance(rng, n, lead)
    y, H = rng.standard_normal((*lead, m)), rng.standard_normal((*lead, m, n))
    return x, P, y, H, 10 ** rng.uniform(-3, 3, (*lead, m))


def information_form(x, P, y, H, variance):
    """[P^-1 + H' R^-1 H]^-1 and x + P' H' R^-1 y, in units of P's standard deviations for the inverse's sake."""
    sigma = np.sqrt(np.diag(P))
    rows = H * sigma / np.sqrt(variance)[:, None]
    after = np.linalg.inv(np.linalg.inv(P / np.outer(sigma, sigma)) + rows.T @ rows)
    return x + sigma * (after @ rows.T @ (y / np.sqrt(variance))), after * np.outer(sigma, sigma)


def tolerance(P, H, variance):
    """Each row's subtraction rounds by eps of the prior's h'Ph; as little as the variance may remain."""
    kept = 1 + np.einsum("ia,ab,ib->i", H, P, H) / variance
    correlation = P / np.sqrt(np.outer(np.diag(P), np.diag(P)))
    return 10 * EPS * (kept.max() * len(kept) + np.linalg.cond(correlation))


def assert_close(got, want, limit):
    """In standard deviations of the wanted estimate."""
    assert oracles.covariance_distance(got[1], want[1]) < limit
    assert np.abs((got[0] - want[0]) / np.sqrt(np.diag(want[1]))).max() < 100 * limit


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_equals_the_information_form(n, m):
    for seed in range(30):
        scene = problem(n, m, seed=seed)
        limit = tolerance(*(scene[i] for i in (1, 3, 4)))
        got = scalar_updates(*scene)
        assert limit < 1e-6
        assert_close(got, information_form(*scene), limit)
        assert (got[1] == got[1].T).all()


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_equals_the_update_at_once(n, m):
    for seed in range(30):
        x, P, y, H, variance = problem(n, m, seed=seed)
        want = update(x, P, y, H, np.diag(variance))
        assert_close(scalar_updates(x, P, y, H, variance), want, tolerance(P, H, variance))


@given(seed=st.integers(0, 999), order=st.permutations(range(6)))
def test_the_order_of_rows_does_not_matter(seed, order):
    x, P, y, H, variance = problem(4, 6, seed=seed)
    got = scalar_updates(x, P, y[order], H[order], variance[order])
    assert_close(got, scalar_updates(x, P, y, H, variance), tolerance(P, H, variance))


@given(seed=st.integers(0, 999), order=st.permutations(range(6)))
def test_an_infinite_variance_leaves_its_row_out(seed, order):
    """Bit for bit, for any row and any innovation."""
    x, P, y, H, variance = problem(4, 6, seed=seed)
    out, kept = order[:3], sorted(order[3:])
    y[out], H[out], variance[out] = np.nan, np.nan, np.inf
    got = scalar_updates(x, P, y, H, variance)
    for a, b in zip(got, scalar_updates(x, P, y[kept], H[kept], variance[kept]), strict=True):
        np.testing.assert_array_equal(a, b)


def test_where_everything_is_missing_the_prior_is_left():
    x, P, y, H, _ = problem(4, 6)
    for a, b in zip(scalar_updates(x, P, y, H, np.full(6, np.inf)), (x, P), strict=True):
        np.testing.assert_array_equal(a, b)


@given(seed=st.integers(0, 999))
def test_a_row_never_adds_uncertainty(seed):
    """P - P' has no negative eigenvalue, and a huge variance next to no effect."""
    x, P, y, H, variance = problem(4, 3, seed=seed)
    after = scalar_updates(x, P, y, H, variance)[1]
    assert np.linalg.eigvalsh(P - after).min() > -1e-12 * np.trace(P)
    assert np.linalg.eigvalsh(after).min() > 0
    faint = scalar_updates(x, P, y, H, variance * 1e15)
    assert_close(faint, (x, P), 1e-8)


def test_several_tracks_equal_single_ones_bit_for_bit():
    scene = problem(4, 6, lead=(7,))
    scene[4][2, 3] = np.inf
    together = scalar_updates(*scene)
    for e in range(7):
        for whole, one in zip(together, scalar_updates(*(a[e] for a in scene)), strict=True):
            assert (whole[e] == one).all()


def test_leading_axes_broadcast_and_arguments_stay():
    _, P, y, H, _ = problem(4, 3)
    many, several = problem(4, 3, lead=(5, 1))[0], problem(4, 3, lead=(2,))[4]
    before = [a.copy() for a in (many, P, y, H, several)]
    mean, covariance = scalar_updates(many, P, y, H, several)
    assert mean.shape == (5, 2, 4)
    assert covariance.shape == (5, 2, 4, 4)
    one = scalar_updates(many[3, 0], P, y, H, several[1])
    assert (mean[3, 1] == one[0]).all()
    assert (covariance[3, 1] == one[1]).all()
    for a, b in zip(before, (many, P, y, H, several), strict=True):
        assert (a == b).all()


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_variances_that_are_none(value):
    x, P, y, H, variance = problem(4, 3)
    variance[1] = value
    with pytest.raises(InputError, match=f"variance is {value}, expected numbers > 0"):
        scalar_updates(x, P, y, H, variance)


def test_a_covariance_that_is_none():
    x, P, y, H, variance = problem(4, 3)
    bad = np.stack([P, P - 2 * np.trace(P) * np.eye(4)])
    variance[1] = np.inf
    with pytest.raises(InputError, match=re.escape("P[1] has the eigenvalue -")) as caught:
        scalar_updates(x, bad, y, H, variance)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("i", range(5))
def test_shapes_that_do_not_fit(i):
    scene = list(problem(4, 3))
    scene[i] = scene[i][..., :-1]
    with pytest.raises(
        InputError, match=r"P has shape \(4, 3\), expected" if i == 1 else "rank_one_update: argument shapes"
    ):
        scalar_updates(*scene)
