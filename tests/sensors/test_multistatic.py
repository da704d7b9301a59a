"""Range, range-rate and their Jacobian; lengths, rates and walls of paths by a target against drawn rays.

Multilateration returns the target that was measured.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.sensors import multistatic_range_and_rate, range_and_rate, range_and_rate_jacobian
from wavegym.sensors.geometry_kernels import direction_variance
from wavegym.sensors.multipath import Antenna
from wavegym.sensors.multistatic import Multistatic
from wavegym.sensors.urban_map import Building, UrbanMap
from wavegym.trackers import multilaterate

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


CROSSING = UrbanMap.load("intersection")
PAIR = Multistatic(Antenna(CROSSING, (2085.0, 1470.5)), Antenna(CROSSING, (2078.0, 1467.0)))
STATES = np.array([[1950.0, 1500.0, 10.0, 0.0], [2030.0, 1500.0, 6.0, 0.0], [2069.0, 1640.0, 0.0, 10.0]])


def polyline(antenna: Antenna, image: int, point) -> np.ndarray:
    """The ray from an antenna to a point."""
    bounces = antenna.bounces(point)[image]
    return np.vstack([antenna.position, bounces[~np.isnan(bounces).any(axis=1)], point])


def length(pair: Multistatic, path: int, point) -> float:
    rays = (polyline(a, i, point) for a, i in zip((pair.transmitter, pair.receiver), pair.paths[path], strict=True))
    return sum(np.linalg.norm(np.diff(ray, axis=0), axis=1).sum() for ray in rays)


def test_the_paper_s_eight_kinds() -> None:
    """Six with the target and two without."""
    assert set(PAIR.kinds) == {"TXR", "TXCR", "TCXR", "TCXCR", "TXCCR", "TCCXR"}
    assert PAIR.kinds[0] == "TXR"
    assert PAIR.walls.tolist() == [kind.count("C") for kind in PAIR.kinds] == sorted(PAIR.walls)
    np.testing.assert_allclose(PAIR.reflected, 0.4**PAIR.walls)  # all walls reflect alike
    y = np.linspace(1490, 1740, 60)
    visible = PAIR.visible(np.stack([np.full(60, 2069.0), y], axis=1)).any(axis=0)
    assert {kind for kind, seen in zip(PAIR.kinds, visible, strict=True) if seen} >= {"TXR", "TXCR", "TCXR", "TCXCR"}


@pytest.mark.parametrize("state", STATES)
def test_range_and_rate_are_half_the_path_length_and_its_growth(state) -> None:
    r, rdot = PAIR.measure(state).T
    step = 1e-4
    visible_paths = np.flatnonzero(PAIR.visible(state[:2]))
    assert len(visible_paths) > 0
    for path in visible_paths:
        before, after = (length(PAIR, path, state[:2] + sign * step * state[2:]) for sign in (-1, 1))
        assert r[path] == pytest.approx(length(PAIR, path, state[:2]) / 2, rel=1e-12)
        assert rdot[path] == pytest.approx((after - before) / (4 * step), abs=1e-6)


def test_transmitter_and_receiver_can_change_places() -> None:
    turned = Multistatic(PAIR.receiver, PAIR.transmitter)
    points = STATES[:, :2]
    every = PAIR.visible(points), turned.visible(points), PAIR.measure(STATES), turned.measure(STATES)
    for here, there, a, b in zip(*every, strict=True):
        ours, theirs = (sorted(map(tuple, z[seen].round(9))) for z, seen in ((a, here), (b, there)))
        assert ours == theirs


def test_in_one_place_it_is_an_ordinary_radar() -> None:
    z = multistatic_range_and_rate([3.0, 4.0, 10.0, 0.0], [0.0, 0.0], [0.0, 0.0])
    np.testing.assert_array_equal(z, [5.0, 6.0])
    assert multistatic_range_and_rate(np.zeros((5, 1, 4)), np.ones((3, 2)), [2.0, 2.0]).shape == (5, 3, 2)


def test_what_returns_without_a_target() -> None:
    """Two antennas before one wall: echoes of the wall and of the visible scatterer, not of the one behind the wall."""
    wall = Building(((50.0, 10.0), (-50.0, 10.0), (-50.0, 20.0), (50.0, 20.0)), 0.3)
    urban_map = UrbanMap(buildings=(wall,), discretes=((0.0, 4.0), (0.0, 30.0)))
    echoes = Multistatic(Antenna(urban_map, (-3.0, 0.0)), Antenna(urban_map, (3.0, 0.0))).background()
    np.testing.assert_allclose(echoes.r, [np.hypot(3.0, 10.0), 5.0])
    np.testing.assert_allclose(echoes.reflected, [0.3, 1.0])
    np.testing.assert_allclose(echoes.source, [[-3.0, 20.0], [0.0, 4.0]])
    empty = Multistatic(Antenna(UrbanMap(), (-3.0, 0.0)), Antenna(UrbanMap(), (3.0, 0.0))).background()
    assert len(empty.r) == 0


def test_the_crossing_s_background() -> None:
    """Every echo over walls is as long as the ray that ``Antenna.bounces`` draws."""
    echoes, (tx, rx) = PAIR.background(), (PAIR.transmitter, PAIR.receiver)
    seen = tx.visible(rx.position) & (tx.order > 0)
    drawn = [
        np.linalg.norm(np.diff(polyline(tx, i, rx.position), axis=0), axis=1).sum() / 2 for i in np.flatnonzero(seen)
    ]
    np.testing.assert_allclose(echoes.r[: len(drawn)], drawn)
    assert len(drawn) > 0
    assert len(echoes.r) > len(drawn)


def test_mistakes() -> None:
    with pytest.raises(InputError, match="different urban maps"):
        Multistatic(Antenna(CROSSING, (2085.0, 1470.5)), Antenna(UrbanMap(), (0.0, 0.0)))
    with pytest.raises(InputError, match=r"state has shape \(3,\)"):
        PAIR.measure([1.0, 2.0, 3.0])


@pytest.mark.parametrize("state", STATES)
def test_a_direction_is_that_of_the_last_leg_of_the_ray(state) -> None:
    """The angle between the axis of the array and the ray that arrives, over walls too."""
    axis = (0.6, 0.8)
    pair = Multistatic(PAIR.transmitter, Antenna(CROSSING, PAIR.receiver.position, axis))
    cosines = pair.directions(state[:2])
    for path in np.flatnonzero(pair.visible(state[:2])):
        leg = np.diff(polyline(pair.receiver, pair.paths[path, 1], state[:2])[:2], axis=0)[0]
        assert cosines[path] == pytest.approx(leg @ axis / np.linalg.norm(leg), abs=1e-9)


@pytest.mark.parametrize("elements", [2, 3, 8])
def test_the_variance_of_a_direction_is_the_bound(elements) -> None:
    """Fisher information of the cosine from samples a exp(j (phase + pi m c)), m = 0, 1, ..., in unit noise."""
    eta, m = 37.0, np.arange(elements)
    amplitude = np.sqrt(eta / 2.0 / elements)
    slopes = amplitude * np.stack([1j * np.pi * m, 1j * np.ones(elements), np.ones(elements) / amplitude], axis=1)
    information = 2.0 * (slopes.conj().T @ slopes).real
    assert direction_variance(eta, elements) == pytest.approx(np.linalg.inv(information)[0, 0], rel=1e-12)


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


def test_mistakes_in_multilateration():
    with pytest.raises(InputError, match="stand in one line, expected a triangle"):
        multilaterate(np.ones((2, 2)), R, TX, np.stack([TX + 1.0, TX - 2.0]))
    with pytest.raises(InputError, match=r"transmitter has shape \(2, 2\), expected \(2,\)"):
        multilaterate(np.ones((2, 2)), R, [TX, TX], RX)
    with pytest.raises(InputError, match="that broadcast"):
        multilaterate(np.ones((3, 2, 2)), np.ones((4, 2, 2, 2)), TX, RX)
    with pytest.raises(InputError, match=r"measurements has shape \(2,\)"):
        multilaterate([1.0, 2.0], R, TX, RX)
