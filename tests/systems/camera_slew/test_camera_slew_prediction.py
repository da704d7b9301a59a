"""The camera that has to turn: one step in plain NumPy, prediction against transition, delays and gains."""

from __future__ import annotations

import math

import numpy as np
import oracles
import pytest
import rf_eo_oracle as plain
from camera_episodes import OPEN, SETTLES, azimuth, later, wrap

from wavegym.core import trees
from wavegym.core.errors import InputError
from wavegym.systems.camera_slew.system import CameraSlew


def one_step(system, mean, P, pointing, settling, q, visible, action, seen):
    """Mean, covariance and camera one step on, predicted; ``seen``: whether a target in the image is found.

    q, visible (t,): noise densities, and whose line of sight is free in this step.
    """
    F = system.motion.F
    aim = azimuth(system, mean)
    off = wrap(aim[action] - pointing)
    pointing = wrap(pointing + np.clip(off, -system.slew * system.dt, system.slew * system.dt))
    far = abs(off) > system.half_field
    sees, settling = not far and settling == 0, system.settle if far else max(settling - 1, 0)
    angle = 2 * system.half_field / system.pixels
    R = plain.plain_variances(system, (system.prf, system.bandwidth, angle))
    out = []
    for t in range(system.targets):
        x, V = F @ mean[t], F @ P[t] @ F.T + q[t] * system.motion.Q
        rows, noise = [], []
        for j in range(len(system.platforms)):
            H = plain.jacobian(system.loop, x, j)
            camera = bool(j == 0 and visible[t] and sees and seen and abs(wrap(aim[t] - pointing)) <= system.half_field)
            rows += [H[0], H[1]] + [H[2]] * camera
            noise += [R[0], R[1]] + [R[2]] * camera
        H = np.array(rows)
        K = V @ H.T @ np.linalg.inv(H @ V @ H.T + np.diag(noise))
        A = np.eye(4) - K @ H
        out.append(A @ V @ A.T + K @ np.diag(noise) @ K.T)
    return np.array([F @ m for m in mean]), np.array(out), pointing, settling


def test_one_step_is_that_of_plain_numpy():
    """Predicted means, covariances (to the precision of inverting them in doubles) and the camera."""
    system = CameraSlew(horizon=30)
    state, worlds = later(system, 6, 3)
    for _ in range(20):  # until the cameras follow a target each
        state = system.transition(state, np.arange(6) % 4, worlds)
    some = 0
    for e in range(6):
        belief = oracles.rows(state.belief, slice(e, e + 1))
        for action in range(4):
            for draw in (0.0, 1.0):
                predicted = system.predict(belief, np.array([action]), np.full((1, 4), draw))
                x, P, pointing, settling = one_step(
                    system, belief.mean[0], belief.covariance[0], belief.pointing[0], belief.settling[0],
                    belief.q[0], belief.visible[0, belief.step[0]], action, draw < system.detection
                )  # fmt: skip
                np.testing.assert_allclose(predicted.mean[0], x, rtol=1e-12, atol=1e-9)
                np.testing.assert_allclose(predicted.covariance[0], P, rtol=1e-6, atol=1e-8)
                np.testing.assert_allclose(predicted.pointing[0], pointing, atol=1e-12)
                assert (predicted.settling[0], predicted.step[0]) == (settling, belief.step[0] + 1)
            found = system.predict(belief, np.array([action]), np.zeros((1, 4)))
            some += not np.array_equal(found.covariance, predicted.covariance)
    assert some >= 6  # looks that found something, and others


def test_prediction_with_a_given_outcome_is_the_transition():
    """Compared where truth and prediction are on the same side of every edge: targets close to an edge are left out.

    The filter linearises once, at the prediction.
    """
    system = CameraSlew(
        horizon=80, iterations=1, platforms=((-1e3, 0.0), (1e3, 0.0)), bandwidth=20e6, half_field=0.05, settle=1,
        detection=0.9, q=(0.02, 0.1), shown=(10, 20)
    )  # fmt: skip
    state, worlds = later(system, 40, 0)
    rng, action, agreed, found = np.random.default_rng(2), np.zeros(40, int), 0, 0
    for k in range(80):
        action = np.where(rng.random(40) < 0.15, rng.integers(4, size=40), action)
        predicted = system.predict(state.belief, action, worlds.found[:, k])
        if k % 2:  # also among several candidates
            every = system.predict(state.belief, np.arange(4)[None], worlds.found[:, None, k])
            one = type(predicted)(*(part[np.arange(40), action] for part in every))
            trees.tree_map(np.testing.assert_array_equal, one, predicted)
        true = np.arctan2(state.truth.targets[..., 0] + 1e3, state.truth.targets[..., 2])
        state = system.transition(state, action, worlds)
        edge = np.abs(np.abs(wrap(true - predicted.pointing[:, None])) - system.half_field)
        clear = (edge > 0.02).all(axis=1)
        for name in ("covariance", "pointing", "settling", "step"):
            np.testing.assert_allclose(
                getattr(predicted, name)[clear], getattr(state.belief, name)[clear], rtol=1e-9, atol=1e-8
            )
        agreed, found = agreed + clear.sum(), found + state.truth.seen[clear].sum()
    assert agreed > 2000
    assert found > 300


