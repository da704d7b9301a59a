"""Range and range-rate against plain NumPy, and their Jacobian against complex-step differentiation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.sensors import range_and_rate, range_and_rate_jacobian

STEP = 1e-30


def plain(state, sensor):
    """Analytic in the state, so that a complex step differentiates it to the last digits."""
    dx, dy, vx, vy = state[0] - sensor[0], state[1] - sensor[1], state[2], state[3]
    r = np.sqrt(dx**2 + dy**2)
    return np.array([r, (dx * vx + dy * vy) / r])


def scene(lead=(), seed=0):
    """Targets with leading axes ``lead`` and sensors at distances over four decades from them."""
    rng = np.random.default_rng(seed)
    state = rng.standard_normal((*lead, 4)) * [2e3, 2e3, 300, 300]
    return state, state[..., :2] + rng.standard_normal((*lead, 2)) * 10 ** rng.uniform(1, 5, (*lead, 1))


def test_known_geometry():
    np.testing.assert_array_equal(range_and_rate([3.0, 4.0, 10.0, 0.0], [0.0, 0.0]), [5.0, 6.0])
    assert range_and_rate([3.0, 4.0, -10.0, 0.0], [0.0, 0.0])[1] == -6.0  # approaching


def test_equals_plain_numpy():
    for state, sensor in zip(*scene((50,)), strict=True):
        np.testing.assert_allclose(range_and_rate(state, sensor), plain(state, sensor), rtol=1e-13, atol=1e-10)


def test_jacobian_is_the_derivative():
    for state, sensor in zip(*scene((50,)), strict=True):
        steps = state + 1j * STEP * np.eye(4)
        derivative = np.stack([plain(s, sensor).imag / STEP for s in steps], axis=1)
        scale = np.abs(derivative).max(axis=1, keepdims=True)
        np.testing.assert_allclose(range_and_rate_jacobian(state, sensor) / scale, derivative / scale, atol=1e-12)


@given(st.floats(-np.pi, np.pi), st.integers(0, 99))
def test_a_rotation_changes_nothing(angle, seed):
    state, sensor = scene(seed=seed)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    turned = range_and_rate(np.concatenate([turn @ state[:2], turn @ state[2:]]), turn @ sensor)
    np.testing.assert_allclose(turned, range_and_rate(state, sensor), rtol=1e-11, atol=1e-9)


def test_at_the_sensor_everything_stays_finite():
    r, rdot = range_and_rate([1.0, 2.0, 30.0, -40.0], [1.0, 2.0])
    assert 0 < r <= 1e-9
    assert rdot == 0
    assert np.isfinite(range_and_rate_jacobian([1.0, 2.0, 30.0, -40.0], [1.0, 2.0])).all()
    close = range_and_rate([1e-200, 0.0, 30.0, -40.0], [0.0, 0.0])
    assert abs(close[1]) <= 50


def test_a_batch_equals_its_elements_bit_for_bit():
    state, sensor = scene((5, 3))
    z, H = range_and_rate(state, sensor), range_and_rate_jacobian(state, sensor)
    assert z.shape == (5, 3, 2)
    assert H.shape == (5, 3, 2, 4)
    for index in np.ndindex(5, 3):
        assert (range_and_rate(state[index], sensor[index]) == z[index]).all()
        assert (range_and_rate_jacobian(state[index], sensor[index]) == H[index]).all()


def test_leading_axes_broadcast():
    state, _ = scene((5, 1))
    sensors = np.array([[3e3, -16e3], [3e3, 20.4e3]])
    z = range_and_rate(state, sensors)
    assert z.shape == (5, 2, 2)
    assert (z[3, 1] == range_and_rate(state[3, 0], sensors[1])).all()


@pytest.mark.parametrize("function", [range_and_rate, range_and_rate_jacobian])
def test_shapes_that_do_not_fit(function):
    with pytest.raises(InputError, match=r"state has shape \(3,\), expected \(\.\.\., 4\)"):
        function(np.zeros(3), np.zeros(2))
    with pytest.raises(InputError, match=r"sensor has shape \(\), expected \(\.\.\., 2\)"):
        function(np.zeros(4), 0.0)
    with pytest.raises(InputError, match="leading axes that broadcast"):
        function(np.zeros((2, 4)), np.zeros((3, 2)))
