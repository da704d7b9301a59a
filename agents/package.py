"""Copy the agents that the package brings along: ``python -m agents.package``.

The first training seed of every (environment, algorithm) under results/runs goes to wavegym/policies/pretrained. The
seed is always 0, never the best one: the package's agents are a fair sample of the ones in the tables.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from agents.experiment import run_folder
from wavegym.core.command_line import Parser, guarded
from wavegym.policies.runs import ALGORITHMS, PRETRAINED, PRETRAINED_FILES
from wavegym.registration import SYSTEMS, stem

SEED = "seed0"


def sources() -> dict[Path, Path]:
    """The run folder in results/runs for each folder of the package."""
    names = [stem(env_id) for env_id in SYSTEMS]
    pairs = {PRETRAINED / name / algo: run_folder(name, algo) / SEED for name in names for algo in ALGORITHMS}
    return {packaged: run for packaged, run in pairs.items() if run.is_dir()}


def package() -> None:
    """Replace the package's agents."""
    Parser(prog="python -m agents.package", description="Copy seed 0 of each agent into the package.").read(None)
    for old in PRETRAINED.iterdir():
        if old.is_dir():
            shutil.rmtree(old)
    for packaged, run in sources().items():
        packaged.mkdir(parents=True)
        for name in PRETRAINED_FILES:
            shutil.copyfile(run / name, packaged / name)
        print(packaged.relative_to(PRETRAINED))


if __name__ == "__main__":
    sys.exit(guarded(package))
