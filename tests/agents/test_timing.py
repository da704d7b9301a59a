"""Time per decision: the inputs of each policy are those of an evaluation, and only its own time counts."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np
import pytest
from runs_for_tests import ID

from agents import timing
from wavegym.evaluation import make_task

SYSTEM = make_task(ID, {}).system


class Slow:
    """Takes a given time for each decision and records its inputs."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.shown: list[np.ndarray] = []

    def begin(self, system: Any, num_envs: int, rng: np.random.Generator) -> None:
        self.num_envs = num_envs

    def act(self, belief: Any, observation: np.ndarray, mask: Any) -> np.ndarray:
        end = perf_counter() + self.seconds
        while perf_counter() < end:
            pass
        self.shown.append(observation)
        return np.zeros(len(belief.step), np.int64)


@pytest.mark.slow
def test_each_takes_its_own_time_for_one_environment_in_several_situations(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "SINGLES", 5)
    quick, slow = Slow(0.0), Slow(2e-3)
    us = timing.decisions_us(SYSTEM, {"quick": (SYSTEM, quick), "slow": (SYSTEM, slow)})
    assert list(us) == ["best-planner", "best-planner alone", "quick", "slow"]
    assert us["slow"] >= 2e3  # it cannot have taken less
    assert us["slow"] > us["quick"] > 0.0
    assert us["best-planner"] > 0.0
    assert us["best-planner alone"] > 0.0
    assert quick.num_envs == 1
    assert len(quick.shown) == 5 * timing.STEPS
    assert all(observation.shape == (1, len(SYSTEM.observation_fields)) for observation in quick.shown)
    assert len(np.unique(np.concatenate(quick.shown), axis=0)) == timing.STEPS  # it goes on, as the planner plays
