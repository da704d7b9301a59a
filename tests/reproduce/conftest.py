from __future__ import annotations

import pytest
from rf_eo_runs import RUNS, SEED, STEPS

from wavegym.reproduce.rf_eo import play
from wavegym.reproduce.rf_eo_numbers import summarise


@pytest.fixture(scope="session")
def platforms_study():
    """Every policy of both scenes, a few steps of a few worlds."""
    return play(RUNS, SEED, 1, 2, STEPS)


@pytest.fixture(scope="session")
def platforms_summary(platforms_study):
    """What its summary.json holds."""
    return summarise(platforms_study)
