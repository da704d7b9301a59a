from __future__ import annotations

import gymnasium as gym
import pytest
from evaluation_systems import Hopeless, Measured, Uneven

import wavegym


@pytest.fixture(scope="session", autouse=True)
def own_environments():
    """The small systems as registered environments, for these tests only."""
    own = {f"tests/{system.__name__}-v0": system for system in (Uneven, Measured, Hopeless)}
    for id, system in own.items():
        wavegym.register(id, system)
    yield
    for id in own:
        gym.registry.pop(id)
