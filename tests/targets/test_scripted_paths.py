from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from wavegym.core.errors import InputError
from wavegym.targets import ScriptedPath, Segment


def integrated(path: ScriptedPath, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities by brute-force integration of the equations of motion, segment by segment."""
    d = len(path.start)

    def rates(_, state, segment):
        v = state[d:]
        if np.ndim(segment.acceleration):
            a = np.asarray(segment.acceleration)
        elif not segment.acceleration and not segment.turn_rate:
            a = np.zeros(d)
        else:
            a = segment.acceleration * v / np.linalg.norm(v)
            if segment.turn_rate:
                a = a + segment.turn_rate * np.array([-v[1], v[0]])
        return np.concatenate([v, a])

    state, begin = np.concatenate([path.start, path.velocity]).astype(float), 0.0
    found = np.empty((len(times), 2 * d))
    for segment in [*path.segments, Segment(1e3)]:
        end = begin + segment.duration
        inside = (times >= begin) & (times < end)
        solution = solve_ivp(
            rates, (begin, end), state, "DOP853", args=(segment,), rtol=1e-11, atol=1e-11, dense_output=True
        )
        if inside.any():
            found[inside] = solution.sol(times[inside]).T
        state, begin = solution.y[:, -1], end
    return found[:, :d], found[:, d:]


def urban() -> ScriptedPath:
    """Barbosa et al.: the path of both targets; its end point fits a first stretch of 5 s, not the printed 10."""
    segments = [Segment(5.0), Segment(5.0, -1.0), Segment(10.0, turn_rate=np.pi / 20), Segment(5.0, 1.0), Segment(10.0)]
    return ScriptedPath((1950.0, 1500.0), (10.0, 0.0), segments)


def test_urban_path_ends_where_published():
    path = urban()
    assert path.duration == 35.0
    np.testing.assert_allclose(path.sample(35.0).positions, (2069.33, 1669.33), atol=0.005)
    # by hand: 50 + 37.5 m, a quarter circle of radius v/w = 100/pi, then 37.5 + 100 m
    np.testing.assert_allclose(path.sample(35.0).positions, (2037.5 + 100 / np.pi, 1637.5 + 100 / np.pi), rtol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(path.sample([0, 7, 15, 30]).velocities, axis=1), [10, 8, 5, 10])


segments_2d = st.lists(
    st.one_of(
        st.builds(Segment, st.floats(0.5, 8), st.floats(-0.3, 2.0), st.floats(-1.0, 1.0)),
        st.builds(Segment, st.floats(0.5, 8), st.tuples(st.floats(-2, 2), st.floats(0.0, 2))),
        st.builds(Segment, st.floats(0.5, 8), st.just(0.5), st.sampled_from([1e-12, 1e-6, -1e-3])),
    ),
    max_size=4,
)


@settings(max_examples=25)
@given(segments_2d)
def test_closed_forms_equal_integration(segments):
    path = ScriptedPath((5.0, -3.0), (4.0, 30.0), segments)
    times = np.linspace(0.0, path.duration + 5.0, 57)
    sampled = path.sample(times)
    positions, velocities = integrated(path, times)
    np.testing.assert_allclose(sampled.positions, positions, rtol=1e-8, atol=1e-7)
    np.testing.assert_allclose(sampled.velocities, velocities, rtol=1e-8, atol=1e-7)


@settings(max_examples=25)
@given(segments_2d)
def test_acceleration_is_the_derivative_of_velocity(segments):
    path = ScriptedPath((5.0, -3.0), (4.0, 30.0), segments)
    times = np.linspace(0.013, path.duration + 3.0, 41)
    joints = np.cumsum([segment.duration for segment in path.segments])
    h = 1e-4
    times = times[(np.abs(times[:, None] - joints) > 2 * h).all(axis=1)]
    slope = (path.sample(times + h).velocities - path.sample(times - h).velocities) / (2 * h)
    np.testing.assert_allclose(path.sample(times).accelerations, slope, atol=1e-5)


@pytest.mark.parametrize("turn_rate", [0.9999999, 1.0000001, 5.0])
def test_turn_with_acceleration_on_both_sides_of_the_series(turn_rate):
    path = ScriptedPath((0.0, 0.0), (20.0, 0.0), [Segment(1.0, 3.0, turn_rate)])
    positions, _ = integrated(path, np.array([0.5, 1.0 - 1e-12]))
    np.testing.assert_allclose(path.sample([0.5, 1.0 - 1e-12]).positions, positions, rtol=1e-9)


@pytest.mark.parametrize(
    ("start", "velocity", "acceleration"),
    [((5.0,), (-3.0,), -0.5), ((0.0, 1.0, 2.0), (3.0, -4.0, 12.0), 2.0), ((0.0, 1.0, 2.0), (0.0, 0.0, 0.0), (1, 2, 3))],
)
def test_one_and_three_axes(start, velocity, acceleration):
    path = ScriptedPath(start, velocity, [Segment(4.0, acceleration)])
    times = np.linspace(0.0, 6.0, 13)
    positions, velocities = integrated(path, times)
    sampled = path.sample(times)
    np.testing.assert_allclose(sampled.positions, positions, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(sampled.velocities, velocities, rtol=1e-9, atol=1e-9)


def test_full_circle_returns():
    path = ScriptedPath((7.0, 9.0), (0.0, -12.0), [Segment(20.0, turn_rate=-np.pi / 10)])
    end = path.sample(20.0)
    np.testing.assert_allclose(end.positions, (7.0, 9.0), atol=1e-12)
    np.testing.assert_allclose(end.velocities, (0.0, -12.0), atol=1e-12)


def test_stop_and_go_keeps_the_heading():
    path = ScriptedPath((0.0, 0.0), (0.3, 0.4), [Segment(5.0, -0.1), Segment(2.0), Segment(4.0, 1.0)])
    sampled = path.sample([6.0, 11.0])
    np.testing.assert_array_equal(sampled.velocities[0], 0.0)
    np.testing.assert_allclose(sampled.positions[1], np.array([0.6, 0.8]) * (1.25 + 8.0), rtol=1e-12)


def test_a_joint_has_the_acceleration_that_begins():
    sampled = urban().sample([5.0, 10.0])
    np.testing.assert_allclose(sampled.accelerations, [[-1.0, 0.0], [0.0, 5.0 * np.pi / 20]], atol=1e-15)


def test_shape_of_times_is_kept():
    assert urban().sample(np.zeros((3, 4))).positions.shape == (3, 4, 2)
    assert urban().sample(1.0).velocities.shape == (2,)
    assert urban().sample([]).accelerations.shape == (0, 2)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Segment(0.0), "duration is 0.0 s"),
        (lambda: Segment(1.0, float("inf")), "acceleration is inf"),
        (lambda: Segment(1.0, turn_rate=float("nan")), "turn_rate is nan"),
        (lambda: Segment(1.0, (1.0, 0.0), 0.1), r"turn_rate is 0\.1 with a vector acceleration"),
        (lambda: ScriptedPath((0.0, 0.0), (1.0,)), "1 to 3 axes"),
        (lambda: ScriptedPath((0.0,) * 4, (1.0,) * 4), "1 to 3 axes"),
        (lambda: ScriptedPath((0.0, np.nan), (1.0, 1.0)), "finite"),
        (
            lambda: ScriptedPath((0.0,), (1.0,), [Segment(1.0), Segment(1.0, turn_rate=0.1)]),
            r"segments\[1\]: turn_rate",
        ),
        (lambda: ScriptedPath((0.0, 0.0), (1.0, 0.0), [Segment(1.0, (1.0,))]), r"shape \(1,\), expected \(2,\)"),
        (lambda: ScriptedPath((0.0, 0.0), (0.0, 0.0), [Segment(1.0, 1.0)]), "no direction of motion"),
        (lambda: ScriptedPath((0.0, 0.0), (6.0, 8.0), [Segment(20.0, -1.0)]), r"standstill \(nearest: 10 s\)"),
        (lambda: urban().sample([0.0, -1.0]), "negative"),
        (lambda: urban().sample(np.nan), "not finite"),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(InputError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
