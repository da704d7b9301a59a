"""Several sensors through the Stable-Baselines3 adapter: the same training as through its own DummyVecEnv."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import torch
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.vec_env import DummyVecEnv
from two_sensors import TwoSensors

from wavegym.envs import WaveformEnv, WaveformVectorEnv
from wavegym.envs.sb3 import SB3VecEnv
from wavegym.testing.lockstep import difference

COUNT = 3
SMALL = {"policy_kwargs": {"net_arch": [8]}, "seed": 5, "device": "cpu"}


@pytest.fixture(autouse=True)
def _one_thread():
    torch.set_num_threads(1)


def both(form):
    """Ours over a native batch, theirs over single environments."""
    system = TwoSensors(action=form)
    return SB3VecEnv(partial(WaveformVectorEnv, system), COUNT), DummyVecEnv([lambda: WaveformEnv(system)] * COUNT)


def weights(model):
    return {name: tensor.numpy() for name, tensor in model.policy.state_dict().items()}


@pytest.mark.parametrize("form", ["library", "joint", "box"])
def test_every_step_is_dummy_vec_envs(form):
    ours, theirs = both(form)
    for env in (ours, theirs):
        env.seed(7)
    assert difference(ours.reset(), theirs.reset()) is None
    theirs.action_space.seed(1)
    ended = 0
    for _ in range(2 * ours.batch.system.horizon + 1):
        actions = np.stack([theirs.action_space.sample() for _ in range(COUNT)])
        mine, reference = ours.step(actions), theirs.step(actions)
        assert difference(mine[:3], reference[:3]) is None
        assert difference(mine[3], list(reference[3])) is None
        ended += int(mine[2].sum())
    assert ended == 2 * COUNT


@pytest.mark.parametrize("form", ["library", "joint", "box"])
def test_ppo_learns_the_same_weights(form):
    ours, theirs = (PPO("MlpPolicy", env, n_steps=20, batch_size=30, **SMALL).learn(20 * COUNT) for env in both(form))
    assert difference(weights(ours), weights(theirs)) is None
    masks = ours.get_env().env_method("action_masks")
    assert form == "box" or [mask.shape for mask in masks] == [(6,) if form == "library" else (4,)] * COUNT


def test_dqn_learns_the_same_weights_on_the_joint_form():
    ours, theirs = (
        DQN("MlpPolicy", env, learning_starts=30, batch_size=16, train_freq=1, buffer_size=1000, **SMALL).learn(90)
        for env in both("joint")
    )
    assert difference(weights(ours), weights(theirs)) is None
