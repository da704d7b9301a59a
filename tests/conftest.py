"""Fixtures of several folders. The file is here so that every test can import the helpers in this folder."""

from __future__ import annotations

import gc
import os
from collections.abc import Generator, Iterator
from pathlib import Path

import gymnasium as gym
import pytest
from hypothesis import settings
from numba.core import event

# A property's first example may compile a kernel; how long that takes says nothing about the code. Half of Hypothesis's
# hundred examples, as `make test` has ten minutes; `make check` has two.
settings.register_profile("wavegym", deadline=None, max_examples=50)
settings.register_profile("check", deadline=None, max_examples=10)
settings.load_profile("wavegym")
TIERS = ("slow", "release")  # the marks of tests that `make check`, and those that `make test` leaves out
compiling = event.TimingListener()


def pytest_addoption(parser: pytest.Parser) -> None:
    """The option with which `make check` stays quick."""
    parser.addoption(
        "--unmarked-seconds",
        type=float,
        default=float("inf"),
        help="fail a test that takes more CPU time, kernels' compilation apart, and has no mark of a tier",
    )


def pytest_configure() -> None:
    """Collect garbage rarely: it takes 4 % of the time, because it walks through all objects of the kernels."""
    gc.set_threshold(50_000)
    event.register("numba:compile", compiling)


def cpu_seconds() -> float:
    """CPU time of this process and of those that it started and that have ended, without compilation."""
    used, compiled = os.times(), compiling.duration if compiling.done else 0.0
    return used.user + used.system + used.children_user + used.children_system - compiled


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Fail a test that is too long for a tier in which it is not marked."""
    most, begun = item.config.getoption("--unmarked-seconds"), cpu_seconds()
    result = yield
    spent = cpu_seconds() - begun
    if spent > most and not any(map(item.get_closest_marker, TIERS)):
        pytest.fail(f"took {spent:.1f} s without a mark, expected one of {', '.join(TIERS)} above {most:g} s")
    return result


def pytest_sessionfinish() -> None:
    """Exclude living objects, as pytest now collects garbage five times: a minute with all kernels in memory."""
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


@pytest.fixture(scope="module")
def delay_environment() -> Iterator[None]:
    """A small system with delays as the environment of a ladder."""
    from delay_systems import DelaySystem

    import wavegym

    wavegym.register("tests/Delay-v0", DelaySystem, horizon=6)
    yield
    gym.registry.pop("tests/Delay-v0")


@pytest.fixture(scope="session")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of one PPO and one DQN run that nothing has interrupted, trained once for all tests."""
    from runs_for_tests import EVERY, small_run

    from wavegym.learning.train import train

    folders = {algo: tmp_path_factory.mktemp("unbroken") / algo for algo in ("ppo", "dqn")}
    for algo, folder in folders.items():
        train(small_run(algo), folder, EVERY[algo], progress=False)
    return folders
