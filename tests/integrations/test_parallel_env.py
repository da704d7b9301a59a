"""PettingZoo's parallel environments: its own tests, and every value against the single environment."""

from __future__ import annotations

import warnings
from itertools import product

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test
from pettingzoo.utils import parallel_to_aec
from two_sensors import Coupled, TwoSensors

from wavegym.core.action_sets import Parameter, ParameterBox
from wavegym.core.errors import InputError
from wavegym.core.parameters import system_parameters
from wavegym.integrations.pettingzoo import parallel_env

TRANSMITTERS = ((2085.0, 1470.5), (2080.0, 1478.0))
MADE = [
    ("AgileClutter-v0", {}),
    ("AgileClutter-v0", {"action": "joint"}),
    ("AgileClutter-v0", {"action": "box"}),
    ("RfEo-v0", {"horizon": 12}),
    ("RfEoFar-v0", {}),
    ("RfEoFar-v0", {"action": "library"}),
    ("BeamAllocation-v0", {}),
    ("EnergyBudget-v0", {}),
    ("EnergyBudgetKnown-v0", {}),
    pytest.param("Urban-v0", {"transmitters": TRANSMITTERS, "horizon": 6}, marks=pytest.mark.slow),
]
FORMS = ("library", "joint", "box")


@pytest.mark.parametrize("sees", ["own", "all"])
@pytest.mark.parametrize(("id", "settings"), MADE)
def test_pettingzoos_own_tests_pass(id, settings, sees):
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # PettingZoo warns where it means an error
        parallel_api_test(parallel_env(id, sees=sees, **settings))
        parallel_seed_test(lambda: parallel_env(id, sees=sees, **settings))
        api_test(parallel_to_aec(parallel_env(id, sees=sees, **settings)))


@pytest.mark.parametrize("form", FORMS)
def test_a_system_of_anybodys_passes_them_too(form):
    parallel_api_test(parallel_env(TwoSensors(action=form)))
    parallel_seed_test(lambda: parallel_env(TwoSensors, action=form))


def single_action(space, parts):
    """The single environment's action of the agents' actions, by the definition of each form of the action set."""
    if isinstance(space, spaces.Discrete):
        each = range(round(space.n ** (1 / len(parts))))
        return list(product(each, repeat=len(parts))).index(tuple(map(int, parts)))
    return np.concatenate(parts) if isinstance(space, spaces.Box) else np.array(parts)


@pytest.mark.parametrize("sees", ["own", "all"])
@pytest.mark.parametrize(("id", "settings"), MADE)
def test_every_value_is_the_single_environments(id, settings, sees):
    env, single = parallel_env(id, sees=sees, **settings), gym.make(f"wavegym/{id}", **settings)
    fields = [field.name for field in env.system.observation_fields]
    seen = {name: [fields.index(field.name) for field in env.views.fields[name]] for name in env.possible_agents}
    (observations, infos), (whole, info) = env.reset(seed=3), single.reset(seed=3)
    for name, space in env.action_spaces.items():
        space.seed(len(name))
    while env.agents:
        for name in env.possible_agents:
            np.testing.assert_array_equal(observations[name], whole[seen[name]])
            np.testing.assert_equal(infos[name], info)
        np.testing.assert_array_equal(env.state(), whole)
        actions = {name: env.action_space(name).sample() for name in env.agents}
        parts = [actions[name] for name in env.possible_agents]
        observations, rewards, terminations, truncations, infos = env.step(actions)
        whole, reward, terminated, truncated, info = single.step(single_action(single.action_space, parts))
        assert set(rewards.values()) == {reward}
        assert set(terminations.values()) == {terminated}
        assert set(truncations.values()) == {truncated}
    assert terminated or truncated
    np.testing.assert_equal(infos[name], info)


def test_own_leaves_out_the_other_sensors_fields_alone():
    views = parallel_env("AgileClutter-v0", sees="own").views
    names = {agent: {field.name for field in fields} for agent, fields in views.fields.items()}
    both = {field.name for field in views.system.observation_fields}
    assert both - names["sensor_1"] == {name for name in both if name.endswith(("_1_2", "_2_2"))}
    assert both - names["sensor_2"] == {name for name in both if name.endswith(("_1_1", "_2_1"))}
    shared = parallel_env(TwoSensors()).views
    assert shared.fields["sensor_1"] == shared.fields["sensor_2"] == shared.system.observation_fields


def test_returned_values_belong_to_the_agent():
    env, other = (parallel_env("AgileClutter-v0", sees="all", measurements=True) for _ in range(2))
    actions = dict.fromkeys(env.possible_agents, 0)
    for each in (env, other):
        each.reset(seed=0)
    observations, *_, infos = env.step(actions)
    observations["sensor_1"][:], env.state()[:] = 7.0, 7.0
    infos["sensor_1"]["measured_z"][:], infos["sensor_1"]["cost"] = 7.0, 7.0
    wanted, *_, want = other.step(actions)
    np.testing.assert_array_equal(observations["sensor_2"], wanted["sensor_2"])
    np.testing.assert_equal(infos["sensor_2"], want["sensor_2"])
    np.testing.assert_equal(env.step(actions)[0], other.step(actions)[0])


