"""A discount per second for PPO, where steps differ in length.

A discount per step would favour actions with short steps, because later costs would then count less. Here the factor of
a step is gamma to the power of its duration, both in returns and in generalised advantages. lambda stays a factor per
step.

Rewards are centred: the mean cost per second of the environment times the duration is added to each. This adds the same
to all returns over the same time, so it favours no policy. Without it the reward of a step grows with its duration, and
an inaccurate critic favours short steps (reward centring: Naik, Wan, Tomar and Sutton, 2024).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from sb3_contrib.common.maskable.buffers import MaskableRolloutBuffer
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback

from wavegym.core.arrays import Array

CENTRING = 0.05  # weight of a rollout in the running mean


class _Timed:
    """The common part of both buffers.

    Args:
        gamma_per_second: the factor of a second.
    """

    def __init__(self, *arguments: Any, gamma_per_second: float, **settings: Any) -> None:
        self.gamma_per_second = gamma_per_second
        self.mean_rate: Array | None = None  # reward per second of each environment, a running mean over rollouts
        super().__init__(*arguments, **settings)

    def reset(self) -> None:
        """Empty the buffer, and forget the durations."""
        own: Any = self
        self.durations: Array = np.zeros((own.buffer_size, own.n_envs))
        super().reset()  # type: ignore[misc]

    def compute_returns_and_advantage(self, last_values: torch.Tensor, dones: Array) -> None:
        """As the base class, with one factor for each step, of centred rewards."""
        own: Any = self
        rate = own.rewards.sum(axis=0, dtype=np.float64) / self.durations.sum(axis=0)
        self.mean_rate = rate if self.mean_rate is None else self.mean_rate + CENTRING * (rate - self.mean_rate)
        own.rewards -= (self.mean_rate * self.durations).astype(np.float32)
        factor = self.gamma_per_second**self.durations
        following, goes_on = last_values.clone().cpu().numpy().flatten(), 1.0 - dones.astype(np.float32)
        advantage: Any = 0.0
        for step in reversed(range(own.buffer_size)):
            kept = factor[step] * goes_on
            delta = own.rewards[step] + kept * following - own.values[step]
            advantage = delta + kept * own.gae_lambda * advantage
            own.advantages[step] = advantage
            following, goes_on = own.values[step], 1.0 - own.episode_starts[step]
        own.returns = own.advantages + own.values


class TimedRolloutBuffer(_Timed, RolloutBuffer):
    """For PPO."""


class TimedMaskableRolloutBuffer(_Timed, MaskableRolloutBuffer):
    """For MaskablePPO."""


class NoteDurations(BaseCallback):
    """Gives a timed buffer the duration of each step (``info["duration"]``) before the step is added."""

    def _on_step(self) -> bool:
        buffer: Any = self.locals["rollout_buffer"]
        buffer.durations[buffer.pos] = [info["duration"] for info in self.locals["infos"]]
        return True
