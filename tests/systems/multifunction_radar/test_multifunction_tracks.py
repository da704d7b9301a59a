"""Tracks of the multifunction radar: closed forms against integrals, the IMM against whole matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from wavegym.systems.multifunction_radar import track_kernels as tracks

MODES = tracks.Modes((10.0, 2000.0), (0.05, 0.2))
GENERATOR = np.array([[-0.05, 0.05], [0.2, -0.2]])
VARIANCE = np.array([40.0, 3e-6, 1.0])  # of range, sine of the azimuth and range-rate


def some_slots(rng, count=3):
    """Slots with random tracks, last updated at t = 1 s."""
    roots = rng.normal(0, 1, (count, 2, 4, 4)) * np.array([30.0, 8.0, 30.0, 8.0])[:, None]
    place = np.array([9e3, 120.0, 15e3, -150.0])
    mean = place + rng.normal(0, 1, (count, 2, 4)) * np.array([50.0, 10.0, 50.0, 10.0])
    probability = rng.dirichlet([2.0, 2.0], count)
    slots = tracks.Slots(
        np.zeros(count), np.empty((count, 2, 4)), np.empty((count, 2, 4, 4)), np.empty((count, 2)),
        np.full(count, 0.9), np.zeros((count, 3)), np.empty((count, 10))
    )  # fmt: skip
    for k in range(count):
        tracks.keep_slot(
            k, 1.0, slots, MODES, mean[k], roots[k] @ np.swapaxes(roots[k], -1, -2), probability[k : k + 1]
        )
    return slots


def flown(x, P, seconds, q):
    F, G = (
        np.kron(np.eye(2), [[1.0, seconds], [0.0, 1.0]]),
        np.array([[seconds**3 / 3, seconds**2 / 2], [seconds**2 / 2, seconds]]),
    )
    return F @ x, F @ P @ F.T + q * np.kron(np.eye(2), G)


def mixture(weights, means, covariances):
    mean = np.einsum("j,jn->n", weights, means)
    off = means - mean
    return mean, np.einsum("j,jnm->nm", weights, covariances + off[:, :, None] * off[:, None])


def plain_prediction(slots, k, seconds):
    """Mixed and flown modes, and their probabilities, by the textbook."""
    Pi = expm(GENERATOR * seconds)
    ahead = slots.probability[k] @ Pi
    found = []
    for j, q in enumerate(MODES.density):
        weights = slots.probability[k] * Pi[:, j] / ahead[j]
        found.append(flown(*mixture(weights, slots.mean[k], slots.covariance[k]), seconds, q))
    return np.array([x for x, _ in found]), np.array([P for _, P in found]), ahead


def predicted(slots, k, time):
    x, P, mu = np.empty((2, 4)), np.empty((2, 4, 4)), np.empty((1, 2))
    mean, covariance = np.empty((1, 4)), np.empty((1, 4, 4))
    tracks.predict_slot(k, time, slots, MODES, x, P, mu, mean, covariance)
    return x, P, mu, mean, covariance


@pytest.mark.parametrize("seconds", [1e-3, 0.02, 0.5, 4.0, 30.0])
def test_the_spread_between_updates_is_that_of_the_mode_switching_process(seconds):
    """Of a kept mixture: its straight flight, and the integral of the density expected by a matrix exponential."""
    slots = some_slots(np.random.default_rng(0))
    F = np.kron(np.eye(2), [[1.0, seconds], [0.0, 1.0]])
    for k in range(3):
        first = slots.probability[k]

        def density(u, first=first):
            return float(first @ expm(GENERATOR * u) @ np.array(MODES.density))

        grown = quad(lambda u: (seconds - u) ** 2 * density(u), 0.0, seconds, epsrel=1e-12)[0]
        P = F @ mixture(first, slots.mean[k], slots.covariance[k])[1] @ F.T
        want = [P[0, 0] + grown, P[0, 2], P[2, 2] + grown]
        np.testing.assert_allclose(tracks.spread_at(slots.moments[k], MODES, seconds), want, rtol=1e-9)


def test_first_tracks_are_around_the_truth_of_the_known():
    slots = some_slots(np.random.default_rng(0))
    slots.existence[:] = 0.0
    rng = np.random.default_rng(1)
    x, error, origin = rng.normal(0, 1e3, (4, 4)), rng.normal(0, 1, (4, 4)), np.full(3, -1)
    here, known, sd = np.array([1, 1, 0, 1], bool), np.array([0, 1, 1, 1], bool), np.array([100.0, 30.0, 100.0, 30.0])
    tracks.first_slots(0.0, x, here, known, error, MODES, np.array([1e4, 900.0]), slots, origin)
    np.testing.assert_array_equal(origin, [1, 3, -1])
    np.testing.assert_array_equal(slots.existence, [1, 1, 0])
    np.testing.assert_allclose(slots.section, [[1 / 3] * 3, [1 / 3] * 3, [0] * 3], rtol=1e-12)
    for k, g in ((0, 1), (1, 3)):
        np.testing.assert_allclose(slots.mean[k], np.tile(x[g] + sd * error[g], (2, 1)), rtol=1e-12)
        np.testing.assert_array_equal(slots.covariance[k], np.tile(np.diag(sd**2), (2, 1, 1)))


@pytest.mark.parametrize("seconds", [0.003, 1.0, 8.0])
def test_prediction_is_the_textbooks(seconds):
    slots = some_slots(np.random.default_rng(1))
    for k in range(3):
        x, P, mu, mean, covariance = predicted(slots, k, 1.0 + seconds)
        want = plain_prediction(slots, k, seconds)
        for got, expected in zip((x, P, mu[0]), want, strict=True):
            np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-9)
        whole = mixture(want[2], want[0], want[1])
        np.testing.assert_allclose(mean[0], whole[0], rtol=1e-12)
        np.testing.assert_allclose(covariance[0], whole[1], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("seen", [1.0, 0.8])
def test_update_is_the_textbooks(count, seen):
    """One linearisation at the prediction, with the joint innovation of range, sine and range-rate modulo the fold."""
    slots, fold = some_slots(np.random.default_rng(2)), 90.0
    for k in range(3):
        x, P, mu, mean, _ = predicted(slots, k, 3.0)
        px, vx, py, vy = mean[0]
        r = np.hypot(px, py)
        axis = px / r - 3e-3
        z = np.array([r + 9.0, axis + seen * 1e-3, (px * vx + py * vy) / r + 2.0])
        means, covariances, likelihood = [], [], []
        for j in range(2):
            px, vx, py, vy = x[j]
            r = np.hypot(px, py)
            s, c, across = px / r, py / r, (vx * py - vy * px) / r**2
            H = np.array([[s, 0, c, 0], [seen * c * c / r, 0, -seen * s * c / r, 0], [c * across, s, -s * across, c]])
            h = np.array([r, axis + seen * (s - axis), s * vx + c * vy])
            H, y = H[:count], (z - h)[:count]
            S = H @ P[j] @ H.T + np.diag(VARIANCE[:count])
            K = P[j] @ H.T @ np.linalg.inv(S)
            means.append(x[j] + K @ y)
            covariances.append(P[j] - K @ S @ K.T)
            likelihood.append(multivariate_normal(np.zeros(count), S).pdf(y))
        evidence = mu[0] @ likelihood
        weights = mu[0] * likelihood / evidence
        got = tracks.correct_slot(x, P, mu, (axis, seen, z + np.array([0, 0, 2 * fold]), VARIANCE, count, fold))
        assert got == pytest.approx(np.log(evidence), abs=1e-6)
        np.testing.assert_allclose(x, means, rtol=1e-9)
        np.testing.assert_allclose(P, covariances, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(mu[0], weights, rtol=1e-6)


def test_the_gradients_are_those_of_finite_differences():
    x, h, H = np.array([[9e3, 120.0, -15e3, -150.0]]), np.empty(3), np.empty((3, 4))
    tracks.look_at(x, 0, h, H)

    def measured(state):
        r = np.hypot(state[0], state[2])
        return np.array([r, state[0] / r, (state[0] * state[1] + state[2] * state[3]) / r])

    np.testing.assert_allclose(h, measured(x[0]), rtol=1e-12)
    steps = np.array([1.0, 1e-2, 1.0, 1e-2])
    for n, step in enumerate(np.diag(steps)):
        slope = (measured(x[0] + step) - measured(x[0] - step)) / (2 * steps[n])
        np.testing.assert_allclose(H[:, n], slope, rtol=1e-6, atol=1e-12)


def test_a_new_track_has_the_place_of_its_measurement():
    """Its covariance against measured places drawn around the truth."""
    slots, rng = some_slots(np.random.default_rng(3)), np.random.default_rng(4)
    sine = np.sin(0.7)
    tracks.begin_slot(1, 2.0, slots, MODES, 20e3, sine, VARIANCE, 200.0)
    r, azimuth = (
        20e3 + np.sqrt(VARIANCE[0]) * rng.standard_normal(100_000),
        np.arcsin(sine + np.sqrt(VARIANCE[1]) * rng.standard_normal(100_000)),
    )
    sample = np.cov([r * np.sin(azimuth), r * np.cos(azimuth)])
    for j in range(2):
        np.testing.assert_allclose(slots.mean[1, j], [20e3 * np.sin(0.7), 0.0, 20e3 * np.cos(0.7), 0.0], rtol=1e-12)
        P = slots.covariance[1, j]
        scale = np.sqrt(np.outer(np.diag(sample), np.diag(sample)))
        assert np.abs(P[::2, ::2] - sample).max() < 5 * np.sqrt(2 / 100_000) * scale.max()
        np.testing.assert_array_equal(P[1::2, 1::2], 200.0**2 * np.eye(2))
    np.testing.assert_allclose(slots.probability[1], [0.8, 0.2], rtol=1e-12)
