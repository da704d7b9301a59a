"""PPO of skrl on the native batch."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from against_myopic import main
from skrl.agents.torch.ppo import PPO
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import CategoricalMixin, DeterministicMixin, Model
from skrl.trainers.torch import SequentialTrainer
from skrl.utils import set_seed
from torch import nn

import wavegym  # noqa: F401  (registers the environments)

ENVS, ROLLOUT = 64, 50


def network(inputs: int, outputs: int) -> nn.Sequential:
    """Two hidden layers of 64; inputs need no normalisation."""
    return nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


class Actor(CategoricalMixin, Model):
    """Logits of the actions."""

    def __init__(self, env: Any) -> None:
        Model.__init__(self, observation_space=env.observation_space, action_space=env.action_space, device="cpu")
        CategoricalMixin.__init__(self)
        self.network = network(self.num_observations, self.num_actions)

    def compute(self, inputs: dict[str, Any], role: str = "") -> tuple[torch.Tensor, dict[str, Any]]:
        """See skrl's ``Model``."""
        return self.network(inputs["observations"]), {}


class Critic(DeterministicMixin, Model):
    """The value of an observation."""

    def __init__(self, env: Any) -> None:
        Model.__init__(self, observation_space=env.observation_space, action_space=env.action_space, device="cpu")
        DeterministicMixin.__init__(self)
        self.network = network(self.num_observations, 1)

    def compute(self, inputs: dict[str, Any], role: str = "") -> tuple[torch.Tensor, dict[str, Any]]:
        """See skrl's ``Model``."""
        return self.network(inputs["observations"]), {}


def train(env_id: str, steps: int, seed: int) -> Any:
    """A function of observations (env, fields) that returns the likeliest actions (env,)."""
    set_seed(seed)
    env = wrap_env(gym.make_vec(env_id, num_envs=ENVS, autoreset_mode="SameStep", reward="relative"))
    actor = Actor(env)
    settings = {
        "rollouts": ROLLOUT,
        "learning_epochs": 10,
        "mini_batches": 2,
        "discount_factor": 0.9,
        "learning_rate": 3e-4,
        "value_loss_scale": 0.5,
        "value_clip": 0.0,
        "experiment": {"write_interval": 0, "checkpoint_interval": 0},
    }
    agent = PPO(
        models={"policy": actor, "value": Critic(env)},
        memory=RandomMemory(memory_size=ROLLOUT, num_envs=ENVS, device="cpu"),
        observation_space=env.observation_space,
        action_space=env.action_space,
        device="cpu",
        cfg=settings,
    )
    rounds = max(steps // (ENVS * ROLLOUT), 1)
    quiet = {"timesteps": rounds * ROLLOUT, "headless": True, "disable_progressbar": True}
    SequentialTrainer(env=env, agents=agent, cfg={**quiet, "close_environment_at_exit": False}).train()

    def policy(seen: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return actor.network(torch.as_tensor(seen)).argmax(dim=1).numpy()

    return policy


if __name__ == "__main__":
    main(train, 320_000)
