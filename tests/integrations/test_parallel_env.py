"""PettingZoo's parallel environments: its own tests, and every value against the single environment.

The batch of parallel environments equals as many of them, bit for bit.
"""

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
from wavegym.integrations.pettingzoo import BatchedParallelEnv, parallel_env

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


COUNT = 3
STEPS = 24


def equal(got, want, name, row, what):
    """One row of an agent's values against those of one parallel environment, in every bit."""
    np.testing.assert_array_equal(got[name][row], want[name], err_msg=f"{what} of {name} in environment {row}")
    assert got[name].dtype == np.asarray(want[name]).dtype


def info_equal(info, want, row):
    """One row of a batch's info: the same keys, the same values; the keys of others are masked."""
    shown = {key for key in info if key[0] != "_" and not key.startswith("final") and info[f"_{key}"][row]}
    assert shown == set(want)
    for key in shown:
        np.testing.assert_array_equal(info[key][row], want[key], err_msg=key)


class Pair:
    """A batch and as many parallel environments, which must show the same."""

    def __init__(self, id, sees, mode, settings):
        self.mode = mode
        self.batch = BatchedParallelEnv(id, COUNT, sees=sees, autoreset_mode=mode, **settings)
        self.ones = [parallel_env(id, sees=sees, **settings) for _ in range(COUNT)]
        self.names = self.batch.possible_agents

    def compare(self, observations, infos, row, one):
        """Observations and infos of one environment against those of ``one``, a pair of them."""
        np.testing.assert_array_equal(self.batch.state()[row], self.ones[row].state())
        for name in self.names:
            equal(observations, one[0], name, row, "observation")
            info_equal(infos[name], one[1][name], row)

    def reset(self, rows, seeds):
        """Begin new episodes in some environments."""
        mask = {} if all(rows) else {"options": {"reset_mask": np.array(rows)}}
        observations, infos = self.batch.reset(seed=seeds, **mask)
        for i in np.flatnonzero(rows):
            self.compare(observations, infos, i, self.ones[i].reset(seed=seeds[i]))

    def step(self, rng):
        """One random step; an ended environment begins anew as the mode says."""
        actions = {name: sampled(self.batch.action_spaces[name], rng) for name in self.names}
        over = [not env.agents for env in self.ones]
        if self.mode == "Disabled" and any(over):
            self.reset(over, [None] * COUNT)
            return
        observations, *results, infos = self.batch.step(actions)
        for i, env in enumerate(self.ones):
            if over[i]:  # NextStep: this step is the reset
                assert not any(each[name][i] for each in results for name in self.names)
                self.compare(observations, infos, i, env.reset())
                continue
            one = env.step({name: actions[name][i] for name in self.names})
            for name in self.names:
                for got, want in zip(results, one[1:4], strict=True):
                    np.testing.assert_array_equal(got[name][i], want[name])
            self.after(observations, infos, i, one)

    def after(self, observations, infos, row, one):
        """What a step shows: in SameStep mode the end of an episode and the beginning of the next."""
        if self.ones[row].agents or self.mode != "SameStep":
            self.compare(observations, infos, row, (one[0], one[4]))
            return
        for name in self.names:
            np.testing.assert_array_equal(infos[name]["final_obs"][row], one[0][name])
            info_equal(infos[name]["final_info"], one[4][name], row)
        self.compare(observations, infos, row, self.ones[row].reset())


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
@pytest.mark.parametrize("sees", ["own", "all"])
@pytest.mark.parametrize(("id", "settings"), [*MADE, (TwoSensors(action="joint"), {}), (TwoSensors(), {})])
def test_a_batch_equals_as_many_parallel_environments(id, settings, sees, mode):
    """Random actions over several episodes, which end at different steps after a partial reset."""
    pair, rng = Pair(id, sees, mode, {"max_episode_steps": 9, **settings}), np.random.default_rng(0)
    pair.reset([True] * COUNT, [5, 6, 7])
    for _ in range(4):
        pair.step(rng)
    pair.reset([False, True, False], [None, 11, None])
    for _ in range(STEPS):
        pair.step(rng)


def sampled(space, rng):
    """Actions (env, ...) of one agent."""
    if space.shape:
        return rng.uniform(-1.0, 1.0, (COUNT, *space.shape)).astype(np.float32)
    return rng.integers(space.n, size=COUNT)


@pytest.mark.parametrize("form", ["library", "joint"])
def test_actions_of_a_restarting_environment_may_be_anything(form):
    batch = BatchedParallelEnv(TwoSensors(action=form), 2, max_episode_steps=1)
    batch.reset(seed=0)
    batch.step({"sensor_1": np.array([0, 1]), "sensor_2": np.array([1, 0])})
    _, rewards, *_ = batch.step({"sensor_1": np.array([-9, 99]), "sensor_2": np.array([99, -9])})
    assert not rewards["sensor_1"].any()
    with pytest.raises(InputError, match=r"action of sensor_1 is 99"):
        batch.step({"sensor_1": np.array([0, 99]), "sensor_2": np.array([1, 0])})
    batch.step({"sensor_1": np.array([0, 1]), "sensor_2": np.array([1, 0])})
    batch.reset(seed=1, options={"reset_mask": np.array([True, False])})  # the second one still begins anew
    with pytest.raises(InputError, match=r"action of sensor_2 is -9"):
        batch.step({"sensor_1": np.array([0, 99]), "sensor_2": np.array([-9, 99])})
    batch.step({"sensor_1": np.array([0, 99]), "sensor_2": np.array([1, 99])})


def test_mistakes_are_named():
    with pytest.raises(InputError, match="autoreset_mode is 'Same', expected"):
        BatchedParallelEnv("AgileClutter-v0", 2, autoreset_mode="Same")
    with pytest.raises(InputError, match="SectorSetup has one decision maker"):
        BatchedParallelEnv("SectorSetup-v0", 2)
    with pytest.raises(InputError, match="no state yet, expected reset"):
        BatchedParallelEnv(TwoSensors(), 2).state()
    batch = BatchedParallelEnv(TwoSensors(), 2)
    batch.reset(seed=0)
    with pytest.raises(InputError, match=r"action of sensor_1 has the shape \(3,\), expected \(2,\)"):
        batch.step({"sensor_1": np.zeros(3, int), "sensor_2": np.zeros(2, int)})


def test_rewards_of_an_agent_are_its_own_array():
    batch = BatchedParallelEnv(TwoSensors(), 2)
    batch.reset(seed=0)
    _, rewards, *_ = batch.step(dict.fromkeys(batch.possible_agents, np.zeros(2, int)))
    rewards["sensor_1"][:] = 0.0
    assert (rewards["sensor_2"] < 0.0).all()
