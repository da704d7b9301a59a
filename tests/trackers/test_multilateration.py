"""Multilateration: both states give the measurements, and their errors have the stated covariance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.sensors import multistatic_range_and_rate
from wavegym.trackers import multilaterate

TX, RX = np.array([2085.0, 1470.5]), np.array([[2088.0, 1475.0], [2078.0, 1467.0]])
R = np.broadcast_to(np.diag([0.04, 0.01]), (2, 2, 2))


def measure(state):
    return np.stack([multistatic_range_and_rate(state, TX, place) for place in RX], axis=-2)


@given(st.floats(-np.pi, np.pi), st.floats(20.0, 250.0), st.floats(-15.0, 15.0), st.floats(-15.0, 15.0))
def test_one_of_the_two_states_is_the_target_and_both_measure_alike(bearing, distance, vx, vy):
    state = np.array([*(TX + distance * np.array([np.cos(bearing), np.sin(bearing)])), vx, vy])
    found, _ = multilaterate(measure(state), R, TX, RX)
    off = np.abs(found - state).max(axis=1)
    assume(
        np.linalg.norm(found[0, :2] - found[1, :2]) > 1.0 or np.isnan(found).any()
    )  # on the line both states coincide
    assert np.nanmin(off) < 1e-4
    for each in found[~np.isnan(found).any(axis=1)]:
        np.testing.assert_allclose(measure(each), measure(state), atol=1e-5)


def test_the_covariance_is_that_of_many_trials():
    """To first order: errors of 0.2 m and 0.1 m/s are small against the curvature at 100 m."""
    rng = np.random.default_rng(0)
    state = np.array([2069.0, 1570.0, 1.0, 9.0])
    errors = np.broadcast_to([[4e-4, 1e-4], [1e-4, 1e-2]], (2, 2, 2))
    noise = rng.multivariate_normal(np.zeros(2), errors[0], (40_000, 2))
    found, covariance = multilaterate(measure(state) + noise, errors, TX, RX)
    nearest = np.abs(found[:, :, :2] - state[:2]).sum(axis=2).argmin(axis=1)
    trials = found[np.arange(len(found)), nearest]
    exact, P = multilaterate(measure(state), errors, TX, RX)
    P = P[np.abs(exact - state).sum(axis=1).argmin()]
    scale = np.sqrt(np.diag(P))
    share = np.cov(trials.T) / np.outer(scale, scale)
    np.testing.assert_allclose(share, P / np.outer(scale, scale), atol=5 * np.sqrt(2 / len(trials)))
    np.testing.assert_allclose(trials.mean(axis=0), state, atol=0.05 * scale.max())
    assert covariance.shape == (40_000, 2, 4, 4)


def test_ranges_that_do_not_meet():
    z = measure(np.array([2069.0, 1570.0, 1.0, 9.0]))
    z[1, 0] += 10.0  # receivers are 12.8 m apart, half ways differ by at most half of that
    found, covariance = multilaterate(z, R, TX, RX)
    assert np.isnan(found).all()
    assert np.isnan(covariance).all()


def test_mistakes():
    with pytest.raises(InputError, match="stand in one line, expected a triangle"):
        multilaterate(np.ones((2, 2)), R, TX, np.stack([TX + 1.0, TX - 2.0]))
    with pytest.raises(InputError, match=r"transmitter has shape \(2, 2\), expected \(2,\)"):
        multilaterate(np.ones((2, 2)), R, [TX, TX], RX)
    with pytest.raises(InputError, match="that broadcast"):
        multilaterate(np.ones((3, 2, 2)), np.ones((4, 2, 2, 2)), TX, RX)
    with pytest.raises(InputError, match=r"measurements has shape \(2,\)"):
        multilaterate([1.0, 2.0], R, TX, RX)
