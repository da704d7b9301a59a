from __future__ import annotations

import pytest
from rf_eo_runs import RUNS, SEED, STEPS
from urban_runs import SEED as STREET_SEED
from urban_runs import STREETS

from wavegym.reproduce import rf_eo, rf_eo_numbers, urban, urban_numbers


@pytest.fixture(scope="session")
def platforms_study():
    """Every policy of both scenes, a few steps of a few worlds."""
    return rf_eo.play(RUNS, SEED, 1, 2, STEPS)


@pytest.fixture(scope="session")
def platforms_summary(platforms_study):
    """What its summary.json holds."""
    return rf_eo_numbers.summarise(platforms_study)


@pytest.fixture(scope="session")
def street_study():
    """Every filter with every policy, whole episodes of a few worlds."""
    return urban.play(STREETS, STREET_SEED, 1)


@pytest.fixture(scope="session")
def street_summary(street_study):
    """What its summary.json holds."""
    return urban_numbers.summarise(street_study)
