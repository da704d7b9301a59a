"""The removal of impossible reports against a plain search, and its effort."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from wavegym.targets import reports
from wavegym.targets.reports import POSITION_TOLERANCE, flyable

LIMIT = 8.0


def suspicions(times, positions):
    if len(times) < 3:
        return np.zeros(0)
    h1, h2 = times[1:-1] - times[:-2], times[2:] - times[1:-1]
    weight = (h1 / (h1 + h2))[:, None]
    chord = (1 - weight) * positions[:-2] + weight * positions[2:]
    return np.linalg.norm(positions[1:-1] - chord, axis=1) / (POSITION_TOLERANCE + LIMIT * h1 * h2 / 2)


def searched(times, positions):
    """The rule as it is documented: all suspicions anew after every removal."""
    kept = np.arange(len(times))
    level = suspicions(times, positions)
    while len(level) and level.max() > 1:
        worst = int(level.argmax()) + 1
        left = {}
        for suspect in (worst, worst - 1, worst + 1):
            near = np.delete(kept[max(0, worst - 3) : worst + 4], suspect - max(0, worst - 3))
            remaining = suspicions(times[near], positions[near])
            left[suspect] = (int((remaining > 1).sum()), float(remaining.sum()))
        kept = np.delete(kept, min(left, key=left.__getitem__))
        level = suspicions(times[kept], positions[kept])
    return np.isin(np.arange(len(times)), kept)


@settings(max_examples=80, deadline=None)
@given(
    st.integers(1, 60),
    st.sampled_from([1.0, 100.0, 1000.0]),
    st.sampled_from([1.0, 300.0]),
    st.booleans(),
    st.integers(0, 2**32 - 1),
)
def test_the_removal_is_that_of_a_plain_search(count, step, noise, on_a_grid, seed):
    rng = np.random.default_rng(seed)
    times = 10.0 * np.arange(count) if on_a_grid else np.cumsum(rng.uniform(0.1, 20.0, count))
    positions = np.cumsum(rng.normal(0, step, (count, 3)), axis=0) + rng.normal(0, noise, (count, 3))
    if on_a_grid:
        positions = np.round(positions / 500.0) * 500.0  # equal suspicions
    np.testing.assert_array_equal(flyable(times, positions, LIMIT), searched(times, positions))


def test_the_effort_of_a_removal_does_not_grow_with_the_file(monkeypatch):
    calls = 0
    level = reports._Chain._level

    def counted(self, *three):
        nonlocal calls
        calls += 1
        return level(self, *three)

    monkeypatch.setattr(reports._Chain, "_level", counted)
    efforts = []
    for count in (500, 4000):
        rng, times = np.random.default_rng(2), 10.0 * np.arange(count)
        stamped = times - np.where(rng.random(count) < 0.05, 6.0, 0.0)
        positions = np.stack([200.0 * stamped, 0 * stamped, 0 * stamped], axis=1)
        calls = 0
        removed = int((~flyable(times, positions, LIMIT)).sum())
        efforts.append(calls / removed)
    assert max(efforts) < 30
    assert efforts[1] < 1.2 * efforts[0]
