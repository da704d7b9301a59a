"""Simulated coverage accepts good intervals, and rejects intervals that depend on a rare world."""

from __future__ import annotations

import numpy as np
import pytest

from research.promises import coverage


@pytest.fixture(autouse=True)
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coverage, "DRAWS", 100)


@pytest.mark.slow
def test_intervals_of_lognormal_ratios_are_as_good_as_they_say() -> None:
    """A hundred draws of a share of 95 %: four standard deviations are 9 %."""
    rng = np.random.default_rng(0)
    others = np.exp(rng.standard_normal((1, 100)))
    share = coverage.covered(others * np.exp(0.2 * rng.standard_normal((1, 100))), others)
    assert (abs(share - 0.95) < 0.09).all()


@pytest.mark.slow
def test_a_rare_world_that_decides_is_found() -> None:
    """A draw of a hundred worlds misses one of them in 37 % of cases: (1 - 1/100)^100."""
    others = np.ones((1, 100))
    own = others.copy()
    own[0, 17] = 1e6
    percent, geometric = coverage.covered(own, others)
    assert max(percent, geometric) < 0.8
    assert coverage.said(percent).endswith("low")
    assert coverage.said(0.95) == "95.0 %"
    assert coverage.said(0.99).endswith("high")
