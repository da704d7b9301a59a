"""PPO of TorchRL through its ``GymEnv``, which makes single environments."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from against_myopic import main
from tensordict.nn import TensorDictModule
from torch import nn
from torch.distributions import Categorical
from torchrl.collectors import Collector
from torchrl.envs import GymEnv
from torchrl.modules import ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import wavegym  # noqa: F401  (registers the environments)

FRAMES, EPOCHS, BATCH = 2000, 10, 500


def network(inputs: int, outputs: int) -> nn.Sequential:
    """Two hidden layers of 64; inputs need no normalisation."""
    return nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


def train(env_id: str, steps: int, seed: int) -> Any:
    """A function of observations (env, fields) that returns the likeliest actions (env,)."""
    torch.manual_seed(seed)
    env = GymEnv(env_id, reward="relative", categorical_action_encoding=True)
    env.set_seed(seed)
    fields, actions = env.observation_spec["observation"].shape[-1], int(env.action_spec.space.n)
    logits = network(fields, actions)
    actor = ProbabilisticActor(
        TensorDictModule(logits, ["observation"], ["logits"]),
        in_keys=["logits"],
        distribution_class=Categorical,
        return_log_prob=True,
    )
    critic = ValueOperator(network(fields, 1), in_keys=["observation"])
    advantages = GAE(gamma=0.9, lmbda=0.95, value_network=critic, average_gae=True)
    loss = ClipPPOLoss(actor, critic, entropy_coeff=0.0)
    optimiser = torch.optim.Adam(loss.parameters(), 3e-4)
    frames = min(FRAMES, steps)
    for data in Collector(env, actor, frames_per_batch=frames, total_frames=steps):
        for _ in range(EPOCHS):
            with torch.no_grad():
                advantages(data)
            for rows in torch.randperm(frames).split(BATCH):
                terms = loss(data[rows])
                optimiser.zero_grad()
                (terms["loss_objective"] + terms["loss_critic"]).backward()
                nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimiser.step()

    def policy(seen: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return logits(torch.as_tensor(seen)).argmax(dim=1).numpy()

    return policy


if __name__ == "__main__":
    main(train, 320_000)
