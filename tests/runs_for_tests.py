"""Training runs small enough for tests."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import DQN, PPO

from wavegym.learning.settings import load_settings
from wavegym.learning.training_run import TrainingRun

ID = "wavegym/KershawEvansPosition-v0"
ENVIRONMENT = {"horizon": 7, "max_episode_steps": 6}
SMALL: dict[str, dict[str, Any]] = {
    "ppo": {
        "num_envs": 3,
        "n_steps": 10,
        "batch_size": 15,
        "n_epochs": 2,
        "network": [8, 8],
        "steps": 300,
        "variants": [],
    },
    "dqn": {
        "num_envs": 3,
        "buffer_size": 90,  # wraps around
        "learning_starts": 60,
        "batch_size": 8,
        "gradient_steps": 2,
        "target_update_interval": 30,
        "network": [8, 8],
        "exploration_fraction": 0.8,
        "steps": 300,
        "variants": [],
    },
}
EVERY = {"ppo": 60, "dqn": 50}


def small_run(algo: str, seed: int = 1, **changes: Any) -> TrainingRun:
    """A training of 300 steps, a second or so."""
    return TrainingRun(ID, algo, seed, load_settings(ID, algo, {**SMALL[algo], **changes}, ENVIRONMENT))


def arguments(algo: str, out: Path, *more: str) -> list[str]:
    """The same plan for the command line."""
    changes = [f"{key}={value}" for key, value in SMALL[algo].items()]
    environment = [f"{key}={value}" for key, value in ENVIRONMENT.items()]
    fixed = ["--setting", *changes, "--set", *environment, "--checkpoint-every", str(EVERY[algo]), "--seed", "1"]
    return [ID, "--algo", algo, "--out", str(out), "--quiet", *fixed, *more]


def trained_state(folder: Path) -> dict[str, np.ndarray]:
    """Weights and the optimiser's moments of a finished run."""
    run = json.loads((folder / "run.json").read_text())
    model = {"ppo": PPO, "dqn": DQN}[run["algo"]].load(io.BytesIO((folder / "model.zip").read_bytes()), device="cpu")
    state = {name: tensor.numpy() for name, tensor in model.policy.state_dict().items()}
    for i, moments in model.policy.optimizer.state_dict()["state"].items():
        state |= {f"{i}.{name}": torch.as_tensor(value).numpy() for name, value in moments.items()}
    return state


def assert_same_run(first: Path, second: Path) -> None:
    """Two finished runs agree in weights, optimiser and learning curve, to the last bit."""
    a, b = trained_state(first), trained_state(second)
    assert a.keys() == b.keys()
    for name in a:
        assert a[name].tobytes() == b[name].tobytes(), name
    assert (first / "curve.csv").read_text() == (second / "curve.csv").read_text()
