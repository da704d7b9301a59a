"""Everything a training run depends on, as bytes: taken up again, it goes on as if it had never stopped.

The only safe moment is the start of a rollout: gradient steps are done, the environments rest between two steps, and
whatever Stable-Baselines3 keeps in local variables is about to be made anew.
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
        "notes": notes,
        # The action space draws random actions. SB3 and the replay buffer draw from the global generators.
        "action_space": model.action_space,
        "python": random.getstate(),
        "numpy": np.random.get_state(),  # noqa: NPY002
        "torch": torch.get_rng_state(),
    }
    return pickle.dumps(state, protocol=pickle.HIGHEST_PROTOCOL)


def restore(spec: RunSpec, content: bytes) -> tuple[BaseAlgorithm, Any]:
    """The model with its environment, ready for ``learn(reset_num_timesteps=False)``, and the notes.

    Raises:
        InputError: the content is no snapshot of a run of this spec, or one of another version of the code.
    """
    try:
        state = pickle.loads(content)
        model = model_class(spec.settings).load(
            io.BytesIO(state["model"]), env=state["env"], device="cpu", force_reset=False
        )
        model.action_space = state["action_space"]
    except Exception as error:  # unpickling foreign bytes can raise anything
        raise InputError(f"checkpoint is no snapshot of this training: {type(error).__name__}: {error}") from error
    if state["replay_buffer"] is not None:
        model.replay_buffer = state["replay_buffer"]  # type: ignore[attr-defined]
    # Last, because making the model draws random weights and seeds the generators.
    random.setstate(state["python"])
    np.random.set_state(state["numpy"])  # noqa: NPY002
    torch.set_rng_state(state["torch"])
    return model, state["notes"]
