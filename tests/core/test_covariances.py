"""A matrix is accepted as a covariance if its eigenvalues say so, in any units and any batch."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core.covariances import check_covariance, check_positive_definite
from wavegym.core.errors import InputError

SIZES = st.integers(1, 6)


def scaled(rng, matrix):
    """The matrix in other units, up to 1e10 times as large on each axis."""
    units = np.power(10.0, rng.uniform(-10.0, 10.0, len(matrix)))
    return matrix * np.outer(units, units)


@given(seed=st.integers(0, 10**6), n=SIZES)
def test_covariances_in_any_units_pass_unchanged(seed, n):
    rng = np.random.default_rng(seed)
    P = scaled(rng, oracles.random_covariance(rng, n))
    assert check_covariance("P", P) is P
    assert check_positive_definite("P", P) is P


@given(seed=st.integers(0, 10**6), n=SIZES, rank=st.integers(0, 5))
def test_singular_matrices_are_covariances_but_not_definite(seed, n, rank):
    rng = np.random.default_rng(seed)
    factor = rng.integers(-3, 4, (n, min(rank, n - 1))).astype(float)  # of integers: the product is exact
    P = factor @ factor.T
    assert check_covariance("P", P) is P
    with pytest.raises(InputError, match=r"P has the eigenvalue .*, expected a positive definite matrix"):
        check_positive_definite("P", np.zeros((n, n)))


@given(seed=st.integers(0, 10**6), n=SIZES, share=st.floats(1e-3, 10.0))
def test_a_negative_eigenvalue_is_named_with_its_matrix(seed, n, share):
    """The correlation matrix gets the eigenvalue -share; the oracle is its construction from eigenvectors."""
    rng = np.random.default_rng(seed)
    good = oracles.random_covariance(rng, n, (2, 3))
    axes = np.linalg.qr(rng.standard_normal((n, n)))[0]
    values = np.append(-share, rng.uniform(0.1, 10.0, n - 1))
    bad = axes * values @ axes.T
    bad = 0.5 * (bad + bad.T)
    good[1, 2] = bad
    for check in (check_covariance, check_positive_definite):
        with pytest.raises(
            InputError, match=r"^R\[1, 2\] has the eigenvalue -.* matrix \(nearest eigenvalue: "
        ) as caught:
            check("R", good)
        assert "\n" not in str(caught.value)


@given(seed=st.integers(0, 10**6), n=st.integers(2, 6))
def test_an_asymmetric_matrix_is_named_with_the_nearest_value(seed, n):
    rng = np.random.default_rng(seed)
    P = oracles.random_covariance(rng, n)
    P[1, 0] = P[0, 1] + 1e-3 * np.sqrt(P[0, 0] * P[1, 1])
    mean = f"{0.5 * (P[0, 1] + P[1, 0]):g}"
    for check in (check_covariance, check_positive_definite):
        with pytest.raises(InputError, match="expected a symmetric matrix") as caught:
            check("P", P)
        assert f"(nearest: {mean} for both)" in str(caught.value)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("at", [(0, 0), (0, 1), (1, 1)])
def test_a_number_that_is_not_finite_is_named(value, at):
    P = np.tile(np.eye(2), (3, 1, 1))
    P[1, *at] = P[1, *at[::-1]] = value
    with pytest.raises(InputError, match=rf"^P\[1, {at[0]}, {at[1]}\] is {value}, expected finite numbers"):
        check_covariance("P", P)


def test_a_row_of_zeros_has_no_covariance_with_others():
    assert check_covariance("P", np.diag([0.0, 2.0, 0.0])).shape == (3, 3)
    with pytest.raises(InputError, match="P has the eigenvalue -1, expected a positive semidefinite matrix"):
        check_covariance("P", [[0.0, 1.0], [1.0, 0.0]])


def test_the_rounding_of_an_update_passes():
    """A predicted variance 1e10 times that of the measurement leaves an error of 1e-6; single precision one of 1e-7."""
    P = np.array([[1.0, 1.0], [1.0, 1.0 - 5e-7]])
    assert check_covariance("P", P) is P
    assert check_covariance("P", P + np.array([[0.0, 5e-7], [0.0, 0.0]])).shape == (2, 2)
    with pytest.raises(InputError, match="has the eigenvalue"):
        check_covariance("P", P - np.diag([0.0, 5e-6]))


@pytest.mark.parametrize("shape", [(), (2,), (2, 3), (4, 1, 2)])
def test_what_is_no_square_matrix(shape):
    with pytest.raises(InputError, match=r"P has shape .*, expected \(\.\.\., n, n\)"):
        check_covariance("P", np.ones(shape))


@pytest.mark.parametrize("lead", [(0,), (2, 0), (3, 1)])
def test_memory_layouts_and_empty_batches(lead):
    P = np.broadcast_to(np.eye(3), (*lead, 3, 3))  # not writeable, not contiguous
    assert check_covariance("P", P).shape == (*lead, 3, 3)
    assert check_positive_definite("P", P[..., ::2, ::2]).shape == (*lead, 2, 2)
