"""Fixtures of several folders. It stands here so that every test can import the helpers beside it."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from pathlib import Path

import gymnasium as gym
import pytest
from hypothesis import settings

# A property's first example may compile a kernel; how long that takes says nothing about the code. Half of Hypothesis's
# hundred examples, as the suite has ten minutes.
settings.register_profile("wavegym", deadline=None, max_examples=50)
settings.load_profile("wavegym")


def pytest_configure() -> None:
    """Collect garbage seldom: it takes four percent of the time, because everything about kernels is walked through."""
    gc.set_threshold(50_000)


def pytest_sessionfinish() -> None:
    """Spare what is alive: pytest now collects garbage five times, which takes a minute with all kernels in memory."""
    gc.freeze()


@pytest.fixture(scope="session")
def own_environments() -> Iterator[None]:
    """The small systems of ``evaluation_systems`` as registered environments."""
    from evaluation_systems import Hopeless, Measured, Uneven

    import wavegym

    own = {f"tests/{system.__name__}-v0": system for system in (Uneven, Measured, Hopeless)}
    for id, system in own.items():
        wavegym.register(id, system)
    yield
    for id in own:
        gym.registry.pop(id)


@pytest.fixture(scope="session")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of one PPO and one DQN run that nothing has interrupted, trained once for all tests."""
    from runs_for_tests import EVERY, small_spec

    from wavegym.learning.train import train

    folders = {algo: tmp_path_factory.mktemp("unbroken") / algo for algo in ("ppo", "dqn")}
    for algo, folder in folders.items():
        train(small_spec(algo), folder, EVERY[algo], progress=False)
    return folders
