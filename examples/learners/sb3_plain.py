"""PPO of Stable-Baselines3 as a newcomer writes it, with the default reward."""

from __future__ import annotations

from typing import Any

from against_myopic import main
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

import wavegym  # noqa: F401  (registers the environments)


def train(env_id: str, steps: int, seed: int) -> Any:
    """The model after ``steps`` environment steps."""
    envs = make_vec_env(env_id, n_envs=1, seed=seed)
    return PPO("MlpPolicy", envs, n_steps=min(2048, steps), seed=seed, device="cpu").learn(steps)


if __name__ == "__main__":
    main(train, 320_000)
