"""DQN's training killed with SIGKILL at random moments; tests/research/promises/test_faults.py kills PPO's."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from pathlib import Path

import pytest
from runs_for_tests import EVERY, arguments, assert_same_run, small_run

from wavegym.learning.train import train

ROOT = Path(__file__).parents[2]
ALGO = "dqn"
STEPS = 1500
KILLS = 2


def checkpoints(folder: Path) -> set[str]:
    return {path.name for path in (folder / "checkpoints").glob("*.ckpt")}


@pytest.mark.slow
def test_killed_at_any_moment_it_ends_with_the_same_weights(tmp_path: Path) -> None:
    folder, moment = tmp_path / "killed", random.Random(ALGO)
    command = [sys.executable, "train.py", *arguments(ALGO, folder, "--steps", str(STEPS))]
    for _ in range(KILLS):
        before = checkpoints(folder)
        with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
            while checkpoints(folder) <= before and process.poll() is None:
                time.sleep(0.01)
            time.sleep(moment.uniform(0.0, 0.3))
            assert process.poll() is None, process.stderr.read() if process.stderr else ""
            process.kill()
        command = [*command, "--resume"] if "--resume" not in command else command
    assert not (folder / "run.json").exists()
    assert subprocess.run(command, cwd=ROOT, check=False).returncode == 0
    train(small_run(ALGO, steps=STEPS), tmp_path / "unbroken", EVERY[ALGO], progress=False)
    assert_same_run(folder, tmp_path / "unbroken")
    assert not list(folder.rglob("*.part"))
