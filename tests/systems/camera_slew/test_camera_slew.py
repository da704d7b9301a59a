"""The camera that has to turn: limits and blindness, windows, spreads, the filter, bad input."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import oracles
import pytest
from camera_episodes import SETTLES, azimuth, later, wrap
from gymnasium.utils.env_checker import check_env
from scipy.stats import kstest

from wavegym.core import trees
from wavegym.core.errors import InputError
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


def test_windows_are_observed():
    """Whether each target is in sight, and for how long, at most ten steps; no target is at the episode's end."""
    system = CameraSlew(horizon=30, windows=((0, 0, 3), (2, 25, 29)))
    state, worlds = later(system, 2, 0)
    names = [element.name for element in system.observation_fields]
    for k in range(31):
        observed = dict(zip(names, system.observe(state.belief)[0], strict=True))
        sight = [k < 30 and not (t == 0 and k <= 3) and not (t == 2 and k >= 25) for t in range(4)]
        changes = [4 - k if k <= 3 else min(30 - k, 10), min(30 - k, 10), min(25 - k, 10) if k < 25 else 10]
        assert [observed[f"visible_{t}"] for t in range(1, 5)] == sight
        if k < 30:
            assert [observed[f"changes_{t}"] for t in range(1, 4)] == changes
            state = system.transition(state, np.zeros(2, int), worlds)


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


def test_a_batch_is_its_elements():
    system = CameraSlew(horizon=25)
    state, worlds = later(system, 5, 25)
    for e in range(5):
        alone, rng = system.initial(oracles.rows(worlds, slice(e, e + 1))), np.random.default_rng(0)
        for _ in range(25):
            action = rng.integers(4, size=5)[e : e + 1]
            alone = system.transition(alone, action, oracles.rows(worlds, slice(e, e + 1)))
        trees.tree_map(lambda a, b, e=e: np.testing.assert_array_equal(a[0], b[e]), alone, state)
        np.testing.assert_array_equal(system.observe(alone.belief)[0], system.observe(state.belief)[e])


def test_registered():
    env = gym.make("wavegym/CameraSlew-v0", disable_env_checker=True, horizon=6)
    check_env(env.unwrapped, skip_render_check=True)
    single, batch = gym.make("wavegym/CameraSlew-v0", horizon=6), gym.make_vec("wavegym/CameraSlew-v0", 3, horizon=6)
    for k, one, _ in oracles.in_step(single, batch, 6):
        assert one[2:4] == (k == 6, False)


BAD = [
    ({"slew": 0.0}, "slew is 0.0 rad/s, expected a finite number > 0"),
    ({"slew": -1.0}, "slew is -1.0"),
    ({"slew": math.nan}, "slew is nan"),
    ({"settle": -1}, r"settle is -1, expected an integer >= 0 \(nearest: 0\)"),
    ({"settle": 1001}, "settle is 1001, .*nearest: 1000"),
    ({"half_field": 0.0}, "half_field is 0.0 rad"),
    ({"half_field": 2.0}, "half_field is 2.0 rad.*nearest: 1.5708"),
    ({"detection": 1.5}, "detection is 1.5, .*nearest: 1"),
    ({"horizon": 0}, "horizon is 0, .*nearest: 1"),
    ({"targets": 0}, "targets is 0, .*nearest: 1"),
    ({"sector": (1.0, -1.0)}, r"sector is \(1, -1\).*nearest: \(-1, 1\)"),
    ({"sector": (-4.0, 1.0)}, "sector.0 is -4.0 rad, expected .*nearest: -3.14159"),
    ({"ranges": (0.0, 1e3)}, "ranges.0 is 0.0 m, expected a finite number > 0"),
    ({"ranges": (2e3, 1e3)}, "ranges is"),
    ({"q": (0.0, 1.0)}, "q.0 is 0.0 m.2/s.3, expected a finite number > 0"),
    ({"q": (2.0, 1.0)}, r"q is \(2, 1\)"),
    ({"shown": (0, 4)}, "shown is 0 steps"),
    ({"hidden": (4, 2)}, "hidden is"),
    ({"windows": ((4, 0, 3),)}, r"target of hidden window \(4, 0, 3\) is 4.*nearest: 3"),
    ({"speed": -1.0}, "speed is -1.0"),
    ({"bandwidth": 0.0}, "bandwidth is 0.0 Hz"),
    ({"prf": 100.0}, "dwell of 128 pulses at 100 Hz"),
    ({"platforms": ()}, "number of platforms is 0"),
    ({"slw": 1.0}, "did you mean 'slew'"),
]


@pytest.mark.parametrize(("parameters", "words"), BAD)
def test_bad_input_is_refused_in_one_line(parameters, words):
    with pytest.raises(InputError, match=words) as caught:
        gym.make("wavegym/CameraSlew-v0", **parameters)
    assert "\n" not in str(caught.value)
