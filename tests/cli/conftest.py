from __future__ import annotations

import pytest


@pytest.fixture(scope="session", autouse=True)
def registered(own_environments):
    """Every test here may play the small systems."""
