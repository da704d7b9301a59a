"""The metrics that evaluation reads of every environment of the suite."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.stats import chi2

from wavegym.envs.episodes import Episodes
from wavegym.envs.rewards import make_reward
from wavegym.evaluation import draw_worlds, make_task, world_seeds
from wavegym.registration import SYSTEMS
from wavegym.schedulers import RandomChoice
from wavegym.schedulers.rollout import allowed

URBAN = ("wavegym/Urban-v0", "wavegym/UrbanSignal-v0")  # their tracks belong to no target
SLOTS = ("wavegym/MultifunctionRadar-v1",)  # as do these; tests of its own


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


KEPT = tuple(f"wavegym/{name}-v0" for name in ("KershawEvans", "KershawEvansPosition", "SharedSpectrum"))  # never lost


@pytest.mark.parametrize("env_id", [env_id for env_id in SYSTEMS if env_id not in URBAN + SLOTS + KEPT])
def test_targets_are_astray_by_their_distance_or_by_the_region_of_their_track(env_id):
    """Estimates are moved by half to twice the distance at which targets are lost, or along their least variance."""
    system, state = later(env_id)
    episodes = Episodes(system, 4, make_reward("cost"))
    episodes.begin(np.ones(4, np.bool_))
    mean, P, rng = state.belief.mean, state.belief.covariance, np.random.default_rng(0)
    present = system.state_info(state).get("present", np.ones(mean.shape[:2], np.bool_))
    x, y = position_axes((mean - state.truth.targets)[present], system.state_info(state)["position_error"][present])
    far = state.truth.targets.copy()
    far[..., x] += system.lost_beyond * np.array([0.5, 0.99, 1.01, 2.0])[:, None]
    variance, axes = np.linalg.eigh(P)
    length = np.sqrt(variance[..., 0] * rng.choice([18.0, 19.0], P.shape[:2]))  # the edge of the region is at 18.47
    near = state.truth.targets + length[..., None] * axes[..., 0]
    for moved, wide in ((far, 1e12), (near, 1.0)):
        belief = state.belief._replace(mean=moved, covariance=wide * P)
        astray = episodes._figures(state._replace(belief=belief))["astray"]
        d = moved - state.truth.targets
        nees = (d * np.linalg.solve(wide * P, d[..., None])[..., 0]).sum(axis=-1)
        want = (np.hypot(d[..., x], d[..., y]) > system.lost_beyond) | (nees > chi2.isf(0.001, 4))
        np.testing.assert_array_equal(astray, want & present)
        assert 0 < (want & present).sum() < present.sum()


@pytest.mark.slow
def test_only_systems_that_lose_targets_report_losses():
    for env_id, keys in ((KEPT[0], set()), (URBAN[0], {"astray", "lost"}), (SLOTS[0], {"lost"})):
        episodes = Episodes(make_task(env_id, {}).system, 2, make_reward("cost"))
        episodes.begin(np.ones(2, np.bool_))
        assert {"astray", "lost"} & episodes.observe()[1].keys() == keys
