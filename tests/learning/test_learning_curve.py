from __future__ import annotations

import csv
import io

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wavegym.learning.curve import LearningCurve


@given(seed=st.integers(0, 2**32 - 1), num_envs=st.integers(1, 4), length=st.integers(1, 40))
def test_rows_hold_the_mean_of_the_episodes_mean_costs(seed: int, num_envs: int, length: int) -> None:
    rng = np.random.default_rng(seed)
    costs, ends = rng.exponential(size=(length, num_envs)), rng.random((length, num_envs)) < 0.3
    curve = LearningCurve(num_envs, 100)
    for cost, ended in zip(costs, ends, strict=True):
        curve.add(cost, ended)
    curve.close_row(length, 1)

    expected = []  # by hand, environment by environment
    for i in range(num_envs):
        episode: list[float] = []
        for t in range(length):
            episode.append(costs[t, i])
            if ends[t, i]:
                expected.append(sum(episode) / len(episode))
                episode = []
    if not expected:
        assert curve.rows == []
        return
    (row,) = curve.rows
    assert (row.steps, row.episodes) == (length, len(expected))
    assert np.isclose(row.cost, sum(expected) / len(expected), rtol=1e-13)


def test_rows_keep_their_distance_and_read_back_exactly() -> None:
    curve = LearningCurve(2, 100)
    for steps in range(2, 21, 2):
        curve.add(np.array([1.0, steps / 3]), np.array([True, False]) if steps % 4 else np.array([True, True]))
        curve.close_row(steps, 5)
    assert [row.steps for row in curve.rows] == [6, 12, 18]
    rows = list(csv.DictReader(io.StringIO(curve.csv())))
    assert [(int(r["steps"]), int(r["episodes"]), float(r["cost"])) for r in rows] == [tuple(row) for row in curve.rows]
    curve.close_row(100, 5)
    curve.close_row(200, 5)
    assert [row.steps for row in curve.rows] == [6, 12, 18, 100], "no row without an episode"