def test_the_expected_outcome_is_the_mean():
    """The mean over detections, to five standard errors of 4000 draws; far from the prediction without detection."""
    system, count = CameraSlew(horizon=60, iterations=1, detection=0.6, **OPEN), 4000
    state, worlds = later(system, 1, 5)
    for _ in range(20):  # until the camera is there
        state = system.transition(state, np.array([2]), worlds)
    several = trees.take(state, np.zeros(count, int))
    tapes = trees.take(worlds, np.zeros(count, int))
    tapes.found[:] = np.random.default_rng(5).random(tapes.found.shape)
    action = np.full(count, 2)
    came = system.cost(system.transition(several, action, tapes).belief)
    expected = system.cost(system.predict(state.belief, np.array([2])))[0]
    nothing = system.cost(system.predict(state.belief, np.array([2]), np.ones((1, 4))))[0]
    error = 5 * came.std() / math.sqrt(count)
    assert error > 0
    assert abs(came.mean() - expected) < error
    assert nothing - expected > 3 * error


@pytest.mark.parametrize("settle", SETTLES)
def test_the_delay_is_how_long_it_takes(settle):
    """Targets at rest: the first step in which a look changes the covariance, found by turning the camera."""
    system = CameraSlew(
        horizon=60, q=(1e-12, 1e-12), speed=0.0, prior_variance=(1e-2, 1e-9, 1e-2, 1e-9), settle=settle, **OPEN
    )
    state, _ = later(system, 20, 3)
    for target in range(4):
        wanted, belief = system.delay(state.belief)[:, target], state.belief
        seen = np.full(20, -1)
        for k in range(40):
            action = np.full(20, target)
            one, other = (system.predict(belief, action, np.full((20, 4), draw)) for draw in (0.0, 1.0))
            now = (one.covariance[:, target] != other.covariance[:, target]).any(axis=(1, 2))
            seen = np.where((seen < 0) & now, k, seen)
            belief = other
        np.testing.assert_array_equal(seen, wanted)


def test_the_gain_at_once_is_the_difference_that_a_look_makes():
    """trace(M (P without - P with)), M summed by hand; also at the episode's end, where fewer steps are left."""
    system = CameraSlew(horizon=40, **OPEN)
    state, worlds = later(system, 8, 10)
    for _ in range(28):
        state = system.transition(state, np.zeros(8, int), worlds)
        gain = system.gain(state.belief, 0, 5)[:, 0]
        one, other = (system.predict(state.belief, np.zeros(8, int), np.full((8, 4), draw)) for draw in (0.0, 1.0))
        left, F = min(5, 40 - int(state.belief.step[0])), system.transition_matrix
        D, want = other.covariance - one.covariance, 0.0
        for _ in range(left):
            want, D = want + np.einsum("etii->e", D), F @ D @ F.T
        looks = system.delay(state.belief)[:, 0] == 0
        np.testing.assert_allclose(gain[looks], system.detection * want[looks], rtol=1e-6)
    assert looks.all()
    assert (system.gain(state.belief, 2, 5) == 0).all()
    assert (system.gain(state.belief, 1, 5) > 0).all()


def test_a_gain_needs_sight_and_a_delay_waits_for_it():
    system = CameraSlew(horizon=30, windows=((0, 0, 9), (2, 20, 29)), half_field=1.5, settle=0)
    belief = later(system, 4, 0)[0].belief
    assert (system.delay(belief)[:, 0] == 10).all()  # out of cover by step 10
    assert (system.delay(belief)[:, 1] <= 1).all()
    narrow = CameraSlew(horizon=30, windows=((0, 0, 9), (2, 20, 29)), half_field=1e-6)
    for wait, hidden in ((9, [True, False, False, False]), (10, [False] * 4), (20, [False, False, True, False])):
        np.testing.assert_array_equal(narrow.gain(belief, wait, 5) == 0, [hidden] * 4)


def test_a_gain_over_no_step_is_refused():
    state, _ = later(CameraSlew(horizon=3), 1, 0)
    with pytest.raises(InputError, match="ahead is 0, expected an integer >= 1"):
        CameraSlew(horizon=3).gain(state.belief, 0, 0)
