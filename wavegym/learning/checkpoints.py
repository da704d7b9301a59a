"""Checkpoints: the complete state of a training run, from which a resumed run continues as if it had never stopped.

Torn files are recognised, the last two are kept. Their content is arrays and JSON (``wavegym.core.files``): whoever
resumes a run executes nothing that its folder holds. The model and its environments are made anew from the
``TrainingRun``, and take over what changes in a training.

A snapshot is safe only at the start of a rollout: no gradient step or environment step is half done, and
Stable-Baselines3 is about to set its local variables anew.
"""

from __future__ import annotations

import hashlib
import random
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from wavegym.core.errors import InputError
from wavegym.core.files import packed, unpacked, write_whole
from wavegym.learning.curve import LearningCurve
from wavegym.learning.models import build_model
from wavegym.learning.training_run import TrainingRun
from wavegym.policies.runs import difference

MAGIC = b"wavegym checkpoint 1\n"
LENGTH = 8  # bytes of the content's length, then its SHA-256, then the content
KEPT = 2
HEADER = len(MAGIC) + LENGTH + hashlib.sha256().digest_size

# What a training changes in a model of Stable-Baselines3, except for weights, optimiser and buffers.
COUNTERS = (
    "num_timesteps", "_total_timesteps", "_num_timesteps_at_start", "_episode_num", "_n_updates", "_n_calls",
    "_current_progress_remaining", "exploration_rate",
)  # fmt: skip
LAST = ("_last_obs", "_last_episode_starts")
REPLAYED = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")  # rows of a replay buffer


def save_checkpoint(folder: Path, steps: int, content: bytes) -> None:
    """Write ``content`` as the checkpoint after ``steps``; remove half-written files and all but the last two.

    Raises:
        OSError: a full disk, for example; earlier checkpoints are kept.
    """
    header = MAGIC + len(content).to_bytes(LENGTH, "big") + hashlib.sha256(content).digest()
    write_whole(folder, {f"step-{steps:012d}.ckpt": header + content})
    for old in [*_listed(folder)[:-KEPT], *folder.glob(".*.part")]:
        old.unlink()


def load_checkpoint(folder: Path) -> tuple[int, bytes] | None:
    """Steps and content of the last intact checkpoint; None if the folder holds no checkpoint.

    A torn checkpoint is skipped with a line on standard error. No file is deleted.

    Raises:
        InputError: there are checkpoints, and none of them is intact.
    """
    paths = _listed(folder)
    for path in reversed(paths):
        content = _content(path)
        if content is not None:
            return int(path.stem.removeprefix("step-")), content
        print(f"checkpoint {path} is torn, skipped", file=sys.stderr)
    if paths:
        raise InputError(f"none of the {len(paths)} checkpoints in {folder} is intact, expected one to resume from")
    return None


def _listed(folder: Path) -> list[Path]:
    """The checkpoints, oldest first."""
    return sorted(p for p in folder.glob("step-*.ckpt") if re.fullmatch(r"step-\d{12}", p.stem))


def _content(path: Path) -> bytes | None:
    """The content of a checkpoint; None if the file is torn."""
    data = path.read_bytes()
    head, content = data[:HEADER], data[HEADER:]
    length, digest = head[len(MAGIC) : len(MAGIC) + LENGTH], head[len(MAGIC) + LENGTH :]
    whole = data.startswith(MAGIC) and len(content) == int.from_bytes(length, "big")
    return content if whole and hashlib.sha256(content).digest() == digest else None


