"""Checks of actions in compiled form, against the same in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.envs import action_kernels as kernels

EXTREME = np.iinfo(np.int64)


@pytest.mark.parametrize(
    ("actions", "inside"),
    [([0, 6], True), ([7, 0], False), ([3, -1], False), ([EXTREME.min, 0], False), ([0, EXTREME.max], False)],
)
def test_indices_lie_from_zero_to_the_last(actions, inside):
    assert kernels.are_indices(np.array(actions), 7) == inside


@given(st.integers(0, 2**32))
def test_the_first_forbidden_action_is_found(seed):
    rng = np.random.default_rng(seed)
    actions, mask, ignored = rng.integers(0, 3, 4), rng.random((4, 3)) < 0.8, rng.random(4) < 0.3
    for rows in (ignored, np.zeros(0, np.bool_)):
        wrong = ~mask[np.arange(4), actions] & ~(rows if len(rows) else np.zeros(4, np.bool_))
        assert kernels.first_forbidden(actions, mask, rows) == (wrong.argmax() if wrong.any() else -1)


@given(st.lists(st.floats(width=32), min_size=4, max_size=4))
def test_points_are_clipped_where_all_are_finite(values):
    given = np.array(values).reshape(2, 2)
    points, differs = given.copy(), np.empty(2, np.bool_)
    assert kernels.clip(points) == np.isfinite(given).all()
    if np.isfinite(given).all():
        np.testing.assert_array_equal(points, np.clip(given, -1.0, 1.0))
        kernels.differ(points, given, differs)
        np.testing.assert_array_equal(differs, (abs(given) > 1.0).any(axis=1))
