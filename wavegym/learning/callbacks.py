"""Callbacks of a training run: learning curve, progress bar, TensorBoard, checkpoints."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from wavegym.core.files import write_whole
from wavegym.learning.checkpoints import save_checkpoint, snapshot
from wavegym.learning.curve import LearningCurve
from wavegym.learning.training_run import TrainingRun
from wavegym.policies.runs import BOARD, CHECKPOINTS, CURVE

ROWS = 100  # of the learning curve of a complete run


class SnapshotCallback(BaseCallback):
    """Records every step, and saves checkpoints at the start of rollouts, where a run can resume.

    Args:
        run: what is trained.
        folder: of the run.
        curve: the learning curve so far.
        every: most environment steps that a kill may cost (or one rollout, if that is longer).
        saved: steps at the checkpoint from which the run resumed; None for a new run.
        progress: show a bar on standard error.
    """

    def __init__(
        self, run: TrainingRun, folder: Path, curve: LearningCurve, every: int, saved: int | None, progress: bool
    ) -> None:
        super().__init__()
        settings: Any = run.settings
        self.run, self.folder, self.curve, self.every, self.saved = run, folder, curve, every, saved
        self.spacing = settings.steps // ROWS
        self._noted = time.process_time()
        self.rollout = settings.num_envs * (settings.n_steps if run.algo == "ppo" else 1)
        self.bar = tqdm(
            total=settings.steps,
            initial=saved or 0,
            unit=" steps",
            unit_scale=True,
            desc=f"{run.algo} seed {run.seed}",
            mininterval=0.5 if sys.stderr.isatty() else 10.0,
            disable=not progress,
        )

    def note_time(self) -> None:
        """Add the CPU time since the last call, or since this was made, to that of the run."""
        now = time.process_time()
        self.curve.cpu_seconds += now - self._noted
        self._noted = now

    def _on_rollout_start(self) -> None:
        self.note_time()
        steps = self.model.num_timesteps
        self.curve.close_row(steps, self.spacing)
        if self.curve.rows:
            cost = self.curve.rows[-1].cost
            self.logger.record("rollout/cost", cost)
            self.bar.set_postfix(cost=f"{cost:.4g}", refresh=False)
        if self.saved is None or (steps != self.saved and steps + self.rollout - self.saved > self.every):
            save_checkpoint(self.folder / CHECKPOINTS, steps, snapshot(self.run, self.model, self.curve))
            write_whole(self.folder, {CURVE: self.curve.csv().encode()})
            self.saved = steps

    def _on_step(self) -> bool:
        infos = self.locals["infos"]
        self.curve.add(np.array([info["cost"] for info in infos]), self.locals["dones"])
        self.bar.update(min(len(infos), self.bar.total - self.bar.n))  # the last rollout may exceed the total
        return True


@contextmanager
def tensorboard(folder: Path, steps: int) -> Iterator[Logger]:
    """A logger into the run's folder; entries that a killed run logged after ``steps`` are purged."""
    logger = Logger(str(folder / BOARD), [_Board(folder / BOARD, steps)])
    before, threading.excepthook = threading.excepthook, _raised_again
    try:
        yield logger
    finally:
        threading.excepthook = before
        logger.close()


def _raised_again(failure: threading.ExceptHookArgs) -> None:
    """Ignore an OSError (a full disk) in TensorBoard's thread: it is raised again in the main thread and reported."""
    if not issubclass(failure.exc_type, OSError):
        threading.__excepthook__(failure)


class _Board(TensorBoardOutputFormat):
    """Stable-Baselines3's TensorBoard output that can continue an earlier one."""

    def __init__(self, folder: Path, steps: int) -> None:
        self.writer = SummaryWriter(str(folder), purge_step=steps or None)
        self._is_closed = False
