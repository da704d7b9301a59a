"""PPO of Stable-Baselines3 on the native batch, with a reward relative to the one-step scheduler."""

from __future__ import annotations

from typing import Any

from against_myopic import main
from stable_baselines3 import PPO

from wavegym.envs.sb3 import SB3VecEnv


def train(env_id: str, steps: int, seed: int) -> Any:
    """The model after ``steps`` environment steps; the observations need no normalisation."""
    envs = SB3VecEnv(env_id, num_envs=64, reward="relative")
    model = PPO("MlpPolicy", envs, n_steps=50, batch_size=1600, gamma=0.9, seed=seed, device="cpu")
    return model.learn(steps)


if __name__ == "__main__":
    main(train, 320_000)
