"""Planners on a base that reads observations: learned policies, and other people's."""

from __future__ import annotations

import numpy as np
import pytest

from wavegym.envs.sb3 import SB3VecEnv
from wavegym.evaluation import as_policy, compare, make_task, world_seeds
from wavegym.evaluation.adapters import as_policies, saved_agent
from wavegym.evaluation.play import play
from wavegym.observations.observer import Observer
from wavegym.schedulers.planners.base import Observing, SampledFutures
from wavegym.schedulers.planners.rollout import RolloutPlanner
from wavegym.schedulers.registry import make_policy

ID = "wavegym/KershawEvansPosition-v0"
FORECASTING = "wavegym/SectorSetup-v0"  # whose saved agents were shown forecasts
SEEDS = world_seeds(0, "tune", 5)


def agent(env_id):
    """The first of the agents that come with an environment."""
    return saved_agent("ppo", env_id) / "seed0"


class BaseAlone:
    """The base of a planner, played without the environment's observation."""

    def __init__(self, policy):
        self.base = SampledFutures(policy, 1, 1).base

    def begin(self, system, num_envs, rng):
        self.base.begin(system, num_envs, rng)

    def act(self, belief, observation, mask):
        return self.base.choose(belief, mask, self.base.prepare(belief))


def same(one, other):
    for a, b in zip(one[:-1], other[:-1], strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("env_id", [ID, FORECASTING, "wavegym/RfEo-v0", "wavegym/AgileClutter-v0"])
def test_the_base_alone_plays_as_the_agent_does_bit_for_bit(env_id):
    task = make_task(env_id, {})
    (learned,) = as_policies(agent(env_id), task, "ppo")
    if env_id == FORECASTING:
        assert learned.forecasts
    alone, played = play(task, BaseAlone(learned), SEEDS, 8), play(task, learned, SEEDS, 8)
    assert np.isnan(alone.outside).all(), "a planner has no training"
    same(alone._replace(outside=played.outside), played)


@pytest.mark.parametrize("name", ["rollout:2@ppo", "tree:2@ppo", "receding-horizon@ppo", "plan-once@ppo"])
@pytest.mark.slow
def test_a_planner_follows_a_saved_agent(name):
    comparison = compare(ID, {name: None, "ppo": None}, worlds=3, jobs=1, horizon=4)
    planned, learned = comparison.cost(name), comparison.cost("ppo")
    assert planned.shape == learned.shape  # one planner for each training run
    assert planned.mean() < 1.02 * learned.mean()


def test_a_folder_is_a_base_too():
    task = make_task(ID, {"horizon": 4})
    named = as_policies(f"rollout:2@{agent(ID)}", task, "planner")
    given = make_policy("rollout:2", task.system, None, base=as_policy(agent(ID), task))
    same(play(task, named[0], SEEDS), play(task, given, SEEDS))


def test_a_function_is_a_base_too():
    task, shown = make_task(ID, {"horizon": 4}), []

    def constant(observation):
        shown.append(observation)
        return np.full(len(observation), 3)

    play(task, RolloutPlanner(as_policy(constant), 2), SEEDS)
    assert max(map(len, shown)) > len(SEEDS)  # in simulated futures
    assert {each.shape[1] for each in shown} == {len(task.system.observation_fields)}


def test_observations_of_simulated_beliefs_are_those_of_the_environment():
    envs = SB3VecEnv(ID, num_envs=3, horizon=4)
    envs.seed(0)
    observation = envs.reset()
    base = Observing(as_policy(lambda o: (o[:, 0] > 0).astype(np.int64)))
    base.begin(envs.batch.system, 3, np.random.default_rng(0))
    shown, _ = Observer(envs.batch.system)(envs.batch.belief)
    np.testing.assert_array_equal(shown, observation)
    np.testing.assert_array_equal(base.choose(envs.batch.belief, None, None), (observation[:, 0] > 0))
