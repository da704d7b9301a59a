"""Forecasts of each candidate in the observation: their values, and the systems that refuse them."""

import gymnasium as gym
import numpy as np
import pytest

from wavegym.core import shortcuts
from wavegym.core.errors import InputError
from wavegym.envs import WaveformVectorEnv
from wavegym.observations.forecasts import FLOOR, LEAST, LOOKS, POWERS, Forecasts
from wavegym.registration import full_id
from wavegym.testing import check_vector_env

ALL = ["KershawEvansPosition", "CameraSlew", "SectorSetup", "BeamAllocation", "EnergyBudget", "EnergyBudgetKnown"]


def played(name: str, steps: int = 4) -> WaveformVectorEnv:
    env = gym.make_vec(full_id(name), num_envs=5, forecasts=True)
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
    if shortcuts.gain.of(system):
        delay = shortcuts.delay(system, belief)
        expected["ln_delay"] = np.log(1.0 + delay)
        for wait, steps in LOOKS:
            gain = shortcuts.gain(system, belief, delay + wait, steps) / (steps * mean)
            expected[f"log10_gain_{wait}_{steps}"] = np.log10(FLOOR + gain)
    if shortcuts.spending.of(system):
        expected["spending"] = np.tile(shortcuts.spending(system), (5, 1))
    assert figures.keys() == expected.keys()
    for i, (figure, values) in enumerate(expected.items()):
        np.testing.assert_allclose(
            figures[figure][is_free[:, :, i]], values[is_free[:, :, i]], rtol=1e-5, atol=1e-5, err_msg=figure
        )
        assert np.ptp(values) > 0.0 or figure == "ln_delay"


def test_forecasts_of_tracks_in_slots_are_gains_per_second_and_the_state_of_the_track():
    env = gym.make_vec("wavegym/MultifunctionRadar-v1", num_envs=4, forecasts=True, slots=20).unwrapped
    env.reset(seed=0)
    for _ in range(30):
        env.step(shortcuts.gain_per_second(env.system, env.belief).argmax(axis=1))
    system, belief = env.system, env.belief
    fields, own = Forecasts(system).candidate_fields, len(system.observation_fields)
    raw = env.episodes.observe()[0][:, own:].reshape(4, len(system.actions), len(fields)).astype(np.float64)
    shown = {f.name: raw[..., i] * f.scale + f.centre for i, f in enumerate(fields)}
    for power in POWERS:
        want = np.log10(LEAST + shortcuts.gain_per_second(system, belief, 1.0, power) / system.c0)
        np.testing.assert_allclose(shown[f"log10_gain_{power:g}"], want, atol=1e-5)
    rows, updates = system.slots_now(belief), 20 * 4
    taken = (rows[..., 0] > 0).repeat(4, axis=1)
    assert 0 < taken.sum() < taken.size
    np.testing.assert_array_equal(shown["update"][:, :updates], taken)
    np.testing.assert_array_equal(shown["search"][0], np.repeat([0.0, 1.0, 0.0], [updates, 48, 1]))
    np.testing.assert_allclose(shown["ln_duration"][2], np.log(system.dwells.menu[3]), rtol=1e-5)
    pointing = rows[..., 3].repeat(4, axis=1)
    np.testing.assert_allclose(2.0 ** shown["log2_pointing"][:, :updates][taken], pointing[taken], rtol=1e-5)
    np.testing.assert_allclose(shown["age"][:, :updates], rows[..., 6].repeat(4, axis=1), atol=1e-5)
    for name, column, factor in (
        ("value", 9, 1.0),
        ("velocity", 5, 1.0),
        ("density", 7, 1.0),
        ("snr", 8, system.dwells.menu[3][:updates]),
    ):
        want = (rows[..., column].repeat(4, axis=1) * factor)[taken]
        np.testing.assert_allclose(2.0 ** shown[f"log2_{name}"][:, :updates][taken], want, rtol=1e-5)
    assert not shown["existence"][:, updates:].any()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["KershawEvansPosition", "EnergyBudgetKnown"])
def test_the_environment_stays_a_sound_one(name):
    check_vector_env(lambda **settings: gym.make_vec(full_id(name), forecasts=True, **settings))


@pytest.mark.parametrize("name", ["AgileClutter", "RfEo"])
def test_a_system_with_too_many_candidates_has_none(name):
    with pytest.raises(InputError, match=rf"forecasts were asked for in {name}, expected one index for at most 256"):
        gym.make_vec(full_id(name), num_envs=2, forecasts=True)


def test_a_flag_is_wanted():
    with pytest.raises(InputError, match=r"forecasts is 'yes', expected True or False \(nearest: True\)"):
        gym.make_vec("wavegym/SectorSetup-v0", num_envs=2, forecasts="yes")
