"""The environment's share of PPO's wall time at 64 environments."""

from __future__ import annotations

import time
from typing import Any

from stable_baselines3 import PPO

from wavegym.envs.sb3 import SB3VecEnv

ENVIRONMENTS = 64


class Clocked(SB3VecEnv):
    """Adds up the time spent in ``step_wait`` and ``reset``."""

    seconds = 0.0

    def step_wait(self) -> Any:
        start = time.perf_counter()
        try:
            return super().step_wait()
        finally:
            self.seconds += time.perf_counter() - start


def run(env_id: str, steps: int = 64 * 50 * 12) -> tuple[float, float]:
    """Share of the wall time in [0, 1] and steps per second, for a small network and six epochs."""
    env = Clocked(env_id, ENVIRONMENTS)
    recipe = {"n_steps": 50, "batch_size": 1600, "n_epochs": 6, "gamma": 0.9, "gae_lambda": 0.9}
    model = PPO("MlpPolicy", env, learning_rate=1e-3, device="cpu", seed=0, **recipe)
    model.learn(ENVIRONMENTS * 50)  # compilation and first-call costs
    env.seconds, start = 0.0, time.perf_counter()
    model.learn(steps)
    wall = time.perf_counter() - start
    return env.seconds / wall, steps / wall
