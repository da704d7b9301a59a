"""PPO by RL Zoo, with the settings of ``rl_zoo.yml``; ``--gym-packages wavegym`` registers the environments."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from against_myopic import main
from stable_baselines3 import PPO

SETTINGS = Path(__file__).with_name("rl_zoo.yml")


def train(env_id: str, steps: int, seed: int) -> Any:
    """The model after ``steps`` environment steps."""
    with tempfile.TemporaryDirectory() as logs:
        options = ["--algo", "ppo", "--env", env_id, "--gym-packages", "wavegym", "--conf-file", str(SETTINGS)]
        options += ["--env-kwargs", "reward:'relative'", "--seed", str(seed), "--n-timesteps", str(steps)]
        options += ["--eval-freq", "-1", "--log-folder", logs, "--device", "cpu", "--verbose", "0"]
        subprocess.run([sys.executable, "-m", "rl_zoo3.train", *options], check=True)
        (model,) = Path(logs).rglob(f"{env_id.replace('/', '-')}.zip")
        return PPO.load(model, device="cpu")


if __name__ == "__main__":
    main(train, 320_000)
