from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from wavegym.core.errors import InputError
from wavegym.targets import MotionModel, ScriptedPath, Segment, constant_acceleration, constant_velocity, random_path
from wavegym.targets.motion import (
    constant_turn,
    coordinated_turn,
    nearly_constant_acceleration,
    nearly_constant_velocity,
)


def discretised(derivatives: int, dt: float, q: float) -> tuple[np.ndarray, np.ndarray]:
    """F and Q of one axis by Van Loan's method (1978), from the continuous model alone."""
    A = np.diag(np.ones(derivatives - 1), 1)
    G = np.zeros((derivatives, derivatives))
    G[-1, -1] = q
    n = derivatives
    block = expm(np.block([[-A, G], [np.zeros((n, n)), A.T]]) * dt)
    F = block[n:, n:].T
    return F, F @ block[:n, n:]


@pytest.mark.parametrize(("factory", "n"), [(constant_velocity, 2), (constant_acceleration, 3)])
@pytest.mark.parametrize("dt", [0.25, 1.0, 3.0])
def test_one_axis_is_the_discretised_continuous_model(factory, n, dt):
    F, Q = discretised(n, dt, 2.5)
    model = factory(dt, 2.5)
    np.testing.assert_allclose(model.F, F, rtol=1e-13)
    np.testing.assert_allclose(model.Q, Q, rtol=1e-12)
    assert model.names == ("r", "rdot", "rddot")[:n]


@pytest.mark.parametrize("factory", [constant_velocity, constant_acceleration])
def test_orders_hold_the_same_model_under_their_names(factory):
    by_axis = factory(0.5, 3.0, axes=("x", "y"))
    by_derivative = factory(0.5, 3.0, axes=("x", "y"), order="derivative")
    assert by_axis.names[:2] == ("x", "xdot")
    assert by_derivative.names[:2] == ("x", "y")
    where = [by_axis.names.index(name) for name in by_derivative.names]
    np.testing.assert_array_equal(by_derivative.F, by_axis.F[np.ix_(where, where)])
    np.testing.assert_array_equal(by_derivative.Q, by_axis.Q[np.ix_(where, where)])
    n = len(by_axis.names) // 2
    np.testing.assert_array_equal(by_axis.F[n:, :n], 0)  # axes do not mix
    np.testing.assert_array_equal(by_axis.Q[:n, n:], 0)


@pytest.mark.parametrize("factory", [constant_velocity, constant_acceleration])
@pytest.mark.parametrize("order", ["axis", "derivative"])
@pytest.mark.parametrize("dt", [1e-3, 1.0, 100.0])
def test_noise_factor_is_the_cholesky_factor(factory, order, dt):
    model = factory(dt, 7.0, axes=("x", "y"), order=order)
    np.testing.assert_allclose(model.noise_factor, np.linalg.cholesky(model.Q), rtol=1e-8)


def test_noise_factor_of_a_singular_covariance():
    G = np.array([[0.5], [1.0], [-2.0]])  # Wiener-sequence models have Q = G Gᵀ
    model = MotionModel(np.eye(3), G @ G.T, ("a", "b", "c"))
    np.testing.assert_allclose(model.noise_factor @ model.noise_factor.T, G @ G.T, atol=1e-15)
    assert not constant_velocity(1.0, 0.0).noise_factor.any()


def test_path_without_noise_is_a_matrix_power():
    model = constant_acceleration(0.5, 0.0, axes=("x", "y"))
    start = np.array([1e3, -20.0, 0.5, -2e3, 5.0, 0.1])
    path = random_path(model, start, np.random.default_rng(0).standard_normal((40, 6)))
    expected = [np.linalg.matrix_power(model.F, k) @ start for k in range(41)]
    np.testing.assert_allclose(path, expected, rtol=1e-12)


def test_path_is_the_sum_of_what_every_noise_became():
    model = constant_velocity(1.0, 4.0, axes=("x", "y"), order="derivative")
    rng = np.random.default_rng(3)
    start, noise = rng.standard_normal(4), rng.standard_normal((12, 4))
    L = np.linalg.cholesky(model.Q)
    path = random_path(model, start, noise)
    for k in range(13):
        powers = [np.linalg.matrix_power(model.F, k - 1 - j) @ L @ noise[j] for j in range(k)]
        np.testing.assert_allclose(path[k], np.linalg.matrix_power(model.F, k) @ start + sum(powers), rtol=1e-11)


