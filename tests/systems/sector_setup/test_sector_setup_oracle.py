"""The sector-setup loop against plain NumPy, and its prediction against the loop."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import oracles
import pytest
import sector_setup_oracle as plain

from wavegym.core import shortcuts
from wavegym.core.system import State
from wavegym.systems.sector_setup.system import SectorSetup

SYSTEM = SectorSetup()
THREE = SectorSetup(
    horizon=25, targets=2, receivers=((-3e3, 0.0), (2e3, 7e3), (5e3, -1e3)), dead_steps=1, fluctuation="swerling3",
    waveforms=((3, 200e-6, 12e-6, 3e6),),
    weights=(1.0, 0.0, 2.0, 5.0), windows=((0, 4, 9), (1, 0, 3)), dt=0.5,
)  # fmt: skip

TURNING = replace(SYSTEM, turn_rate=0.05)
MISTAKEN = replace(THREE, truth={
    "q": (1.0, 30.0), "turn_rate": -0.1, "prior_variance": (4e4, 100.0, 4e4, 100.0), "reference_range": 4e3,
    "false_alarm": 1e-4, "nearest_range": 1500.0, "fluctuation": "swerling1", "reference_snr": 40.0,
    "windows": ((0, 2, 5),),
})  # fmt: skip
LOOPS = pytest.mark.parametrize("system", [SYSTEM, THREE, TURNING, MISTAKEN], ids=["default", "three", "turn", "truth"])


def held(system, rng, count, stay=0.85):
    """Actions (step, env); each is kept with probability ``stay``, so that some set-ups finish."""
    actions = rng.integers(len(system.actions), size=(system.horizon, count))
    for k in range(1, system.horizon):
        actions[k] = np.where(rng.random(count) < stay, actions[k - 1], actions[k])
    return actions


def somewhere(system, count, seed=0, steps=20):
    """A state in the middle of an episode, its worlds, and the generator."""
    rng = np.random.default_rng(seed)
    worlds = oracles.worlds(system, count, seed)
    state = system.initial(worlds)
    for action in held(system, rng, count)[:steps]:
        state = system.transition(state, action, worlds)
    return state, worlds, rng


def ready(system, belief, target, seen=True):
    """The belief with ``target`` (env,) set up, visible or hidden."""
    visible = np.full_like(belief.visible, seen)
    return belief._replace(pointed=target, dead=np.zeros_like(belief.dead), visible=visible)


@LOOPS
@pytest.mark.slow
def test_whole_episodes(system):
    """Means to 5e-4 of a standard deviation, covariances to 5e-4: the effective SNR is interpolated, to 1e-4."""
    rng, worlds = np.random.default_rng(1), oracles.worlds(system, 4)
    states, detections = [system.initial(worlds)], 0
    for k, action in enumerate(held(system, rng, 4)):
        before, state = states[-1], system.transition(states[-1], action, worlds)
        for e in range(4):
            own = oracles.rows(worlds, e)
            want = plain.step(system, own, k, action[e], oracles.rows(before.truth, e), oracles.rows(before.belief, e))
            after, truth = oracles.rows(state.belief, e), oracles.rows(state.truth, e)
            assert (after.step, after.pointed, after.dead) == (k + 1, want.pointed, want.dead)
            assert truth.detections == want.detections
            np.testing.assert_allclose(truth.targets, want.truth, rtol=1e-12, atol=1e-9)
            sigma = np.sqrt(np.diagonal(want.covariance, axis1=1, axis2=2))
            assert np.abs((after.mean - want.mean) / sigma).max() < 5e-4
            assert oracles.covariance_distance(after.covariance, want.covariance) < 5e-4
            detections += want.detections
        states.append(state)
    assert detections > 20


def test_measurements_are_those_of_the_truth():
    """Half paths and their rates at the world's SNR; 0 where nothing is detected or no pulse was sent."""
    state, worlds, rng = somewhere(MISTAKEN, 40, steps=3)
    action = np.where(rng.random(40) < 0.7, state.belief.pointed, 1 - state.belief.pointed)
    truth = MISTAKEN.move(state.truth, state.belief.step, worlds)
    got = MISTAKEN.measure(truth, state.belief, action, worlds)
    real, rows = MISTAKEN.truth_model, np.arange(40)
    shown = truth.visible[rows, 3, action] & ~got.silent
    for e, t in enumerate(action):
        world, x = oracles.rows(worlds, e), truth.targets[e, t]
        eta, C, mean_rate = plain.look(real, x, 0, truth.q[e, t])
        for j in range(3):
            snr = plain.received(real, eta[j], world, 3, t, j) if shown[e] else 0.0
            assert got.detected[e, j] == (snr > 0)
            want = np.zeros(2)
            if snr > 0:
                spread = C / snr + np.diag([0.0, mean_rate[j]])
                want = plain.measure(real, x)[0][j] + np.linalg.cholesky(spread) @ worlds.error[e, 3, j, t]
            np.testing.assert_allclose(got.z[e, j], want, rtol=1e-9)
    assert (got.silent.sum(), got.detected.sum()) > (5, 5)
    noted = MISTAKEN.annotate(truth, got)
    np.testing.assert_array_equal(noted.detections, got.detected.sum(axis=1))
    np.testing.assert_array_equal(noted.silent, got.silent)


