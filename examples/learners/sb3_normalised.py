"""PPO of Stable-Baselines3 with VecNormalize, which scales the rewards by their running deviation."""

from __future__ import annotations

from typing import Any

import numpy as np
from against_myopic import main
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize

import wavegym  # noqa: F401  (registers the environments)


def train(env_id: str, steps: int, seed: int) -> Any:
    """A function of observations (env, fields) that returns the actions (env,) of the model after ``steps`` steps."""
    envs = VecNormalize(make_vec_env(env_id, n_envs=1, seed=seed))
    model = PPO("MlpPolicy", envs, n_steps=min(2048, steps), seed=seed, device="cpu").learn(steps)

    def policy(observation: np.ndarray) -> np.ndarray:
        return model.predict(envs.normalize_obs(observation), deterministic=True)[0]

    return policy


if __name__ == "__main__":
    main(train, 320_000)
