"""Training runs that can be killed at any time and taken up again, with the same weights at the end, bit for bit."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from wavegym.core.errors import whole
from wavegym.evaluation.files import write_whole
from wavegym.learning.policies.export import export
from wavegym.learning.training.callbacks import Keeper, tensorboard
from wavegym.learning.training.checkpoints import load_checkpoint
from wavegym.learning.training.curve import LearningCurve
from wavegym.learning.training.imitation import WarmUp, teach
from wavegym.learning.training.models import build_model, model_bytes, try_out
from wavegym.learning.training.run_spec import Plan, check_same, check_unused
from wavegym.learning.training.snapshots import restore
from wavegym.policies.records import read_run
from wavegym.policies.runs import CHECKPOINTS, CURVE, MODEL, PLAN, POLICY, RUN, read_policy, signature


def train(plan: Plan, folder: Path, checkpoint_every: int, resume: bool = False, progress: bool = True) -> None:
    """Train into ``folder`` (its layout: ``wavegym.policies.runs``), from the start or from the last checkpoint there.

    Args:
        plan: what to train.
        folder: a new or empty folder; with ``resume`` that of a killed run of the same plan.
        checkpoint_every: environment steps that a kill may cost, at most (or one rollout, if that is longer).
        resume: take up a run; one that had finished is checked and left as it is.
        progress: show a progress bar on standard error.

    Raises:
        InputError: the folder holds a run already, or (resume) none, or one of another plan, or no whole checkpoint,
            or a finished one whose policy is torn; an environment or reward that cannot be played.
        OSError: a full disk and the like; the last checkpoint is still there.
    """
    whole("checkpoint-every", checkpoint_every, 1)
    torch.set_num_threads(1)  # a second one makes networks of this size slower, and the order of sums uncertain
    if not resume:
        check_unused(folder)
        try_out(plan)  # a mistake that only a step brings to light must not leave a folder behind
        model = build_model(plan)
        write_whole(folder, {PLAN: _json(plan.record())})
        _learn(plan, folder, checkpoint_every, progress, model, LearningCurve(plan.settings.num_envs), None)
        return
    check_same(plan, folder)
    if (folder / RUN).exists():
        read_policy(folder, read_run(folder / RUN))
        return
    saved = load_checkpoint(folder / CHECKPOINTS)
    if saved is None:  # killed before the first
        model, curve, start = build_model(plan), LearningCurve(plan.settings.num_envs), None
    else:
        start, content = saved
        model, curve = restore(plan, content)
    for half_written in folder.glob(".*.part"):
        half_written.unlink()
    _learn(plan, folder, checkpoint_every, progress, model, curve, start)


def _learn(
    plan: Plan, folder: Path, every: int, progress: bool, model: BaseAlgorithm, curve: LearningCurve, start: int | None
) -> None:
    """Learn from ``start`` (steps; None: the beginning) to the end, and leave the results in the folder."""
    settings, env = plan.settings, model.get_env()
    assert env is not None
    system = env.get_attr("system", 0)[0]
    keeper = Keeper(plan, folder, curve, every, start, progress)
    callbacks: list[BaseCallback] = [keeper]
    if settings.teacher:
        if start is None:
            teach(model, settings, system, plan.seed)
        callbacks.append(WarmUp(settings.warm_up * keeper.rollout))
    with tensorboard(folder, start or 0) as logger, keeper.bar:
        model.set_logger(logger)
        model.learn(
            settings.steps - (start or 0),
            callback=callbacks,
            log_interval=1 if plan.algo == "ppo" else settings.num_envs,  # rollouts; episodes
            reset_num_timesteps=start is None,
        )
    curve.close_row(model.num_timesteps, 1)
    policy = export(model.policy).to_bytes()
    run = {
        **plan.record(),
        "steps": model.num_timesteps,
        "policy_sha256": hashlib.sha256(policy).hexdigest(),
        **signature(system),
    }
    write_whole(folder, {CURVE: curve.csv().encode(), MODEL: model_bytes(model), POLICY: policy, RUN: _json(run)})


def _json(record: dict[str, Any]) -> bytes:
    return (json.dumps(record, indent=2) + "\n").encode()