@pytest.mark.parametrize("turn_rate", [0.0, 0.05])
def test_belief_coasts_as_the_motion_model_says(turn_rate):
    """Seven steps against F P F' + Q."""
    system = replace(SYSTEM, turn_rate=turn_rate)
    state, _, rng = somewhere(system, 5)
    belief = ready(system, state.belief, rng.integers(4, size=5), seen=False)
    here = belief
    for _ in range(7):
        here = system.predict(here, 2 * here.pointed)
    for e, t in product(range(5), range(4)):
        mean, P = belief.mean[e, t], belief.covariance[e, t]
        for _ in range(7):
            mean, P = oracles.predict(mean, P, *plain.model(system, belief.q[e, t]))
        np.testing.assert_allclose(here.mean[e, t], mean, rtol=1e-11)
        assert oracles.covariance_distance(here.covariance[e, t], P) < 1e-12


@pytest.mark.parametrize("system", [SYSTEM, THREE], ids=["default", "three receivers"])
def test_predicted_outcomes_are_what_happens(system):
    """Draws of 0 and 1 select in prediction the receivers that detect in the world, at every step.

    With a plain extended Kalman filter, whose covariance does not depend on what is measured.
    """
    system = replace(system, iterations=1)
    rng, worlds = np.random.default_rng(2), oracles.worlds(system, 30)
    state, updates = system.initial(worlds), 0
    for action in held(system, rng, 30):
        truth = system.move(state.truth, state.belief.step, worlds)
        found = system.measure(truth, state.belief, action, worlds).detected
        after = system.transition(state, action, worlds)
        predicted, after_belief = system.predict(state.belief, action, 1.0 - found), after.belief
        assert oracles.covariance_distance(predicted.covariance, after_belief.covariance) < 1e-12
        for name in ("step", "pointed", "dead", "q", "visible"):
            np.testing.assert_array_equal(getattr(predicted, name), getattr(after_belief, name))
        state = after
        updates += state.truth.detections.sum()
    assert updates > 100


def test_expected_outcome_is_the_mean_over_all_outcomes():
    state, _, rng = somewhere(THREE, 20, steps=12)
    target = rng.integers(2, size=20)
    belief = ready(THREE, state.belief, target)
    F, _ = plain.model(THREE, 1.0)
    pd = np.array([plain.noise(THREE, F @ belief.mean[e, t], 0, belief.q[e, t])[1] for e, t in enumerate(target)])
    want = 0.0
    for detected in product((0, 1), repeat=3):
        weight = np.where(detected, pd, 1 - pd).prod(axis=1)[:, None, None, None]
        outcome = np.tile(1.0 - np.array(detected), (20, 1))
        want = want + weight * THREE.predict(belief, target, outcome).covariance
    assert oracles.covariance_distance(THREE.predict(belief, target).covariance, want) < 1e-4  # Pd is interpolated


