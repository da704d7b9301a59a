"""Commands killed at random: one kill, and a planted defect that leaves a process behind."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from research.promises import faults
from wavegym.core.errors import InputError

LEAVER = """
import subprocess, sys, time
subprocess.Popen([sys.executable, "-c", "import time; time.sleep(8)"])
print("ready", flush=True)
time.sleep(60)
"""


@pytest.mark.release
def test_a_training_that_is_killed_ends_as_if_it_had_not_been(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command, files = faults.COMMANDS["train"]
    short = tuple("steps=4_000" if part.startswith("steps=") else part for part in command)
    monkeypatch.setitem(faults.COMMANDS, "train", (short, files))
    seconds = faults.undisturbed("train", tmp_path / "whole")
    faults.disturbed("train", tmp_path / "killed", 1, seconds, random.Random(0))
    for file in files:
        assert (tmp_path / "killed" / file).read_bytes() == (tmp_path / "whole" / file).read_bytes()


def test_a_process_that_is_left_behind_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(faults, "PATIENCE", 0.5)
    process = subprocess.Popen([sys.executable, "-c", LEAVER], stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    with pytest.raises(InputError, match=r"processes \[\d+\] are left 0.5 s after SIGKILL, expected none"):
        faults.killed(process, 0.1, signal.SIGKILL)
