"""The camera that has to turn: limits and blindness, spreads."""

from __future__ import annotations

import math

import numpy as np
import oracles
import pytest
from camera_episodes import SETTLES, azimuth, later, wrap
from scipy.stats import kstest

from wavegym.core import trees
from wavegym.systems.camera_slew.system import CameraSlew


def limits_hold(system, count, seed=0):
    """Check every step of ``count`` episodes with drawn choices that last a few steps each.

    The camera turns at most ``slew``. After a turn of more than half a field it is blind until ``settle`` steps after
    its arrival. A target found was in the image of a settled camera.
    """
    rng, worlds = np.random.default_rng(seed), oracles.worlds(system, min(count, 50))
    worlds = trees.take(worlds, np.arange(count) % len(worlds.place))
    state, action = system.initial(worlds), rng.integers(system.targets, size=count)
    owed, found = np.zeros(count, int), 0
    for _ in range(system.horizon):
        action = np.where(rng.random(count) < 0.2, rng.integers(system.targets, size=count), action)
        before, state = state.belief, system.transition(state, action, worlds)
        after, truth = state.belief, state.truth
        aim = azimuth(system, before.mean)[np.arange(count), action]
        turned, wanted = wrap(after.pointing - before.pointing), wrap(aim - before.pointing)
        assert (np.abs(turned) <= system.slew * system.dt + 1e-12).all()
        np.testing.assert_allclose(turned, np.clip(wanted, -system.slew, system.slew), atol=1e-9)
        far = np.abs(wanted) > system.half_field
        blind = far | (owed > 0)
        owed = np.where(far, system.settle, np.maximum(owed - 1, 0))
        np.testing.assert_array_equal(after.settling, owed)
        assert not truth.seen[blind].any()
        x, y = system.platforms[0]
        true = np.arctan2(truth.targets[..., 0] - x, truth.targets[..., 2] - y)
        covered = ~before.visible[np.arange(count), before.step]
        assert not truth.seen[covered].any()
        outside = np.abs(wrap(true - after.pointing[:, None])) > system.half_field + 1e-12
        assert not truth.seen[outside].any()
        found += truth.seen.sum()
    assert found > 0.02 * count * system.horizon  # the camera finds targets at all


@pytest.mark.parametrize("settle", SETTLES)
def test_turning_keeps_its_limits(settle):
    limits_hold(CameraSlew(horizon=60, settle=settle), 100)


@pytest.mark.slow
def test_turning_keeps_its_limits_in_a_million_steps():
    limits_hold(CameraSlew(horizon=500), 2000, seed=1)


def test_spreads_observed_are_those_with_the_targets_own_noise():
    system = CameraSlew()
    belief = later(system, 3, 12)[0].belief
    names = [element.name for element in system.observation_fields]
    observed = dict(zip(names, system.observe(belief).T, strict=True))
    F, Q = system.motion.F, system.motion.Q
    for t in range(4):
        V = F @ belief.covariance[:, t] @ F.T + belief.q[:, t, None, None] * Q
        want = 0.5 * np.log10(V[:, 0, 0] + V[:, 2, 2])
        np.testing.assert_allclose(observed[f"log10_sigma_position_{t + 1}"], want, rtol=1e-9)
        np.testing.assert_allclose(observed[f"log10_q_{t + 1}"], np.log10(belief.q[:, t]))


def test_noise_densities_are_log_uniform():
    """Kolmogorov-Smirnov at a level of 0.1 %."""
    q = later(CameraSlew(horizon=3), 500, 0)[0].belief.q
    assert kstest(np.log(q / 0.02).ravel() / math.log(100.0), "uniform").pvalue > 1e-3
