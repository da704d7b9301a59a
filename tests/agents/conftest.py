"""Runs that several tests look at are trained once."""

from __future__ import annotations

from pathlib import Path

import pytest
from runs_for_tests import EVERY, small_plan

from agents.training.learn import train


@pytest.fixture(scope="session")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of one PPO and one DQN run that nothing has interrupted."""
    folders = {algo: tmp_path_factory.mktemp("unbroken") / algo for algo in ("ppo", "dqn")}
    for algo, folder in folders.items():
        train(small_plan(algo), folder, EVERY[algo], progress=False)
    return folders
