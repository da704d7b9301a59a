"""The metrics that evaluation reads of every environment of the suite."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from wavegym.evaluation import draw_worlds, make_task, world_seeds
from wavegym.registration import SYSTEMS
from wavegym.schedulers import RandomChoice
from wavegym.schedulers.rollout import allowed

URBAN = ("wavegym/Urban-v0", "wavegym/UrbanSignal-v0")  # their tracks belong to no target
SLOTS = ("wavegym/MultifunctionRadar-v0",)  # as do these; tests of its own


def later(env_id, steps=3):
    """A system, and a state some steps after the start of four worlds."""
    system = make_task(env_id, {}).system
    worlds, policy = draw_worlds(system, world_seeds(0, "tune", 4)), RandomChoice()
    state = system.initial(worlds)
    policy.begin(system, 4, np.random.default_rng(0))
    for _ in range(steps):
        state = system.transition(state, policy.act(state.belief, None, allowed(system, state.belief)), worlds)
    return system, state


def position_axes(error, distance):
    """The axes of the state that make up the distance, found by trying all."""
    axes = range(error.shape[-1])
    for some in [*combinations(axes, 1), *combinations(axes, 2)]:
        if np.allclose(np.sqrt((error[..., some] ** 2).sum(axis=-1)), distance, rtol=1e-9):
            return list(some)
    raise AssertionError("position_error is no distance in any two axes")


@pytest.mark.parametrize("env_id", [env_id for env_id in SYSTEMS if env_id not in URBAN + SLOTS])
def test_the_variance_of_the_position_is_that_of_the_axes_of_its_error(env_id):
    system, state = later(env_id)
    figures, P = system.state_info(state), state.belief.covariance
    error = state.belief.mean - state.truth.targets
    present = figures.get("present", np.ones(error.shape[:-1], np.bool_))
    axes = position_axes(error[present], figures["position_error"][present])
    want = np.diagonal(P, axis1=-2, axis2=-1)[..., axes].sum(axis=-1)
    np.testing.assert_allclose(figures["position_variance"], np.where(present, want, 0.0), rtol=1e-12)
    assert system.nees_dimension == 2 * len(axes)  # position and velocity
