"""An error before the first step leaves no folder behind."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
from runs_for_tests import ENVIRONMENT, ID, SMALL

import wavegym
from wavegym.core.errors import InputError
from wavegym.learning.settings import load_settings
from wavegym.learning.train import train
from wavegym.learning.training_run import TrainingRun
from wavegym.systems.kershaw_evans.system import KershawEvansPosition

OWN = "tests/Own-v0"


class Unreadable(KershawEvansPosition):
    """Its targets are missing, which shows only when a world is drawn."""

    def draw_world(self, rng: Any) -> Any:
        raise InputError("targets is 'missing.csv', expected a file")


class Shortsighted(KershawEvansPosition):
    """Offers no prediction."""

    def predict(self, belief: Any, actions: Any, outcome: Any = None) -> Any:
        raise NotImplementedError


@pytest.fixture
def own(request: pytest.FixtureRequest) -> Iterator[str]:
    wavegym.register(OWN, request.param)
    yield OWN
    gym.registry.pop(OWN)


@pytest.mark.parametrize(
    ("own", "words"),
    [
        (Unreadable, "targets is 'missing.csv'"),
        (Shortsighted, "does not offer what reward 'relative' needs, expected another reward"),
    ],
    indirect=["own"],
)
def test_an_environment_that_cannot_be_played_leaves_the_folder_unused(own: str, words: str, tmp_path: Path) -> None:
    settings = load_settings(own, "ppo", {**SMALL["ppo"], "reward": "relative"}, ENVIRONMENT)
    folder = tmp_path / "run"
    with pytest.raises(InputError, match=words):
        train(TrainingRun(own, "ppo", 1, settings), folder, 60, progress=False)
    assert not folder.exists()
    mended = load_settings(ID, "ppo", {**SMALL["ppo"], "steps": 30}, ENVIRONMENT)
    train(TrainingRun(ID, "ppo", 1, mended), folder, 60, progress=False)
    assert (folder / "run.json").exists()
