"""Forecasts of each candidate in the observation: their values, and the systems that refuse them."""

import gymnasium as gym
import numpy as np
import pytest

from wavegym.core.errors import InputError
from wavegym.envs import WaveformVectorEnv
from wavegym.observations.forecasts import FLOOR, LOOKS, Forecasts
from wavegym.testing import check_vector_env

ALL = ["KershawEvansPosition", "CameraSlew", "SectorSetup", "BeamAllocation", "EnergyBudget", "EnergyBudgetKnown"]


def played(name: str, steps: int = 4) -> WaveformVectorEnv:
    env = gym.make_vec(f"wavegym/{name}-v0", num_envs=5, forecasts=True)
    env.reset(seed=0)
    for _ in range(steps):
        env.step(np.argmax(env.unwrapped.action_masks(), axis=1))
    return env.unwrapped


@pytest.mark.parametrize("name", ALL)
def test_they_follow_the_systems_own_fields_and_are_its_predictions(name):
    env = played(name)
    system, belief = env.system, env.belief
    shown, own = env.episodes.observe()[0], len(system.observation_fields)
    assert env.single_observation_space.shape == (shown.shape[1],) == (len(env.episodes.observer.observation_fields),)
    assert (shown[:, :own] == WaveformVectorEnv(system, 5).episodes.observer(belief)[0]).all()
    predicted = Forecasts(system)
    candidates = system.candidates()
    raw = shown[:, own:].reshape(5, len(candidates), -1).astype(np.float64)
    figures = {f.name: raw[:, :, i] * f.scale + f.centre for i, f in enumerate(predicted.candidate_fields)}
    costs = np.stack([system.cost(system.predict(belief, np.full(5, c))) for c in candidates], axis=1)
    mean = costs.mean(axis=1, keepdims=True)
    is_free = np.abs(raw) < 10.0
    expected = {"ln_cost_ahead": np.log(costs / mean)}
    if hasattr(system, "gain"):
        delay = system.delay(belief)
        expected["ln_delay"] = np.log(1.0 + delay)
        for wait, steps in LOOKS:
            gain = system.gain(belief, delay + wait, steps) / (steps * mean)
            expected[f"log10_gain_{wait}_{steps}"] = np.log10(FLOOR + gain)
    if hasattr(system, "spending"):
        expected["spending"] = np.tile(system.spending, (5, 1))
    assert figures.keys() == expected.keys()
    for i, (figure, values) in enumerate(expected.items()):
        np.testing.assert_allclose(
            figures[figure][is_free[:, :, i]], values[is_free[:, :, i]], rtol=1e-5, atol=1e-5, err_msg=figure
        )
        assert np.ptp(values) > 0.0 or figure == "ln_delay"


@pytest.mark.parametrize("name", ["KershawEvansPosition", "EnergyBudgetKnown"])
def test_the_environment_stays_a_sound_one(name):
    check_vector_env(lambda **settings: gym.make_vec(f"wavegym/{name}-v0", forecasts=True, **settings))


@pytest.mark.parametrize("name", ["AgileClutter", "RfEo"])
def test_a_system_with_too_many_candidates_has_none(name):
    with pytest.raises(InputError, match=rf"forecasts were asked for in {name}, expected one index for at most 256"):
        gym.make_vec(f"wavegym/{name}-v0", num_envs=2, forecasts=True)


def test_a_flag_is_wanted():
    with pytest.raises(InputError, match=r"forecasts is 'yes', expected True or False \(nearest: True\)"):
        gym.make_vec("wavegym/SectorSetup-v0", num_envs=2, forecasts="yes")