def test_expected_outcome_is_the_mean_of_what_happens():
    """10^4 drawn steps: within 5 standard errors with the truth at its prediction, else within 3 % of the change."""
    state, _, rng = somewhere(SYSTEM, 1, seed=3)
    count, action = 10_000, np.full(10_000, 2)
    truth = type(state.truth)(*(np.repeat(a, count, axis=0) for a in state.truth))
    truth = truth._replace(visible=np.ones_like(truth.visible))
    many = oracles.rows(ready(SYSTEM, state.belief, np.ones(1, int)), np.zeros(count, int))
    many = many._replace(step=np.zeros(count, np.int64))
    worlds = oracles.worlds(SectorSetup(horizon=1), count)
    predicted = SYSTEM.predict(oracles.rows(many, slice(1)), action[:1]).covariance[0, 1]
    before = plain.model(SYSTEM, many.q[0, 1])[0] @ many.covariance[0, 1] @ plain.model(SYSTEM, 1.0)[0].T
    for spread in (0.0, 1.0):
        noise = rng.standard_normal(many.mean.shape) @ np.linalg.cholesky(many.covariance[0, 1]).T
        true_states = many.mean + spread * noise
        quiet = worlds._replace(process=spread * worlds.process)
        after = SYSTEM.transition(State(truth._replace(targets=true_states), many), action, quiet)
        looks = after.belief.covariance[:, 1]
        if spread == 0.0:
            error = looks.std(axis=0) / np.sqrt(count)
            assert (np.abs(looks.mean(axis=0) - predicted) <= 5 * error + 1e-9).all()
            assert (error > 0).all()  # not all of them detect
        assert abs(np.trace(looks.mean(axis=0) - predicted)) < 0.03 * np.trace(before - predicted)


@pytest.mark.parametrize("system", [SYSTEM, TURNING], ids=["straight", "turn"])
@pytest.mark.parametrize(("wait", "ahead"), [(0, 1), (0, 14), (3, 5), (9, 14), (12, 30)])
def test_gain_is_what_a_look_takes_off_the_costs_to_come(system, wait, ahead):
    """Against the costs of beliefs without further measurements, with and without the look."""
    state, _, _ = somewhere(system, 12, steps=35)
    belief = state.belief
    dark = belief._replace(visible=np.zeros_like(belief.visible))
    for _ in range(wait):
        dark = system.predict(dark, np.zeros(12, np.int64))
    gain = shortcuts.gain(system, belief, wait, ahead)
    for c in system.candidates():
        seen = dark._replace(visible=belief.visible, pointed=np.full(12, c // 2), dead=np.zeros(12, np.int64))
        here, there = system.predict(dark, np.full(12, c)), system.predict(seen, np.full(12, c))
        there = there._replace(visible=dark.visible)
        total = np.zeros(12)
        for _ in range(min(ahead, system.horizon - 35 - wait)):
            total += system.cost(here) - system.cost(there)
            here, there = (system.predict(b, np.zeros(12, np.int64)) for b in (here, there))
        np.testing.assert_allclose(gain[:, c], total, rtol=1e-9, atol=1e-6)
        np.testing.assert_array_equal(gain[:, c] > 0, belief.visible[:, 35 + wait, c // 2])


def test_delay_is_how_long_it_takes():
    state, worlds, _ = somewhere(SYSTEM, 40, steps=11)
    delay = shortcuts.delay(SYSTEM, state.belief)
    assert set(delay.ravel()) == {0, 1, 2, 3}
    for c in SYSTEM.candidates():
        here, silent = state, np.zeros(40, int)
        for _ in range(5):
            here = SYSTEM.transition(here, np.full(40, c), worlds)
            silent += here.truth.silent
        np.testing.assert_array_equal(silent, delay[:, c])
