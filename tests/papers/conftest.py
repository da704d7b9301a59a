from __future__ import annotations

import pytest
from small_studies import RF_EO_RUNS, RF_EO_SEED, RF_EO_STEPS, URBAN_RUNS, URBAN_SEED

from papers.rf_eo import numbers as rf_eo_numbers
from papers.rf_eo import study as rf_eo
from papers.urban import numbers as urban_numbers
from papers.urban import study as urban


@pytest.fixture(scope="session")
def rf_eo_study():
    """Every policy of both scenes, a few steps of a few worlds."""
    return rf_eo.play(RF_EO_RUNS, RF_EO_SEED, 1, tuning=2, horizon=RF_EO_STEPS)


@pytest.fixture(scope="session")
def rf_eo_summary(rf_eo_study):
    return rf_eo_numbers.summarise(rf_eo_study)


@pytest.fixture(scope="session")
def urban_study():
    """Every filter with every policy, whole episodes of a few worlds."""
    return urban.play(URBAN_RUNS, URBAN_SEED, 1)


@pytest.fixture(scope="session")
def urban_summary(urban_study):
    return urban_numbers.summarise(urban_study)
