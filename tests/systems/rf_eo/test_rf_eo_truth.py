"""RfEo in a world that differs from what tracker and schedulers assume."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracles
import pytest

from wavegym.systems.rf_eo.system import RfEo

OTHER: dict[str, Any] = {"q": 4.0, "turn_rate": 0.05, "fft_length": 32, "pixels": 500, "nearest_range": 20.0}


def at_random(system, worlds, steps):
    """States under drawn choices from the box."""
    rng, state, states = np.random.default_rng(0), system.initial(worlds), []
    for _ in range(steps):
        action = rng.uniform(-1, 1, (len(worlds.start), len(system.actions)))
        state = system.transition(state, action, worlds)
        states.append(state)
    return states


def test_the_tracker_is_not_told():
    """After one linearisation at the same estimate the covariance is that of the tracker's own numbers."""
    settings: dict[str, Any] = {"horizon": 1, "iterations": 1}
    own, told = RfEo(**settings), RfEo(**settings, truth=OTHER)
    worlds = oracles.worlds(own, 40)
    (one,), (other,) = at_random(own, worlds, 1), at_random(told, worlds, 1)
    alike = one.truth.received == other.truth.received
    np.testing.assert_array_equal(one.belief.covariance[alike], other.belief.covariance[alike])
    assert alike.mean() > 0.5
    assert (one.truth.targets != other.truth.targets).any()


MISMATCHES: list[tuple[dict[str, Any], int]] = [  # and the steps after which it shows
    ({"q": 0.16}, 30),
    ({"turn_rate": 0.5}, 30),
    ({"fft_length": 16}, 30),
    ({"prior_variance": (9e4, 25.0, 9e4, 25.0)}, 1),
]


@pytest.mark.parametrize(("truth", "steps"), MISMATCHES)
def test_a_tracker_that_is_not_told_of_the_world_is_overconfident(truth, steps):
    """Mean NEES of 400 tracks; 5 standard errors of a consistent tracker's are .7."""
    nees, narrow = [], {"horizon": steps, "first_estimate": "drawn", "prior_variance": (1e4, 4.0, 1e4, 4.0)}
    for settings in (truth, {"truth": truth}):
        system = RfEo(**{**narrow, **settings})
        state = at_random(system, oracles.worlds(system, 200), steps)[-1]
        nees.append(system.state_info(state)["nees"].mean())
    assert abs(nees[0] - 4.0) < 0.7
    assert nees[1] > 4.7
