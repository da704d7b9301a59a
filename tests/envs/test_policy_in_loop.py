"""``env.unwrapped.policy(name)`` plays a scheduler in a loop of the user's own, as evaluation plays it."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import wavegym
from wavegym.core.errors import InputError
from wavegym.core.worlds import draw_worlds, tuning_tapes
from wavegym.envs.sb3 import SB3VecEnv
from wavegym.schedulers import rollout
from wavegym.schedulers.registry import make_policy

POSITION, CAMERA = "wavegym/KershawEvansPosition-v0", "wavegym/CameraSlew-v0"
ENERGY = "wavegym/EnergyBudgetKnown-v0"
CASES = [
    (POSITION, "myopic"),
    (POSITION, "lookahead:2"),
    (POSITION, "best-fixed"),  # tuned
    (POSITION, "optimum"),  # clairvoyant
    pytest.param(CAMERA, "cost-of-delay", marks=pytest.mark.slow),  # tuned
    (CAMERA, "round-robin"),
    (ENERGY, "round-robin"),  # masked
]
FEW = {POSITION: {"horizon": 6}, CAMERA: {"horizon": 8}, ENERGY: {"horizon": 12}}


def expected(id, name, seeds):
    """Costs (world, step) without an environment."""
    system = gym.make(id, **FEW[id]).unwrapped.system
    policy = make_policy(name, system, tuning_tapes(system, 0))
    return rollout(system, policy, draw_worlds(system, seeds)).cost


@pytest.mark.parametrize(("id", "name"), CASES)
def test_a_single_environment_is_played_episode_after_episode(id, name):
    env = gym.make(id, **FEW[id])
    policy, costs = env.unwrapped.policy(name), []
    for seed in (3, 4):
        env.reset(seed=seed)
        over, episode = False, []
        while not over:
            action = policy()
            assert env.action_space.contains(action)
            *_, terminated, truncated, info = env.step(action)
            over = terminated or truncated
            episode.append(info["cost"])
        costs.append(episode)
    np.testing.assert_array_equal(costs, expected(id, name, [3, 4]))


@pytest.mark.parametrize(("id", "name"), CASES)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_batch_whose_episodes_begin_at_different_steps_is_played(id, name, mode):
    """The second environment begins anew after the first step; the best schedules of its two worlds differ."""
    envs = gym.make_vec(id, 2, autoreset_mode=mode, **FEW[id])
    policy = envs.unwrapped.policy(name)
    envs.reset(seed=[3, 6])
    costs = [envs.step(policy())[4]["cost"]]
    envs.reset(seed=[None, 4], options={"reset_mask": np.array([False, True])})
    steps = FEW[id]["horizon"]
    costs += [envs.step(policy())[4]["cost"] for _ in range(steps - 2)]
    first, second = expected(id, name, [3, 4])
    costs = np.array(costs)
    np.testing.assert_array_equal(costs[:, 0], first[: steps - 1])
    np.testing.assert_array_equal(costs[1:, 1], second[: steps - 2])
    for _ in range(2 * steps):  # past the ends
        envs.step(policy())


def test_a_trained_agent_and_a_random_policy_follow_too():
    envs = gym.make_vec(POSITION, 3)
    envs.reset(seed=0)
    chosen = envs.unwrapped.policy(wavegym.load_agent(POSITION, "ppo"))()
    assert envs.action_space.contains(chosen)
    draws = [envs.unwrapped.policy("random", seed=seed)() for seed in (1, 1, 2)]
    np.testing.assert_array_equal(draws[0], draws[1])
    assert (draws[0] != draws[2]).any()
    assert SB3VecEnv(POSITION, 2).batch.policy("myopic")


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        ("myopik", "did you mean 'myopic'"),
        (3, "policy is 3, expected the name of a scheduler, or a Policy"),
        (InputError, "expected the name of a scheduler, or a Policy"),
    ],
)
def test_a_mistake_is_one_line(policy, words):
    with pytest.raises(InputError, match=words) as caught:
        gym.make(POSITION).unwrapped.policy(policy)
    assert "\n" not in str(caught.value)


def test_before_the_first_reset_there_is_nothing_to_choose():
    policy = gym.make(POSITION).unwrapped.policy("myopic")
    with pytest.raises(InputError, match=r"expected reset\(\) first"):
        policy()
