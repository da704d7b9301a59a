"""Models of manoeuvring targets against scripted paths, matrix exponentials and the paper's matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from wavegym.core.errors import InputError
from wavegym.targets import ScriptedPath, Segment, constant_velocity
from wavegym.targets.manoeuvres import (
    constant_turn,
    coordinated_turn,
    nearly_constant_acceleration,
    nearly_constant_velocity,
)

T, OMEGA = 0.25, np.pi / 20


@pytest.mark.parametrize("rate", [OMEGA, -OMEGA, 1e-9, 0.0])
def test_a_turn_is_the_scripted_path_s(rate) -> None:
    path = ScriptedPath((5.0, -3.0), (4.0, 3.0), [Segment(2.0, turn_rate=rate)])
    F, state = coordinated_turn(T, rate, 0.1).F, np.array([5.0, -3.0, 4.0, 3.0, 9.0, 9.0])
    for k in range(1, 8):
        state = F @ state
        at = path.sample(k * T)
        np.testing.assert_allclose(state[:4], [*at.positions, *at.velocities], rtol=1e-12, atol=1e-15)
        assert not state[4:].any()


@pytest.mark.parametrize("order", ["axis", "derivative"])
def test_a_constant_turn_is_the_coordinated_turn_with_white_acceleration(order) -> None:
    straight, places = constant_velocity(T, 2.0, ("x", "y"), order), [0, 2, 1, 3] if order == "axis" else [0, 1, 2, 3]
    turn = constant_turn(T, 2.0, OMEGA, order)
    np.testing.assert_array_equal(turn.F, coordinated_turn(T, OMEGA, 0.1).F[np.ix_(places, places)])
    np.testing.assert_array_equal(turn.Q, straight.Q)
    assert turn.names == straight.names
    np.testing.assert_array_equal(constant_turn(T, 2.0, 0.0, order).F, straight.F)


def test_straight_on_and_constant_acceleration() -> None:
    np.testing.assert_array_equal(nearly_constant_velocity(T, 0.1).F, coordinated_turn(T, 0.0, 0.1).F)
    generator = np.kron([[0, 1, 0], [0, 0, 1], [0, 0, 0]], np.eye(2))  # x' = xdot, xdot' = xddot
    np.testing.assert_allclose(nearly_constant_acceleration(T, 0.1).F, expm(T * generator))


def test_the_papers_matrices() -> None:
    """In its order [x xdot y ydot xddot yddot]; the left turn as printed."""
    order = [0, 2, 1, 3, 4, 5]
    s, c = np.sin(OMEGA * T), np.cos(OMEGA * T)
    printed = np.zeros((6, 6))
    printed[:4, :4] = [
        [1, s / OMEGA, 0, -(1 - c) / OMEGA], [0, c, 0, -s], [0, (1 - c) / OMEGA, 1, s / OMEGA], [0, s, 0, c],
    ]  # fmt: skip
    np.testing.assert_allclose(coordinated_turn(T, OMEGA, 0.1).F[np.ix_(order, order)], printed, atol=1e-15)
    block = np.array([[T**2 / 2, 0], [T, 0], [0, T**2 / 2], [0, T], [1, 0], [0, 1]])  # G of the Wiener sequence
    Q = nearly_constant_acceleration(T, 0.3).Q[np.ix_(order, order)]
    np.testing.assert_allclose(Q, block @ np.diag([0.09, 0.09]) @ block.T)
    block[4:] = 0.0
    Q = nearly_constant_velocity(T, 0.25).Q[np.ix_(order, order)]
    np.testing.assert_allclose(Q, block @ np.diag([0.0625, 0.0625]) @ block.T + np.diag([0, 0, 0, 0, 0.25, 0.25]))
    np.testing.assert_array_equal(nearly_constant_velocity(T, 0.25, 0.0).Q[4:], 0.0)


def test_mistakes() -> None:
    with pytest.raises(InputError, match="dt is 0"):
        nearly_constant_acceleration(0.0, 0.1)
    with pytest.raises(InputError, match="sigma is -1"):
        nearly_constant_velocity(T, -1.0)
    with pytest.raises(InputError, match="acceleration is -1"):
        nearly_constant_velocity(T, 1.0, -1.0)
    with pytest.raises(InputError, match="turn_rate is nan"):
        coordinated_turn(T, np.nan, 1.0)
