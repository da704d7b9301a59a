"""Two radars on one account of energy: predictions against single steps and their means."""

from __future__ import annotations

import agile_clutter_oracle as plain
import numpy as np
import oracles
import pytest
from energy_episodes import BOTH, at_random, beliefs, clear, states

from wavegym.core import shortcuts, trees
from wavegym.core.horizon_weights import horizon_weights
from wavegym.core.system import State
from wavegym.systems.energy_budget.system import EnergyBudget

FAR_OFF = 1e6  # an error, in standard deviations, that lies in no gate


@pytest.mark.parametrize("kind", BOTH)
def test_prediction_carries_the_account_as_the_world_does(kind):
    system = kind(budget=0.05)
    worlds, choose = oracles.worlds(system, 20, 4), at_random(system, 4)
    state = system.initial(worlds)
    for _ in range(20):
        action = choose(state.belief)
        several = system.predict(state.belief, system.candidates()[None])
        ahead = system.transition(state, action, worlds)
        np.testing.assert_array_equal(system.predict(state.belief, action).energy, ahead.belief.energy)
        np.testing.assert_array_equal(several.energy[np.arange(20), action], ahead.belief.energy)
        state = ahead
    assert system.state_info(state)["replaced"].any()


def centred(system, state, worlds, sensor, action):
    """The tape with clear slots in which ``sensor`` has a return at its prediction, the others none in a gate."""
    step, (x, P) = int(state.belief.step[0]), (state.belief.mean, state.belief.covariance)
    C = system.action_set.sensor_covariances[system.actions.indices[action, sensor]]
    error = np.full_like(worlds.error, FAR_OFF)
    for e in range(len(x)):
        mean, covariance = plain.predicted(system, step + 1, x[e], P[e])
        site = np.array(system.sensors[sensor])
        predicted = plain.unscented(mean[0], covariance[0], site)[0]
        true = plain.measure(state.truth.path[e, 0, step + 1], site)
        N = C / plain.snr(system, true[0])
        error[e, step, sensor, 0] = np.linalg.solve(np.linalg.cholesky(N), predicted - true)
    return worlds._replace(error=error, occlusion=0.0 * worlds.occlusion)


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("sensor", [0, 1])
def test_a_given_outcome_is_predicted_as_the_world_updates_it(kind, sensor):
    """Without false returns, of a detection where it is predicted."""
    certain = {"snr_law": "printed", "truth": {"false_alarm": 1 - 1e-9}}  # the world detects every echo
    system = kind(clutter_density=0.0, gate=6.0, reference_range=100e3, **certain, **clear(kind))
    count = 3
    worlds = oracles.worlds(system, count, 6)
    state = system.initial(worlds)
    for action in (5, 10, 15, 13, 7):
        tape = centred(system, state, worlds, sensor, action)
        ahead = system.transition(state, np.full(count, action), tape)
        assert (system.state_info(ahead)["detections"] == np.count_nonzero(system.actions.indices[action])).all()
        outcome = np.ones((count, *system.outcome_shape))
        outcome[:, sensor] = 0.0
        if kind is EnergyBudget:
            outcome[:, -1] = 0.0
        given = system.predict(state.belief, np.full(count, action), outcome)
        silent = system.predict(state.belief, np.full(count, 0), outcome)
        assert oracles.covariance_distance(given.covariance, ahead.belief.covariance) < 1e-12
        for name in set(given._fields) - {"mean", "covariance", "hypotheses"}:
            np.testing.assert_array_equal(getattr(given, name), getattr(ahead.belief, name))
        missed = system.predict(state.belief, np.full(count, action), np.ones_like(outcome))
        lost = system.transition(state, np.full(count, action), blind(kind, tape))
        np.testing.assert_allclose(missed.covariance, silent.covariance, rtol=1e-12)
        np.testing.assert_allclose(lost.belief.covariance, silent.covariance, rtol=1e-12)
        state = ahead


def blind(kind, tape):
    """The tape without returns in a gate, every drawn slot occluded."""
    return tape._replace(error=np.full_like(tape.error, FAR_OFF), occlusion=np.ones_like(tape.occlusion))