def snapshot(run: TrainingRun, model: BaseAlgorithm, curve: LearningCurve) -> bytes:
    """The state of a training run between two rollouts, and its curve."""
    env: Any = model.get_env()
    state = {
        "run": run.record(),
        "counters": {name: getattr(model, name) for name in COUNTERS if hasattr(model, name)},
        "last": {name: getattr(model, name) for name in LAST if hasattr(model, name)},
        "weights": _arrays(model.policy.state_dict()),
        "optimiser": _arrays(model.policy.optimizer.state_dict()),
        "replay": _replay(getattr(model, "replay_buffer", None)),
        "mean_rate": getattr(getattr(model, "rollout_buffer", None), "mean_rate", None),  # of a discount per second
        "env": env.saved(),
        "curve": curve.saved(),
        # The action space draws random actions; SB3 and the replay buffer draw from the global generators.
        "action_space": model.action_space.np_random.bit_generator.state,
        "python": random.getstate(),
        "numpy": np.random.get_state(legacy=False),  # noqa: NPY002
        "torch": torch.get_rng_state().numpy(),
    }
    return packed(state)


def restore(run: TrainingRun, content: bytes) -> tuple[BaseAlgorithm, LearningCurve]:
    """The model with its environment, ready for ``learn(reset_num_timesteps=False)``, and the curve.

    Raises:
        InputError: the content is no snapshot, or one of another run; more steps are no difference.
    """
    try:
        state = unpacked(content)
        there = state["run"]
        there["settings"]["steps"] = run.settings.steps
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"checkpoint is no snapshot of a training: {type(error).__name__}: {error}") from None
    if unlike := difference(run.record(), there):
        name, here, other = unlike
        raise InputError(f"checkpoint is of another run: its {name} is {other!r}, expected {here!r}")
    model = build_model(run)
    try:
        _load(model, state)
        curve = LearningCurve.restored(state["curve"])
    except (KeyError, TypeError, ValueError, IndexError, RuntimeError) as error:
        raise InputError(f"checkpoint does not fit this training: {type(error).__name__}: {error}") from None
    return model, curve


def _load(model: Any, state: dict[str, Any]) -> None:
    env: Any = model.get_env()
    for name, value in {**state["counters"], **state["last"]}.items():
        if name in (*COUNTERS, *LAST):
            setattr(model, name, value)
    model.policy.load_state_dict(_tensors(state["weights"]))
    optimiser = _tensors(state["optimiser"])
    optimiser["state"] = {int(index): each for index, each in optimiser["state"].items()}
    model.policy.optimizer.load_state_dict(optimiser)
    if state["replay"] is not None:
        buffer = model.replay_buffer
        buffer.pos, buffer.full = state["replay"]["pos"], state["replay"]["full"]
        for name, rows in state["replay"]["rows"].items():
            if name in REPLAYED:
                getattr(buffer, name)[: len(rows)] = rows
    if state["mean_rate"] is not None:
        model.rollout_buffer.mean_rate = state["mean_rate"]
    env.restore(state["env"])
    # Last: making the model and its environments draws random numbers.
    model.action_space.np_random.bit_generator.state = state["action_space"]
    version, numbers, following = state["python"]
    random.setstate((version, tuple(numbers), following))
    np.random.set_state(state["numpy"])  # noqa: NPY002
    torch.set_rng_state(torch.as_tensor(state["torch"]))


def _replay(buffer: Any) -> dict[str, Any] | None:
    """The filled rows of a replay buffer."""
    if buffer is None:
        return None
    count = buffer.buffer_size if buffer.full else buffer.pos
    rows = {name: getattr(buffer, name)[:count] for name in REPLAYED if hasattr(buffer, name)}
    return {"rows": rows, "pos": buffer.pos, "full": bool(buffer.full)}


def _arrays(value: Any) -> Any:
    """The same with arrays in place of tensors."""
    if isinstance(value, torch.Tensor):
        return value.detach().cpu().numpy().copy()
    if isinstance(value, dict):
        return {key: _arrays(each) for key, each in value.items()}
    return [_arrays(each) for each in value] if isinstance(value, (list, tuple)) else value


def _tensors(value: Any) -> Any:
    """The reverse of ``_arrays``."""
    if isinstance(value, np.ndarray):
        return torch.as_tensor(value)
    if isinstance(value, dict):
        return {key: _tensors(each) for key, each in value.items()}
    return [_tensors(each) for each in value] if isinstance(value, list) else value
