"""The unscented transform of range and range-rate: filterpy, its limit for small spreads, and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import JulierSigmaPoints, unscented_transform
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.oracles import random_covariance
from wavegym.sensors.geometry_kernels import jacobian
from wavegym.trackers import ukf_kernels as kernels

SENSOR = np.array([300.0, -400.0])


def predict_ahead(x, P, sensor=SENSOR):
    """z (2), S (2, 2), G (4, 2) of one target, which stands second of three."""
    means, covariances = np.full((3, 4), np.nan), np.full((3, 4, 4), np.nan)
    means[1], covariances[1] = x, P
    A, z, S, G = np.empty((2, 4, 4)), np.empty((2, 2)), np.empty((2, 2, 2)), np.empty((2, 4, 2))
    kernels.predict_measurement_one(0, 1, means, covariances, sensor[0], sensor[1], A, z, S, G, (0,) * 4)
    return z[0], S[0], G[0]


def measure(x, sensor=SENSOR):
    d = x[..., :2] - sensor
    r = np.hypot(d[..., 0], d[..., 1])
    return np.stack([r, (d * x[..., 2:]).sum(-1) / r], axis=-1)


def problem(seed):
    rng = np.random.default_rng(seed)
    x = np.append(rng.uniform(-3e3, 3e3, 2), rng.uniform(-300.0, 300.0, 2))
    return x, random_covariance(rng, 4)


@settings(max_examples=50)
@given(st.integers(0, 10_000))
def test_equals_filterpy(seed):
    x, P = problem(seed)
    points = JulierSigmaPoints(4, kappa=0.0)
    sigmas = points.sigma_points(x, P)
    images = measure(sigmas)
    z, S = unscented_transform(images, points.Wm, points.Wc)
    G = np.einsum("i,ij,ik->jk", points.Wc, sigmas - x, images - z)
    ours = predict_ahead(x, P)
    np.testing.assert_allclose(ours[0], z, rtol=1e-12, atol=1e-9)
    s, p = np.sqrt(np.diag(S)), np.sqrt(np.diag(P))
    assert np.abs((ours[1] - S) / np.outer(s, s)).max() < 1e-7  # rounding of filterpy's range, 1e3 m
    assert np.abs((ours[2] - G) / np.outer(p, s)).max() < 1e-7
    assert (np.linalg.eigvalsh(ours[1]) > 0.0).all()


@settings(max_examples=50)
@given(st.integers(0, 10_000))
def test_from_transmitter_to_receiver_equals_filterpy(seed):
    """With accelerations, which are not measured, behind the velocities."""
    x, _ = problem(seed)
    x, P = np.append(x, [1.0, -2.0]), random_covariance(np.random.default_rng(seed), 6)
    transmitter = np.array([-1e3, 2e3])
    points = JulierSigmaPoints(6, kappa=0.0)
    sigmas = points.sigma_points(x, P)
    images = (measure(sigmas[:, :4]) + measure(sigmas[:, :4], transmitter)) / 2
    z, S = unscented_transform(images, points.Wm, points.Wc)
    G = np.einsum("i,ij,ik->jk", points.Wc, sigmas - x, images - z)
    A, ours = np.empty((1, 6, 6)), (np.empty((1, 2)), np.empty((1, 2, 2)), np.empty((1, 6, 2)))
    kernels.predict_multistatic_one(0, 0, x[None], P[None], *transmitter, *SENSOR, A, *ours, (0,) * 6)
    np.testing.assert_allclose(ours[0][0], z, rtol=1e-12, atol=1e-9)
    s, p = np.sqrt(np.diag(S)), np.sqrt(np.diag(P))
    assert np.abs((ours[1][0] - S) / np.outer(s, s)).max() < 1e-7
    assert np.abs((ours[2][0] - G) / np.outer(p, s)).max() < 1e-7


@pytest.mark.parametrize("seed", range(5))
def test_is_the_linearised_filter_for_small_spreads(seed):
    x, P = problem(seed)
    H = jacobian(x, SENSOR)
    errors = []
    for scale in (1e-2, 1e-3):
        z, S, G = predict_ahead(x, scale * scale * P)
        assert np.abs(z - measure(x)).max() < 100.0 * scale * scale
        errors.append(max(np.abs(S / scale**2 - H @ P @ H.T).max(), np.abs(G / scale**2 - P @ H.T).max()))
    assert errors[1] < 0.02 * errors[0] + 1e-6 * np.abs(P).max()  # the error is of second order in the spread


def test_no_position_spread_makes_the_transform_exact():
    """Range-rate is linear in the velocity, so only rounding and the least position spread are left."""
    x, P = np.array([2000.0, -1000.0, -100.0, 80.0]), np.diag([1e-12, 1e-12, 400.0, 900.0])
    P[2, 3] = P[3, 2] = 200.0
    z, S, G = predict_ahead(x, P)
    H = jacobian(x, SENSOR)
    np.testing.assert_allclose(z, measure(x), rtol=1e-13)
    np.testing.assert_allclose(S[1, 1], H[1] @ P @ H[1], rtol=1e-9)
    np.testing.assert_allclose(G[2:, 1], (P @ H.T)[2:, 1], rtol=1e-9)


def test_moments_of_a_curved_case_by_monte_carlo():
    x = np.array([620.0, -160.0, -100.0, 200.0])  # 400 m away
    P = np.diag([900.0, 1600.0, 100.0, 225.0])
    P[0, 1] = P[1, 0] = 500.0
    P[1, 3] = P[3, 1] = 200.0
    z, S, G = predict_ahead(x, P)
    half = np.random.default_rng(0).standard_normal((400_000, 4)) @ np.linalg.cholesky(P).T
    images = measure(x + np.concatenate([half, -half]))
    mean, covariance = images.mean(0), np.cov(images.T)
    cross = np.concatenate([half, -half]).T @ (images - mean) / len(images)
    sigma, spread = np.sqrt(np.diag(covariance)), np.sqrt(np.diag(P))
    shift = (mean - measure(x)) / sigma
    assert np.abs(shift).min() > 0.015  # the shift that a linearised filter neglects
    assert np.abs((z - mean) / sigma).max() < 0.004
    assert np.abs((S - covariance) / np.outer(sigma, sigma)).max() < 0.03
    assert np.abs((G - cross) / np.outer(spread, sigma)).max() < 0.01


def test_a_covariance_that_is_none_gives_nan():
    x, P = problem(0)
    for part in predict_ahead(x, -P):
        assert np.isnan(part).any()
