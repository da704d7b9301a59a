"""The example package works like a user's own package: on the path, not part of wavegym."""

from __future__ import annotations

import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import wavegym
from wavegym.testing import check_vector_env

EXAMPLE = Path(__file__).parents[1] / "examples" / "own_environment"
IDS = ["own/ShipRadar-v0", "own/ScalarDwell-v0"]


@pytest.fixture(scope="module", autouse=True)
def _installed():
    sys.path.insert(0, str(EXAMPLE))
    import own_environment  # noqa: F401

    yield
    sys.path.remove(str(EXAMPLE))
    for id in IDS:
        gym.registry.pop(id)


@pytest.mark.slow
@pytest.mark.parametrize("id", IDS)
def test_registered_environments_conform(id):
    assert id in wavegym.list_envs()
    check_vector_env(id)


def test_registration_takes_ten_lines():
    code = (EXAMPLE / "own_environment" / "__init__.py").read_text().splitlines()
    statements = [line for line in code if line.strip() and not line.startswith('"""')]
    assert len(statements) <= 12


def test_plain_numpy_system_is_what_it_says():
    """Steady state of a scalar Kalman filter, from its Riccati equation."""
    envs = gym.make_vec("own/ScalarDwell-v0", num_envs=2, horizon=200)
    envs.reset(seed=0)
    for _ in range(150):
        *_, info = envs.step(np.array([1, 1]))
    q = r = 1.0
    predicted = (q + np.sqrt(q * q + 4 * q * r)) / 2  # p = p r / (p + r) + q
    np.testing.assert_allclose(info["cost"], predicted * r / (predicted + r) + 0.1, rtol=1e-12)