def repeated(system, count, seed=0):
    """One belief after a few steps, ``count`` truths drawn from it, and tapes."""
    worlds = oracles.worlds(system, 1, seed)
    before = states(system, worlds, lambda p: np.full(1, 10 if p.step[0] % 3 == 0 else 0))[12]
    belief = trees.take(before.belief, np.zeros(count, np.int64))
    worlds = oracles.worlds(system, count, seed + 1)
    truth = system.initial(worlds).truth
    mean, covariance = plain.predicted(system, 13, belief.mean[0], belief.covariance[0])
    path = truth.path.copy()
    path[:, 0, 13] = (
        mean[0] + np.random.default_rng(seed).standard_normal((count, 4)) @ np.linalg.cholesky(covariance[0]).T
    )
    return State(truth._replace(path=path), belief), worlds


@pytest.mark.slow
@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("action", [3, 15, 9])
def test_the_expected_step_is_the_mean_of_steps(kind, action):
    """Of the share of the trace that a step takes away: 3 % with one pulse, 12 % with two, and Monte Carlo.

    Two pulses are predicted one after the other, each with the mean of the other's outcomes, as if they were occluded
    one by one.
    """
    count = 20_000
    system = kind(**clear(kind))
    state, worlds = repeated(system, count)
    ahead = system.transition(state, np.full(count, action), worlds).belief
    one = trees.take(state.belief, np.arange(1))
    predicted, silent = (system.cost(system.predict(one, np.array([a])))[0] for a in (action, 0))
    costs = system.cost(ahead)
    tolerance = (0.12 if action > 3 else 0.03) * (silent - predicted)
    assert abs(costs.mean() - predicted) < tolerance + 4 * costs.std() / np.sqrt(count)
    assert silent - predicted > 15 * costs.std() / np.sqrt(count)
    if kind is EnergyBudget:
        sight = 1.0 - system.predict(one, np.array([action])).occluded[0]
        assert abs((1.0 - ahead.occluded).mean() - sight) < 5 * np.sqrt(sight * (1 - sight) / count)


@pytest.mark.slow
@pytest.mark.parametrize("kind", BOTH)
def test_sampled_outcomes_are_as_likely_as_the_worlds(kind):
    """Mean cost over drawn outcomes against that of steps: 3 % of what the step takes away, and Monte Carlo."""
    count, action = 20_000, 15
    system = kind(**clear(kind))
    state, worlds = repeated(system, count)
    costs = system.cost(system.transition(state, np.full(count, action), worlds).belief)
    draws = np.random.default_rng(8).random((count, *system.outcome_shape))
    given = system.cost(system.predict(state.belief, np.full(count, action), draws))
    silent = system.cost(system.predict(trees.take(state.belief, np.arange(1)), np.array([0])))[0]
    error = 4 * np.hypot(costs.std(), given.std()) / np.sqrt(count)
    assert abs(costs.mean() - given.mean()) < 0.03 * (silent - given.mean()) + error


@pytest.mark.parametrize("kind", BOTH)
def test_gain_is_what_a_pulse_takes_off_the_summed_cost(kind):
    """Against ``predict``: silence for a while, then each candidate; the steps beyond the end count nothing."""
    system = kind(budget=0.27)
    for belief in beliefs(system, steps=(0, 5, 30, 69)):
        for wait, ahead in ((0, 1), (0, 7), (4, 5), (1, 90)):
            later = belief
            for _ in range(wait):
                if not system.terminal(later).all():
                    later = system.predict(later, np.zeros(4, np.int64))
            got = shortcuts.gain(system, belief, wait, ahead)
            if belief.step[0] + wait >= system.horizon:
                assert (got == 0.0).all()
                continue
            P = system.predict(later, system.candidates()[None]).covariance[:, :, 0]
            M = horizon_weights(system.motion.F, system.weights, min(ahead, system.horizon - later.step[0]))
            wanted = np.trace(M @ (P[:, :1] - P), axis1=2, axis2=3)
            np.testing.assert_allclose(got, wanted, rtol=1e-8, atol=1e-8 * np.trace(M @ P[0, 0]))
            mixed = shortcuts.gain(system, belief, np.where(np.arange(16) % 3, wait, 2)[None].repeat(4, axis=0), ahead)
            np.testing.assert_array_equal(mixed[:, 1], got[:, 1])
    assert (shortcuts.delay(system, belief) == 0).all()
    assert (shortcuts.delay(system, belief) == 0).all()
