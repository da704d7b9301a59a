"""The rule by which targets are lost, against the normal distribution and a target told step by step."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from wavegym.core.track_loss import LOST_AFTER, NO_TRACK_YET, is_astray, steps_astray


@pytest.mark.parametrize("dimension", [1, 2, 4])
def test_one_true_state_in_a_thousand_is_outside_the_region_of_a_consistent_track(dimension):
    """Four standard errors of a share of 0.001 among 400,000; and the quantile itself."""
    nees = (np.random.default_rng(0).normal(size=(400_000, dimension)) ** 2).sum(axis=1)
    astray = is_astray(np.zeros(len(nees)), nees, 1.0, dimension)
    assert abs(astray.mean() - 1e-3) < 4 * np.sqrt(1e-3 / len(nees))
    edge = chi2.isf(1e-3, dimension)
    assert is_astray(np.zeros(2), edge * np.array([0.999, 1.001]), 1.0, dimension).tolist() == [False, True]


def test_a_target_is_astray_at_a_distance_whatever_its_track_believes():
    errors, nees = np.array([[9.99, 10.0, 0.0], [np.nan, 0.0, 0.0]]), np.array([[0.0, 0.0, 99.0], [0.0, np.nan, 1.0]])
    assert is_astray(errors, nees, 10.0, 4).tolist() == [[False, True, True], [True, True, False]]
    assert is_astray(errors, nees, 10.0, None).tolist() == [[False, True, False], [True, False, False]]


def told(astray, has_track):
    """The steps astray of one target, event by event."""
    count, had_track, found = 0, False, []
    for off, tracked in zip(astray, has_track, strict=True):
        had_track |= tracked
        if off and had_track:
            count += 1
        elif tracked:
            count = 0
        found.append(count if had_track else NO_TRACK_YET)
    return found


def test_steps_astray_are_counted_from_the_last_step_on_track():
    rng = np.random.default_rng(1)
    astray, has_track = rng.random((60, 50, 8)) < 0.6, rng.random((60, 50, 8)) < rng.random((50, 8))
    steps, found = np.full((50, 8), NO_TRACK_YET), []
    for off, tracked in zip(astray, has_track, strict=True):
        steps = steps_astray(steps, off, tracked)
        found.append(steps)
    for e, t in np.ndindex(50, 8):
        assert np.array(found)[:, e, t].tolist() == told(astray[:, e, t], has_track[:, e, t])
    assert np.max(found) > LOST_AFTER
