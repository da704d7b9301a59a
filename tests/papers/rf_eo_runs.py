"""A small study of the RF/EO platforms, played once for all tests."""

from __future__ import annotations

RUNS, SEED, STEPS = 3, 3, 12
