"""RfEo in a world that differs from what tracker and schedulers assume, and a step in its parts."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import oracles
import pytest

from wavegym.core import trees
from wavegym.core.errors import InputError
from wavegym.envs.vector import WaveformVectorEnv
from wavegym.systems.rf_eo.system import RfEo, RfEoFar
from wavegym.testing.shortcut_check import shortcut_defect

OTHER: dict[str, Any] = {"q": 4.0, "turn_rate": 0.05, "fft_length": 32, "pixels": 500, "nearest_range": 20.0}
OTHER_RADAR: dict[str, Any] = {**OTHER, "duty": 0.2, "notch": 5.0}


def same(one, other):
    trees.tree_map(np.testing.assert_array_equal, one, other)


def at_random(system, worlds, steps):
    """States under drawn choices from the box."""
    rng, state, states = np.random.default_rng(0), system.initial(worlds), []
    for _ in range(steps):
        action = rng.uniform(-1, 1, (len(worlds.start), len(system.actions)))
        state = system.transition(state, action, worlds)
        states.append(state)
    return states


@pytest.mark.parametrize("truth", [None, OTHER_RADAR])
@pytest.mark.parametrize("mode", ["missing", "inflated"])
@pytest.mark.parametrize("cls", [RfEo, RfEoFar])
def test_a_compiled_step_is_that_of_its_parts(cls, mode, truth):
    """Bit for bit, thirty steps."""
    system = cls(out_of_view=mode, truth=truth, horizon=30, folding=cls is RfEoFar and mode == "missing")
    worlds, rng = oracles.worlds(system, 5), np.random.default_rng(0)
    fused = composed = system.initial(worlds)
    for _ in range(30):
        action = rng.uniform(-1, 1, (5, len(system.actions)))
        fused, composed = system.transition(fused, action, worlds), system.composed_transition(composed, action, worlds)
        same(fused, composed)


def test_the_shortcuts_hold_in_another_world():
    assert shortcut_defect(RfEo(horizon=12, truth=OTHER, action="library", points=(2, 1, 2))) is None


def test_a_truth_equal_to_the_assumptions_changes_nothing():
    own = RfEo(horizon=20)
    told = RfEo(horizon=20, truth={name: getattr(own, name) for name in OTHER})
    worlds = oracles.worlds(own, 4)
    for one, other in zip(at_random(own, worlds, 20), at_random(told, worlds, 20), strict=True):
        same(one, other)


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


def test_what_the_world_may_not_differ_in_is_refused():
    allowed = "q, turn_rate, fft_length, pixels, prior_variance, nearest_range"
    with pytest.raises(InputError, match=f"truth has 'pixel_angle', expected one of {allowed}"):
        gym.make("wavegym/RfEo-v0", truth={"pixel_angle": (1e-5, 1e-3)})


def test_the_info_of_a_step_holds_the_measurements():
    env = WaveformVectorEnv(RfEo, 2, measurements=True)
    env.reset(seed=1)
    info = env.step(np.zeros((2, 6)))[-1]
    assert info["measured_z"].shape == info["measured_variance"].shape == (2, 2, 6)
    assert (np.isfinite(info["measured_variance"]).sum(axis=2) == info["received"]).all()