def test_settings_of_the_environment_work():
    env = parallel_env("wavegym/AgileClutter-v0", max_episode_steps=2, render_mode="rgb_array", reward="log-cost")
    env.reset(seed=0)
    assert env.render().ndim == 3
    for cut in (False, True):
        _, rewards, terminations, truncations, infos = env.step(dict.fromkeys(env.agents, 5))
        assert truncations == dict.fromkeys(env.possible_agents, cut)
        assert not any(terminations.values())
        assert rewards["sensor_1"] == pytest.approx(-np.log(infos["sensor_2"]["cost"]))
    assert env.agents == []
    assert str(env) == "wavegym/AgileClutter-v0"
    env.close()


@system_parameters
class Alone(TwoSensors):
    """Two sensors that one box parameter moves together."""

    @property
    def actions(self):
        return ParameterBox((Parameter("duration", "s", 1e-7, 1e-6),))


MISTAKES = [
    (
        lambda: parallel_env("KershawEvans-v0"),
        "KershawEvans has one decision maker, expected several, .*nearest: gym.make",
    ),
    (lambda: parallel_env("Urban-v0"), "Urban has one decision maker"),
    (lambda: parallel_env(Alone()), "Alone has one decision maker"),
    (lambda: parallel_env(Coupled()), "Coupled forbids joint actions by a mask, expected no mask, or strict = False"),
    (lambda: parallel_env("AgileClutter-v0", sees="owm"), "sees is 'owm', expected .* 'own'"),
    (lambda: parallel_env("AgileCluter-v0"), "did you mean .wavegym/AgileClutter-v0"),
    (lambda: parallel_env("AgileClutter-v0", durationz=1), "did you mean .durations"),
    (lambda: parallel_env("EnergyBudget-v0", forecasts=True), "forecasts is True, expected False"),
    (lambda: parallel_env("AgileClutter-v0").step({}), "no episode is running, expected reset"),
    (lambda: parallel_env("AgileClutter-v0").state(), "no state yet, expected reset"),
]


@pytest.mark.parametrize(("mistake", "message"), MISTAKES)
def test_a_mistake_is_named(mistake, message):
    with pytest.raises(InputError, match=message):
        mistake()


WRONG = [
    ("library", [0, 0], r"actions are \[0, 0\], expected a dictionary"),
    ("library", {"sensor_1": 0}, r"actions are of \['sensor_1'\], expected a dictionary with one for each of"),
    ("library", {"sensor_1": 0, "sensor_2": 0, "radar": 0}, "actions are of .*'radar'"),
    ("library", {"sensor_1": 0, "sensor_2": 3}, r"action of sensor_2 is 3, expected an index in \[0, 2\] .nearest: 2"),
    ("joint", {"sensor_1": -1, "sensor_2": 0}, r"action of sensor_1 is -1, expected an index in \[0, 1\] .nearest: 0"),
    ("joint", {"sensor_1": 0.5, "sensor_2": 0}, "action of sensor_1 has the type float64, expected integers"),
    ("joint", {"sensor_1": [0], "sensor_2": 0}, r"action of sensor_1 has the shape \(1, 1\)"),
    ("box", {"sensor_1": [0.0], "sensor_2": 0.0}, r"action of sensor_2 has the shape \(1,\), expected \(1, 1\)"),
    ("box", {"sensor_1": ["a"], "sensor_2": [0.0]}, "action of sensor_1 has the type"),
    ("box", {"sensor_1": [np.nan], "sensor_2": [0.0]}, r"action is \[nan, 0.0\], expected finite numbers"),
]


@pytest.mark.parametrize(("form", "actions", "message"), WRONG)
def test_a_wrong_action_changes_nothing(form, actions, message):
    env, other = parallel_env(TwoSensors(action=form)), parallel_env(TwoSensors(action=form))
    for each in (env, other):
        each.reset(seed=0)
    with pytest.raises(InputError, match=message):
        env.step(actions)
    right = {name: np.zeros(space.shape, space.dtype) for name, space in env.action_spaces.items()}
    np.testing.assert_equal(env.step(right), other.step(right))


def test_parameters_of_a_box_may_come_in_any_order():
    """Sensors that take turns in the box: each agent's elements reach its own places."""

    @system_parameters
    class Mixed(TwoSensors):
        """Two sensors, the second one's parameter first."""

        @property
        def actions(self):
            return ParameterBox(tuple(Parameter(f"duration_{s}", "s", 1e-7, 1e-6) for s in (2, 1)))

    views = parallel_env(Mixed(action="box")).views
    point = views.joined({"sensor_1": np.array([[0.25]]), "sensor_2": np.array([[0.75]])}, 1)
    np.testing.assert_array_equal(point, [[0.75, 0.25]])
