"""Beliefs in polar coordinates about a sensor: their Cartesian moments, both ways."""

from __future__ import annotations

import numpy as np
import pytest

from wavegym.trackers.polar_kernels import to_cartesian, to_polar

SENSOR = np.array([300.0, -200.0])
WIDE = np.diag([10.0, 1.0, 0.2, 8.0])  # standard deviations of range, range-rate, azimuth and cross velocity
WIDE[3, 2], WIDE[1, 0], WIDE[0, 2] = 4.0, 0.4, 3.0


def cartesian(p):
    """States [x xdot y ydot] of polar states (..., 4), about SENSOR."""
    r, rdot, azimuth, v = np.moveaxis(p, -1, 0)
    s, c = np.sin(azimuth), np.cos(azimuth)
    return np.stack([SENSOR[0] + r * s, rdot * s + v * c, SENSOR[1] + r * c, rdot * c - v * s], axis=-1)


@pytest.mark.parametrize("azimuth", [0.3, -2.9, 3.1])
def test_cartesian_moments_are_those_of_drawn_states(azimuth):
    """A belief that bends by 20 m; every moment to five standard errors of 400 000 draws."""
    p, count = np.array([1000.0, 3.0, azimuth, -12.0]), 400_000
    x, P = to_cartesian(p, WIDE @ WIDE.T, SENSOR)
    drawn = cartesian(p + np.random.default_rng(1).standard_normal((count, 4)) @ WIDE.T)
    d = drawn - drawn.mean(axis=0)
    products = d[:, :, None] * d[:, None, :]
    assert (np.abs(drawn.mean(axis=0) - x) < 5 * drawn.std(axis=0) / np.sqrt(count)).all()
    assert (np.abs(products.mean(axis=0) - P) < 5 * products.std(axis=0) / np.sqrt(count)).all()


@pytest.mark.parametrize("r", [1e3, 1e8])
def test_a_narrow_belief_is_transformed_by_its_gradient(r):
    """Nothing cancels: 1e-9 of a covariance of 1 m at 100 000 km."""
    p, spread = np.array([r, -30.0, 2.0, 40.0]), np.diag([1.0, 0.1, 1.0 / r, 0.1])
    spread[2, 0] = 0.5 / r
    s, c = np.sin(p[2]), np.cos(p[2])
    D = np.array(
        [[s, 0, r * c, 0], [0, s, p[1] * c - p[3] * s, c], [c, 0, -r * s, 0], [0, c, -p[1] * s - p[3] * c, -s]]
    )
    _, P = to_cartesian(p, spread @ spread.T, SENSOR)
    np.testing.assert_allclose(P, D @ spread @ spread.T @ D.T, rtol=3e-5 if r < 1e6 else 1e-9, atol=1e-9)


@pytest.mark.parametrize("place", [(400.0, 900.0), (-900.0, -200.0), (300.0, -1900.0)])
def test_there_and_back(place):
    """Ten metres at about a kilometre: second-order terms are 1e-4 of the spread; also behind the sensor."""
    x = np.array([place[0], 5.0, place[1], -3.0])
    P = np.array([[100.0, 5.0, 20.0, 0.0], [5.0, 4.0, 0.0, 0.5], [20.0, 0.0, 60.0, 3.0], [0.0, 0.5, 3.0, 2.0]])
    again, Q = to_cartesian(*to_polar(x, P, SENSOR), SENSOR)
    np.testing.assert_allclose(again, x, atol=2e-3)
    np.testing.assert_allclose(Q, P, atol=0.02)
