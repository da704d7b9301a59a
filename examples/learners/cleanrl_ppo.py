"""Proximal policy optimisation in one file with torch alone, in the manner of CleanRL, on the native batch.

The environments restart in the step that ends an episode (``SameStep``). The value after a terminated episode is 0.
After a truncation the critic gives the value of the last observation, which is in ``info["final_obs"]``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from against_myopic import main
from torch import Tensor, nn
from torch.distributions import Categorical

import wavegym  # noqa: F401  (registers the environments)

ENVS, ROLLOUT, EPOCHS, BATCH = 64, 50, 10, 1600
GAMMA, LAMBDA, CLIP, RATE = 0.9, 0.95, 0.2, 3e-4


class Rollout(NamedTuple):
    """The data of one rollout, (step, env, ...)."""

    observation: Tensor
    action: Tensor
    log_probability: Tensor
    advantage: Tensor
    value: Tensor


def network(inputs: int, outputs: int) -> nn.Sequential:
    """Two hidden layers of 64; inputs need no normalisation."""
    return nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


def collect(envs: Any, observation: np.ndarray, actor: nn.Module, critic: nn.Module) -> tuple[Rollout, np.ndarray]:
    """Play ROLLOUT steps from ``observation``; also returns the observation after them."""
    rows, rewards, ends, following = [], [], [], []
    for _ in range(ROLLOUT):
        seen = torch.as_tensor(observation)
        choice = Categorical(logits=actor(seen))
        action = choice.sample()
        observation, reward, terminated, truncated, info = envs.step(action.numpy())
        rows.append((seen, action, choice.log_prob(action), critic(seen)[:, 0]))
        last = observation.copy()
        ended = terminated | truncated
        for i in np.flatnonzero(ended):
            last[i] = info["final_obs"][i]
        following.append(critic(torch.as_tensor(last))[:, 0] * torch.as_tensor(~terminated))
        rewards.append(torch.as_tensor(reward, dtype=torch.float32))
        ends.append(torch.as_tensor(ended))
    seen, action, log_probability, value = map(torch.stack, zip(*rows, strict=True))
    advantage, ahead = torch.zeros_like(value), torch.zeros(len(ended))
    for t in reversed(range(ROLLOUT)):
        ahead = rewards[t] + GAMMA * following[t] - value[t] + GAMMA * LAMBDA * ~ends[t] * ahead
        advantage[t] = ahead
    return Rollout(seen, action, log_probability, advantage, value), observation


def learn(rollout: Rollout, actor: nn.Module, critic: nn.Module, optimiser: Any) -> None:
    """Several passes over one rollout."""
    seen, action, old, advantage, value = (part.flatten(0, 1) for part in rollout)
    target = advantage + value
    for _ in range(EPOCHS):
        for rows in torch.randperm(len(action)).split(BATCH):
            choice, gain = Categorical(logits=actor(seen[rows])), advantage[rows]
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            ratio = (choice.log_prob(action[rows]) - old[rows]).exp()
            surrogate = torch.minimum(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain)
            error = (critic(seen[rows])[:, 0] - target[rows]).square()
            optimiser.zero_grad()
            (0.5 * error.mean() - surrogate.mean()).backward()
            nn.utils.clip_grad_norm_([*actor.parameters(), *critic.parameters()], 0.5)
            optimiser.step()


def train(env_id: str, steps: int, seed: int) -> Any:
    """A function of observations (env, fields) that returns the likeliest actions (env,)."""
    torch.manual_seed(seed)
    envs = gym.make_vec(env_id, num_envs=ENVS, autoreset_mode="SameStep", reward="relative")
    fields, actions = envs.single_observation_space.shape[0], int(envs.single_action_space.n)
    actor, critic = network(fields, actions), network(fields, 1)
    optimiser = torch.optim.Adam([*actor.parameters(), *critic.parameters()], RATE, eps=1e-5)
    observation, _ = envs.reset(seed=seed)
    for _ in range(max(steps // (ENVS * ROLLOUT), 1)):
        with torch.no_grad():
            rollout, observation = collect(envs, observation, actor, critic)
        learn(rollout, actor, critic, optimiser)

    def policy(seen: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return actor(torch.as_tensor(seen)).argmax(dim=1).numpy()

    return policy


if __name__ == "__main__":
    main(train, 320_000)
