"""The sizes of two small studies, each played once for all tests."""

from __future__ import annotations

RF_EO_RUNS, RF_EO_SEED, RF_EO_STEPS = 3, 3, 12
URBAN_RUNS, URBAN_SEED = 5, 3
