"""Move new agents into the package: ``python -m agents.package``.

The first training seed of every (environment, algorithm) under results/runs is moved to wavegym/policies/pretrained. A
link replaces it, so each file exists once. The seed is always 0, not the best one, so that the package's agents are a
fair sample of the agents in the tables.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

from agents.experiment import run_folder
from wavegym.core.command_line import Parser, guarded
from wavegym.policies.runs import ALGORITHMS, PRETRAINED, PRETRAINED_FILES
from wavegym.registration import SYSTEMS, stem

SEED = "seed0"


def sources() -> dict[Path, Path]:
    """The run folder in results/runs, or the link, for each folder of the package."""
    names = [stem(env_id) for env_id in SYSTEMS]
    pairs = {PRETRAINED / name / algo: run_folder(name, algo) / SEED for name in names for algo in ALGORITHMS}
    return {packaged: run for packaged, run in pairs.items() if run.is_dir()}


def move(run: Path, packaged: Path) -> None:
    """Move the agent of a finished run, and make the run's folder a link to it. Its checkpoints are deleted."""
    packaged.mkdir(parents=True, exist_ok=True)
    for name in PRETRAINED_FILES:
        (run / name).replace(packaged / name)
    shutil.rmtree(run)
    run.symlink_to(os.path.relpath(packaged, run.parent), target_is_directory=True)


def package() -> None:
    """Move every run that is not a link yet."""
    Parser(prog="python -m agents.package", description="Move seed 0 of each new agent into the package.").read(None)
    for packaged, run in sources().items():
        if not run.is_symlink():
            move(run, packaged)
            print(packaged.relative_to(PRETRAINED))


if __name__ == "__main__":
    sys.exit(guarded(package))
