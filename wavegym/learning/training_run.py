"""What a training run trains. It is written into the run's folder first, so that --resume continues no other run."""

from __future__ import annotations

import dataclasses
import json
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from wavegym.core import VERSION
from wavegym.core.errors import InputError
from wavegym.learning.settings import Settings
from wavegym.policies.runs import CONTENTS, TRAINING, difference, read_record

PACKAGES = ("numpy", "torch", "gymnasium", "stable-baselines3", "sb3-contrib")


@dataclasses.dataclass(frozen=True)
class TrainingRun:
    """What to train; two equal runs end with the same weights.

    Attributes:
        env: the environment's full id.
        algo: "ppo" or "dqn".
        seed: training seed, 0 to 2^32 - 1.
        settings: of the algorithm, ``steps`` among them.
    """

    env: str
    algo: str
    seed: int
    settings: Settings

    def __post_init__(self) -> None:
        if not 0 <= self.seed < 2**32:
            raise InputError(f"seed is {self.seed}, expected an integer in [0, {2**32 - 1}]")

    def record(self) -> dict[str, Any]:
        """The run as JSON, with the package versions that the last bits depend on."""
        python = ".".join(platform.python_version_tuple()[:2])
        versions = {"python": python, "wavegym": VERSION, **{name: _version(name) for name in PACKAGES}}
        return json.loads(json.dumps({**dataclasses.asdict(self), "versions": versions}))


def check_unused(folder: Path) -> None:
    """Raise an InputError if the folder holds a run: no run is ever overwritten."""
    for name in CONTENTS:
        if (folder / name).exists():
            raise InputError(f"{folder} already holds a run ({name}), expected a new folder or --resume")


def check_resumable(run: TrainingRun, folder: Path) -> None:
    """Raise an InputError if the folder holds no run, or another run (the difference is named).

    More steps than those of the run are no difference: they extend it.
    """
    if not (folder / TRAINING).exists():
        raise InputError(f"{folder} holds no run to resume, expected {TRAINING} in it")
    there = read_record(folder / TRAINING)
    if planned_steps(there) < run.settings.steps:
        there["settings"]["steps"] = run.settings.steps
    unlike = difference(run.record(), there)
    if unlike:
        name, here, there = unlike
        raise InputError(f"{name} is {here!r}, but the run in {folder} has {there!r}: it cannot be resumed")


def planned_steps(record: dict[str, Any]) -> int:
    """The steps in a record of a ``TrainingRun``; 0 if it is none."""
    settings = record.get("settings")
    steps = settings.get("steps") if isinstance(settings, dict) else 0
    return steps if isinstance(steps, int) else 0


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:  # run from a source tree, say
        return "unknown"
