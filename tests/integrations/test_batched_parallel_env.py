"""The batch of parallel environments equals as many of them, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from test_parallel_env import MADE
from two_sensors import TwoSensors

from wavegym.core.errors import InputError
from wavegym.integrations.pettingzoo import BatchedParallelEnv, parallel_env

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
