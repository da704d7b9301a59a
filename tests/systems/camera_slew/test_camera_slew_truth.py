"""CameraSlew in a world that differs from what tracker and schedulers assume."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracles
import pytest
from camera_episodes import index_rule, play

from wavegym.systems.camera_slew.system import CameraSlew

OTHER: dict[str, Any] = {"q": (0.08, 8.0), "turn_rate": 0.05, "detection": 0.3, "fft_length": 32, "bandwidth": 1e6}


def test_the_tracker_is_not_told():
    """The first covariances are those of the tracker's own numbers; the second differ in what was detected alone."""
    own, told = (
        CameraSlew(horizon=2),
        CameraSlew(horizon=2, truth={**OTHER, "prior_variance": (900.0, 4.0, 900.0, 4.0)}),
    )
    worlds, action = oracles.worlds(own, 40), np.zeros(40, int)
    one, other = own.initial(worlds), told.initial(worlds)
    np.testing.assert_array_equal(one.belief.covariance, other.belief.covariance)
    assert np.abs(one.belief.mean - other.belief.mean).max() > 20
    other = other._replace(belief=one.belief)
    one, other = own.transition(one, action, worlds), told.transition(other, action, worlds)
    alike = one.truth.seen == other.truth.seen
    np.testing.assert_array_equal(
        one.belief.polar_covariance[alike][:, [0, 1]], other.belief.polar_covariance[alike][:, [0, 1]]
    )
    assert alike.mean() > 0.8
    assert (one.belief.mean != other.belief.mean).any(axis=2).all()


MISMATCHES: list[tuple[dict[str, Any], int]] = [  # and the steps after which it shows
    ({"q": (0.32, 32.0)}, 20),
    ({"turn_rate": 0.05}, 20),
    ({"fft_length": 16}, 20),
    ({"bandwidth": 2.5e5}, 20),
    ({"prior_variance": (900.0, 9.0, 900.0, 9.0)}, 2),
]


@pytest.mark.parametrize(("truth", "steps"), MISMATCHES)
def test_a_tracker_that_is_not_told_of_the_world_is_overconfident(truth, steps):
    """Mean NEES of 800 tracks; 5 standard errors of a consistent tracker's are .5."""
    nees = []
    for settings in (truth, {"truth": truth}):
        system = CameraSlew(horizon=steps, **settings)
        states, _ = play(system, oracles.worlds(system, 200), index_rule(system))
        nees.append(system.state_info(states[-1])["nees"].mean())
    assert abs(nees[0] - 4.0) < 0.5
    assert nees[1] > 5.0


def test_a_camera_that_finds_nothing_costs_more():
    costs = []
    for truth in (None, {"detection": 0.0}):
        system = CameraSlew(truth=truth)
        states, _ = play(system, oracles.worlds(system, 40), index_rule(system))
        costs.append(np.mean([system.cost(state.belief) for state in states]))
        assert any(state.truth.seen.any() for state in states) == (truth is None)
    assert costs[1] > 2 * costs[0]
