"""Training runs: killed at any time and resumed, a run ends with the same weights, bit for bit."""

from __future__ import annotations

import ctypes
import hashlib
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from filelock import FileLock, Timeout
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from wavegym.core.errors import InputError, check_int
from wavegym.core.files import write_whole
from wavegym.core.work import kept_parts
from wavegym.learning.callbacks import SnapshotCallback, tensorboard
from wavegym.learning.checkpoints import load_checkpoint, restore
from wavegym.learning.curve import LearningCurve
from wavegym.learning.export import export
from wavegym.learning.imitation import Lessons, WarmUp, pretrain
from wavegym.learning.models import build_model, discounts_seconds, model_bytes, systems_of, try_out
from wavegym.learning.observed import range_in_training
from wavegym.learning.time_discount import NoteDurations
from wavegym.learning.training_run import TrainingRun, check_resumable, check_unused, planned_steps
from wavegym.policies.networks import RANGE_KEY, LearnedPolicy
from wavegym.policies.runs import (
    CHECKPOINTS,
    CURVE,
    LOCK,
    MODEL,
    POLICY,
    RUN,
    TRAINING,
    read_policy,
    read_run,
    signature,
)


def train(run: TrainingRun, folder: Path, checkpoint_every: int, resume: bool = False, progress: bool = True) -> None:
    """Train into ``folder`` (its layout: ``wavegym.policies.runs``), from the start or from the last checkpoint there.

    Args:
        run: environment, algorithm, seed and settings.
        folder: a new or empty folder; with ``resume`` the folder of the same run, or of one with
            fewer steps, which is extended.
        checkpoint_every: most environment steps that a kill may cost (or one rollout, if that is longer).
        resume: continue a run from its last checkpoint; a finished run of as many steps is checked and left as it is.
            Where a run is extended, the learning rate is at once that of the longer training.
        progress: show a progress bar on standard error.

    Raises:
        InputError: the folder is in use or does not fit the call, or an invalid environment or reward.
        OSError: a full disk, for example; the last checkpoint is kept.
    """
    check_int("checkpoint-every", checkpoint_every, 1)
    torch.set_num_threads(1)  # a second thread slows networks of this size and makes the order of sums uncertain
    torch.distributions.Distribution.set_default_validate_args(False)  # checks of every value take 5 % of the time
    keep_freed_memory()
    if resume:
        check_resumable(run, folder)
    else:
        check_unused(folder)
        try_out(run)  # a mistake that only a step reveals must not leave a folder behind
    with _alone_in(folder):
        (_continue if resume else _begin)(run, folder, checkpoint_every, progress)


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Keep others from training into the folder at the same time; the lock ends with this process, however it ends."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(folder / LOCK, timeout=0):
            yield
    except Timeout:
        raise InputError(f"another training runs in {folder}, expected a folder of its own") from None


def _begin(run: TrainingRun, folder: Path, every: int, progress: bool) -> None:
    check_unused(folder)  # another training may have ended since the first look
    model = build_model(run)
    write_whole(folder, {TRAINING: _json(run.record())})
    _learn(run, folder, every, progress, model, _new_curve(run), None)


def _continue(run: TrainingRun, folder: Path, every: int, progress: bool) -> None:
    is_finished = (folder / RUN).exists()
    if is_finished and planned_steps(finished := read_run(folder / RUN)) == run.settings.steps:
        read_policy(folder, finished)
        return
    saved = load_checkpoint(folder / CHECKPOINTS)
    if saved is None and is_finished:
        raise InputError(f"{folder} holds no checkpoint, expected one to extend the run from")
    write_whole(folder, {TRAINING: _json(run.record())})  # with the steps of an extended run
    if saved is None:  # killed before the first checkpoint
        model, curve, start = build_model(run), _new_curve(run), None
    else:
        start, content = saved
        model, curve = restore(run, content)
        curve.extend(run.settings.steps)
    for half_written in folder.glob(".*.part"):
        half_written.unlink()
    _learn(run, folder, every, progress, model, curve, start)


def _learn(
    run: TrainingRun,
    folder: Path,
    every: int,
    progress: bool,
    model: BaseAlgorithm,
    curve: LearningCurve,
    start: int | None,
) -> None:
    """Learn from step ``start`` (None: the beginning) to the end, and write the results into the folder."""
    settings, env = run.settings, model.get_env()
    assert env is not None
    callback = SnapshotCallback(run, folder, curve, every, start, progress)
    callbacks: list[BaseCallback] = [callback, *([NoteDurations()] if discounts_seconds(settings) else [])]
    if settings.teacher:
        if start is None:
            with kept_parts(folder, Lessons) as parts:
                pretrain(model, settings, systems_of(env), run.seed, parts)
        callbacks.append(WarmUp(settings.critic_warm_up * callback.rollout))
    with tensorboard(folder, start or 0) as logger, callback.bar:
        model.set_logger(logger)
        model.learn(
            settings.steps - (start or 0),
            callback=callbacks,
            log_interval=1 if run.algo == "ppo" else settings.num_envs,  # rollouts; episodes
            reset_num_timesteps=start is None,
        )
    curve.close_row(model.num_timesteps, 1)
    callback.note_time()
    network = export(model.policy)
    policy = network.to_bytes()
    learned = LearnedPolicy(network, settings.forecasts, settings.candidates or None)
    observed = range_in_training(learned, run.env, run.seed, settings.environment, settings.variants)
    finished = {
        **run.record(),
        "steps": model.num_timesteps,
        "extended_from": curve.extended_from,
        "cpu_seconds": round(curve.cpu_seconds, 1),
        "policy_sha256": hashlib.sha256(policy).hexdigest(),
        **signature(systems_of(env)[0], settings.policy),
        RANGE_KEY: observed.record(),
    }
    write_whole(folder, {CURVE: curve.csv().encode(), MODEL: model_bytes(model), POLICY: policy, RUN: _json(finished)})


def _new_curve(run: TrainingRun) -> LearningCurve:
    return LearningCurve(run.settings.num_envs, run.settings.steps)


def _json(record: dict[str, Any]) -> bytes:
    return (json.dumps(record, indent=2) + "\n").encode()


# Parameters of mallopt, from glibc's malloc.h.
M_TRIM_THRESHOLD, M_MMAP_MAX = -1, -4


def keep_freed_memory() -> None:
    """Let this process keep freed memory for later allocations; has an effect with glibc only.

    glibc returns blocks above 32 MiB to the operating system as soon as they are freed, and clears every page when they
    are allocated again. Activations of a scorer with many candidates are that large: this took two thirds of the time
    of MultifunctionRadar's updates. A run that keeps the memory needs 1.5 times as much.
    """
    if sys.platform != "linux":
        return
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        library.mallopt(M_MMAP_MAX, 0)
        library.mallopt(M_TRIM_THRESHOLD, 2**31 - 1)
