"""Posterior linearisation: points, regression against least squares, and exactness for linear measurements."""

from __future__ import annotations

import numpy as np
import oracles
import pytest

from wavegym.trackers import sigma_point_kernels as kernels
from wavegym.trackers.sigma_point_kernels import sigma_points_one

NN = (0, 0, 0, 0)


def problem(seed, m=3):
    """Estimate (1, 4), covariance (1, 4, 4), its points (8, 4) and their Cholesky factor."""
    rng = np.random.default_rng(seed)
    at, P = rng.standard_normal((1, 4)), oracles.random_covariance(rng, 4, (1,))
    A, points = np.full((4, 4), np.nan), np.empty((8, 4))
    sigma_points_one(0, at, P, A, points, NN)
    return rng, at, P, A, points


def regress(Z, A):
    """h, H and the residual's variances from the kernel."""
    m = Z.shape[1]
    h, H, residual = np.empty(m), np.empty((m, 4)), np.zeros(m)
    kernels.regress_one(Z.copy(), A, h, H, residual, NN)
    return h, H, residual


@pytest.mark.parametrize("seed", range(5))
def test_points_have_the_moments_of_the_estimate(seed):
    _, at, P, _, points = problem(seed)
    np.testing.assert_allclose(points.mean(axis=0), at[0], atol=1e-12 * np.sqrt(P.max()))
    assert oracles.covariance_distance(np.cov(points.T, bias=True), P[0]) < 1e-12


@pytest.mark.parametrize("seed", range(5))
def test_regression_is_least_squares_over_the_points(seed):
    rng, at, _, A, points = problem(seed)
    Z = np.stack([np.hypot(points[:, 0] - 3.0, points[:, 2]), points[:, 1] ** 2, rng.standard_normal(8)], axis=1)
    h, H, residual = regress(Z, A)
    fit, squares, _, _ = np.linalg.lstsq(np.column_stack([np.ones(8), points - at[0]]), Z, rcond=None)
    np.testing.assert_allclose(h, fit[0], rtol=1e-10)
    np.testing.assert_allclose(H, fit[1:].T, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(residual, squares / 8, rtol=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_a_linear_measurement_is_the_kalman_update_from_any_start(seed):
    """From a start elsewhere one pass gives the exact update, and the next does not move."""
    rng, _, prior, A, points = problem(seed)
    x, slopes = rng.standard_normal((1, 4)), rng.standard_normal((2, 4))
    z, R = rng.standard_normal(2), np.array([0.3, np.inf])
    P, at = np.empty((1, 4, 4)), points.mean(axis=0)[None]
    h, H, residual = regress(points @ slopes.T, A)
    assert (residual < 1e-20 * prior.max()).all()
    y, d, v = np.empty(2), np.empty(4), np.empty(4)
    want = oracles.update(x[0], prior[0], (z - slopes @ x[0])[:1], slopes[:1], np.diag(R[:1]))
    for again in (False, True):
        h = slopes @ at[0] if again else h
        moved = kernels.update_from_one(0, x, P, prior[0], at, z, h, H, R, y, d, v, NN)
        assert (moved < 1e-12) == again
        np.testing.assert_allclose(at[0], want[0], rtol=1e-8, atol=1e-8 * np.sqrt(prior.max()))
        assert oracles.covariance_distance(P[0], want[1]) < 1e-8


def test_the_residual_of_a_square_over_four_states():
    """z = x1^2 at 0 with unit covariance: mean 1, no slope, residual (n - 1) for n = 4 states."""
    A, points = np.empty((4, 4)), np.empty((8, 4))
    sigma_points_one(0, np.zeros((1, 4)), np.eye(4)[None], A, points, NN)
    h, H, residual = regress(points[:, :1] ** 2, A)
    np.testing.assert_allclose([h[0], residual[0]], [1.0, 3.0], rtol=1e-12)
    np.testing.assert_allclose(H, 0.0, atol=1e-12)
