"""The complete state of a training run as bytes: a resumed run continues as if it had never stopped.

A snapshot is safe only at the start of a rollout: no gradient step or environment step is half done, and
Stable-Baselines3 is about to set its local variables anew.
"""

from __future__ import annotations

import io
import pickle
import random
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from wavegym.core.errors import InputError
from wavegym.learning.training.models import model_bytes, model_class
from wavegym.learning.training.run_spec import RunSpec


def snapshot(model: BaseAlgorithm, notes: Any) -> bytes:
    """The state of a training run between two rollouts, and the caller's own ``notes``."""
    state = {
        "model": model_bytes(model),
        "env": model.get_env(),
        "replay_buffer": getattr(model, "replay_buffer", None),
        "mean_rate": getattr(getattr(model, "rollout_buffer", None), "mean_rate", None),  # of a discount per second
        "notes": notes,
        # The action space draws random actions; SB3 and the replay buffer draw from the global generators.
        "action_space": model.action_space,
        "python": random.getstate(),
        "numpy": np.random.get_state(),  # noqa: NPY002
        "torch": torch.get_rng_state(),
    }
    return pickle.dumps(state, protocol=pickle.HIGHEST_PROTOCOL)


def restore(spec: RunSpec, content: bytes) -> tuple[BaseAlgorithm, Any]:
    """The model with its environment, ready for ``learn(reset_num_timesteps=False)``, and the notes.

    Raises:
        InputError: the content is no snapshot of a run of this specification, or another version of the code made it.
    """
    try:
        state = pickle.loads(content)
        model = model_class(spec.settings).load(
            io.BytesIO(state["model"]), env=state["env"], device="cpu", force_reset=False
        )
        model.action_space = state["action_space"]
    except Exception as error:  # unpickling can raise anything
        raise InputError(f"checkpoint is no snapshot of this training: {type(error).__name__}: {error}") from error
    if state["replay_buffer"] is not None:
        model.replay_buffer = state["replay_buffer"]  # type: ignore[attr-defined]
    if state["mean_rate"] is not None:
        model.rollout_buffer.mean_rate = state["mean_rate"]  # type: ignore[attr-defined]
    # Last: making the model draws random weights and seeds the generators.
    random.setstate(state["python"])
    np.random.set_state(state["numpy"])  # noqa: NPY002
    torch.set_rng_state(state["torch"])
    return model, state["notes"]