def test_generator_draws_the_noise():
    model = constant_velocity(1.0, 1.0)
    noise = np.random.default_rng(5).standard_normal((50, 2))
    drawn = random_path(model, [2e4, 200.0], np.random.default_rng(5), 50)
    np.testing.assert_array_equal(drawn, random_path(model, [2e4, 200.0], noise))


@settings(max_examples=30)
@given(st.sampled_from([(), (1,), (3,), (2, 4)]), st.integers(0, 2**32 - 1), st.booleans())
def test_batch_is_bitwise_its_elements(lead, seed, shared_start):
    model = constant_velocity(0.7, 2.0, axes=("x", "y"))
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((*lead, 9, 4))
    start = rng.standard_normal(4 if shared_start else (*lead, 4))
    paths = random_path(model, start, noise)
    assert paths.shape == (*lead, 10, 4)
    starts = np.broadcast_to(start, (*lead, 4))
    for index in np.ndindex(lead):
        np.testing.assert_array_equal(paths[index], random_path(model, starts[index], noise[index]))


def test_strided_noise_gives_the_same_path():
    model = constant_velocity(1.0, 1.0)
    wide = np.random.default_rng(0).standard_normal((20, 4))
    np.testing.assert_array_equal(
        random_path(model, [0.0, 1.0], wide[:, ::2]), random_path(model, [0.0, 1.0], wide[:, ::2].copy())
    )


def test_end_of_random_paths_has_the_models_covariance():
    model = constant_velocity(1.0, 2.0)
    steps, paths = 6, 40_000
    ends = random_path(model, np.zeros((paths, 2)), np.random.default_rng(11), steps)[:, -1]
    P = np.zeros((2, 2))
    for _ in range(steps):
        P = model.F @ P @ model.F.T + model.Q
    spread = ends.T @ ends / paths
    # variance of a sample covariance entry: (P_ii P_jj + P_ij²)/N; five standard deviations
    tolerance = 5 * np.sqrt((np.outer(np.diag(P), np.diag(P)) + P * P) / paths)
    assert (np.abs(spread - P) < tolerance).all()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: constant_velocity(0.0, 1.0), "dt is 0.0 s, expected"),
        (lambda: constant_velocity(1.0, -1.0), "q is -1.0"),
        (lambda: constant_velocity(1.0, float("nan")), "q is nan"),
        (lambda: constant_velocity(1.0, 1.0, order="axes"), "did you mean 'axis'"),
        (lambda: constant_velocity(1.0, 1.0, axes=("x", "x")), "different names"),
        (lambda: constant_acceleration(1.0, 1.0, axes=()), "different names"),
        (lambda: MotionModel(np.eye(3), np.eye(2), ("a", "b")), r"F has shape \(3, 3\), expected \(2, 2\)"),
        (lambda: MotionModel(np.eye(2), np.diag([1.0, -1.0]), ("a", "b")), "positive semidefinite"),
        (lambda: MotionModel(np.eye(2), np.array([[1.0, 2.0], [2.0, 1.0]]), ("a", "b")), "positive semidefinite"),
        (lambda: MotionModel(np.eye(2), np.array([[1.0, 0.2], [0.0, 1.0]]), ("a", "b")), "symmetric"),
        (lambda: MotionModel(np.eye(2), np.full((2, 2), np.nan), ("a", "b")), "finite"),
        (lambda: constant_velocity(1.0, 1.0).scaled(np.array([1.0, -1.0])), r"Q\[1\] has the eigenvalue"),
        (lambda: constant_velocity(1.0, 1.0).scaled(np.ones(3)).noise_factor, r"Q has shape \(3, 2, 2\), exp"),
        (lambda: random_path(constant_velocity(1.0, 1.0), [1.0, 2.0, 3.0], np.zeros((5, 2))), "shapes"),
        (lambda: random_path(constant_velocity(1.0, 1.0), [1.0, 2.0], np.zeros((5, 3))), "shapes"),
        (lambda: random_path(constant_velocity(1.0, 1.0), np.zeros((3, 2)), np.zeros((2, 5, 2))), "leading axes"),
        (lambda: random_path(constant_velocity(1.0, 1.0), [1.0, 2.0], np.random.default_rng(0)), "steps is 0"),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(InputError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)


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
    both = nearly_constant_acceleration(T, 0.3, 0.25).Q[np.ix_(order, order)]
    block[4:] = 0.0
    np.testing.assert_allclose(both, Q + block @ np.diag([0.0625, 0.0625]) @ block.T)
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
