"""The camera that has to turn: limits and blindness, one step in plain NumPy, foresight against what comes."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import oracles
import pytest
import rf_eo_oracle as plain
from gymnasium.utils.env_checker import check_env
from scipy.stats import kstest

from wavegym.errors import InputError
from wavegym.systems import trees
from wavegym.systems.planning.camera_slew import CameraSlew

SETTLES = (0, 1, 3)
OPEN: dict = {"shown": (10_000, 10_000), "hidden": (0, 0)}  # nothing hides


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def azimuth(system, mean):
    """Of every target one step ahead, from the camera, (env, target)."""
    x = mean @ system.transition.T
    return np.arctan2(x[..., 0] - system.platforms[0][0], x[..., 2] - system.platforms[0][1])


def later(system, count, steps, seed=0):
    """A batch some drawn choices on, and its tapes."""
    worlds, rng = oracles.worlds(system, count), np.random.default_rng(seed)
    state = system.begin(worlds)
    for _ in range(steps):
        state = system.advance(state, rng.integers(system.targets, size=count), worlds)
    return state, worlds


def limits_hold(system, count, seed=0):
    """Every step of ``count`` episodes of drawn choices that last a few steps each.

    The camera turns no farther than it may; whoever turns by more than half a field is blind until ``settle`` steps
    after it has arrived; what is found was in the image of a settled camera.
    """
    rng, worlds = np.random.default_rng(seed), oracles.worlds(system, min(count, 50))
    worlds = trees.take(worlds, np.arange(count) % len(worlds.place))
    state, action = system.begin(worlds), rng.integers(system.targets, size=count)
    owed, found = np.zeros(count, int), 0
    for _ in range(system.horizon):
        action = np.where(rng.random(count) < 0.2, rng.integers(system.targets, size=count), action)
        before, state = state.public, system.advance(state, action, worlds)
        after, hidden = state.public, state.hidden
        aim = azimuth(system, before.mean)[np.arange(count), action]
        turned, wanted = wrap(after.pointing - before.pointing), wrap(aim - before.pointing)
        assert (np.abs(turned) <= system.slew * system.dt + 1e-12).all()
        np.testing.assert_allclose(turned, np.clip(wanted, -system.slew, system.slew), atol=1e-9)
        far = np.abs(wanted) > system.half_field
        blind = far | (owed > 0)
        owed = np.where(far, system.settle, np.maximum(owed - 1, 0))
        np.testing.assert_array_equal(after.settling, owed)
        assert not hidden.seen[blind].any()
        x, y = system.platforms[0]
        true = np.arctan2(hidden.truth[..., 0] - x, hidden.truth[..., 2] - y)
        covered = ~before.visible[np.arange(count), before.step]
        assert not hidden.seen[covered].any()
        outside = np.abs(wrap(true - after.pointing[:, None])) > system.half_field + 1e-12
        assert not hidden.seen[outside].any()
        found += hidden.seen.sum()
    assert found > 0.02 * count * system.horizon  # it does see


@pytest.mark.parametrize("settle", SETTLES)
def test_turning_keeps_its_limits(settle):
    limits_hold(CameraSlew(horizon=60, settle=settle), 100)


@pytest.mark.slow
def test_turning_keeps_its_limits_in_a_million_steps():
    limits_hold(CameraSlew(horizon=500), 2000, seed=1)


def one_step(system, mean, P, pointing, settling, q, visible, action, seen):
    """Mean, covariance and camera one step on, foreseen; ``seen``: whether a target in the image is found.

    q, visible (t,): noise densities, and whose line of sight is free in this step.
    """
    F = system.motion.F
    aim = azimuth(system, mean)
    off = wrap(aim[action] - pointing)
    pointing = wrap(pointing + np.clip(off, -system.slew * system.dt, system.slew * system.dt))
    far = abs(off) > system.half_field
    sees, settling = not far and settling == 0, system.settle if far else max(settling - 1, 0)
    angle = 2 * system.half_field / system.pixels
    R = plain.plain_variances(system, (system.prf, system.bandwidth, angle))
    out = []
    for t in range(system.targets):
        x, V = F @ mean[t], F @ P[t] @ F.T + q[t] * system.motion.Q
        rows, noise = [], []
        for j in range(len(system.platforms)):
            H = plain.jacobian(system.loop, x, j)
            camera = bool(j == 0 and visible[t] and sees and seen and abs(wrap(aim[t] - pointing)) <= system.half_field)
            rows += [H[0], H[1]] + [H[2]] * camera
            noise += [R[0], R[1]] + [R[2]] * camera
        H = np.array(rows)
        K = V @ H.T @ np.linalg.inv(H @ V @ H.T + np.diag(noise))
        A = np.eye(4) - K @ H
        out.append(A @ V @ A.T + K @ np.diag(noise) @ K.T)
    return np.array([F @ m for m in mean]), np.array(out), pointing, settling


def test_one_step_is_that_of_plain_numpy():
    """Foreseen means, covariances (to what inverting them in double precision leaves) and the camera."""
    system = CameraSlew(horizon=30)
    state, worlds = later(system, 6, 3)
    for _ in range(20):  # until the cameras follow a target each
        state = system.advance(state, np.arange(6) % 4, worlds)
    some = 0
    for e in range(6):
        public = oracles.rows(state.public, slice(e, e + 1))
        for action in range(4):
            for draw in (0.0, 1.0):
                told = system.imagine(public, np.array([action]), np.full((1, 4), draw))
                x, P, pointing, settling = one_step(
                    system, public.mean[0], public.covariance[0], public.pointing[0], public.settling[0],
                    public.q[0], public.visible[0, public.step[0]], action, draw < system.detection
                )  # fmt: skip
                np.testing.assert_allclose(told.mean[0], x, rtol=1e-12, atol=1e-9)
                np.testing.assert_allclose(told.covariance[0], P, rtol=1e-6, atol=1e-8)
                np.testing.assert_allclose(told.pointing[0], pointing, atol=1e-12)
                assert (told.settling[0], told.step[0]) == (settling, public.step[0] + 1)
            found = system.imagine(public, np.array([action]), np.zeros((1, 4)))
            some += not np.array_equal(found.covariance, told.covariance)
    assert some >= 6  # looks that found something, and others


def test_a_given_outcome_is_what_comes():
    """Where the truth is on the same side of every field of view as the prediction, which is known by what was found.

    The filter linearises once, at the prediction. What is left out is a target at the image's very edge.
    """
    system = CameraSlew(
        horizon=80, iterations=1, platforms=((-1e3, 0.0), (1e3, 0.0)), bandwidth=20e6, half_field=0.05, settle=1,
        detection=0.9, q=(0.02, 0.1), shown=(10, 20)
    )  # fmt: skip
    state, worlds = later(system, 40, 0)
    rng, action, agreed, found = np.random.default_rng(2), np.zeros(40, int), 0, 0
    for k in range(80):
        action = np.where(rng.random(40) < 0.15, rng.integers(4, size=40), action)
        told = system.imagine(state.public, action, worlds.found[:, k])
        if k % 2:  # also among several candidates
            every = system.imagine(state.public, np.arange(4)[None], worlds.found[:, None, k])
            one = type(told)(*(part[np.arange(40), action] for part in every))
            trees.tree_map(np.testing.assert_array_equal, one, told)
        true = np.arctan2(state.hidden.truth[..., 0] + 1e3, state.hidden.truth[..., 2])
        state = system.advance(state, action, worlds)
        edge = np.abs(np.abs(wrap(true - told.pointing[:, None])) - system.half_field)
        clear = (edge > 0.02).all(axis=1)
        for name in ("covariance", "pointing", "settling", "step"):
            np.testing.assert_allclose(
                getattr(told, name)[clear], getattr(state.public, name)[clear], rtol=1e-9, atol=1e-8
            )
        agreed, found = agreed + clear.sum(), found + state.hidden.seen[clear].sum()
    assert agreed > 2000
    assert found > 300


def test_the_expected_outcome_is_the_mean():
    """Over detections, to five standard errors of 4000 draws, and far from what is foreseen without any."""
    system, count = CameraSlew(horizon=60, iterations=1, detection=0.6, **OPEN), 4000
    state, worlds = later(system, 1, 5)
    for _ in range(20):  # until the camera is there
        state = system.advance(state, np.array([2]), worlds)
    several = trees.take(state, np.zeros(count, int))
    tapes = trees.take(worlds, np.zeros(count, int))
    tapes.found[:] = np.random.default_rng(5).random(tapes.found.shape)
    action = np.full(count, 2)
    came = system.cost(system.advance(several, action, tapes).public)
    expected = system.cost(system.imagine(state.public, np.array([2])))[0]
    nothing = system.cost(system.imagine(state.public, np.array([2]), np.ones((1, 4))))[0]
    error = 5 * came.std() / math.sqrt(count)
    assert error > 0
    assert abs(came.mean() - expected) < error
    assert nothing - expected > 3 * error


@pytest.mark.parametrize("settle", SETTLES)
def test_the_delay_is_how_long_it_takes(settle):
    """Targets that do not move: the first step in which a look can do something, found by turning."""
    system = CameraSlew(
        horizon=60, q=(1e-12, 1e-12), speed=0.0, prior_variance=(1e-2, 1e-9, 1e-2, 1e-9), settle=settle, **OPEN
    )
    state, _ = later(system, 20, 3)
    for target in range(4):
        wanted, public = system.delay(state.public)[:, target], state.public
        seen = np.full(20, -1)
        for k in range(40):
            action = np.full(20, target)
            one, other = (system.imagine(public, action, np.full((20, 4), draw)) for draw in (0.0, 1.0))
            now = (one.covariance[:, target] != other.covariance[:, target]).any(axis=(1, 2))
            seen = np.where((seen < 0) & now, k, seen)
            public = other
        np.testing.assert_array_equal(seen, wanted)


def test_the_gain_at_once_is_the_difference_that_a_look_makes():
    """trace(M (P without - P with)), M summed by hand; also at the episode's end, beyond which there is nothing."""
    system = CameraSlew(horizon=40, **OPEN)
    state, worlds = later(system, 8, 10)
    for _ in range(28):
        state = system.advance(state, np.zeros(8, int), worlds)
        gain = system.gain(state.public, 0, 5)[:, 0]
        one, other = (system.imagine(state.public, np.zeros(8, int), np.full((8, 4), draw)) for draw in (0.0, 1.0))
        left, F = min(5, 40 - int(state.public.step[0])), system.transition
        D, want = other.covariance - one.covariance, 0.0
        for _ in range(left):
            want, D = want + np.einsum("etii->e", D), F @ D @ F.T
        looks = system.delay(state.public)[:, 0] == 0
        np.testing.assert_allclose(gain[looks], system.detection * want[looks], rtol=1e-6)
    assert looks.all()
    assert (system.gain(state.public, 2, 5) == 0).all()
    assert (system.gain(state.public, 1, 5) > 0).all()


def test_a_gain_needs_sight_and_a_delay_waits_for_it():
    system = CameraSlew(horizon=30, windows=((0, 0, 9), (2, 20, 29)), half_field=1.5, settle=0)
    public = later(system, 4, 0)[0].public
    assert (system.delay(public)[:, 0] == 10).all()  # out of cover by step 10
    assert (system.delay(public)[:, 1] <= 1).all()
    narrow = CameraSlew(horizon=30, windows=((0, 0, 9), (2, 20, 29)), half_field=1e-6)
    for wait, hidden in ((9, [True, False, False, False]), (10, [False] * 4), (20, [False, False, True, False])):
        np.testing.assert_array_equal(narrow.gain(public, wait, 5) == 0, [hidden] * 4)


def test_windows_are_observed():
    """Whether each target is in sight now, and for how long, at most ten steps; nothing is at the episode's end."""
    system = CameraSlew(horizon=30, windows=((0, 0, 3), (2, 25, 29)))
    state, worlds = later(system, 2, 0)
    names = [element.name for element in system.elements]
    for k in range(31):
        told = dict(zip(names, system.observe(state.public)[0], strict=True))
        sight = [k < 30 and not (t == 0 and k <= 3) and not (t == 2 and k >= 25) for t in range(4)]
        changes = [4 - k if k <= 3 else min(30 - k, 10), min(30 - k, 10), min(25 - k, 10) if k < 25 else 10]
        assert [told[f"visible_{t}"] for t in range(1, 5)] == sight
        if k < 30:
            assert [told[f"changes_{t}"] for t in range(1, 4)] == changes
            state = system.advance(state, np.zeros(2, int), worlds)


def test_spreads_observed_are_those_with_the_targets_own_noise():
    system = CameraSlew()
    public = later(system, 3, 12)[0].public
    names = [element.name for element in system.elements]
    told = dict(zip(names, system.observe(public).T, strict=True))
    F, Q = system.motion.F, system.motion.Q
    for t in range(4):
        V = F @ public.covariance[:, t] @ F.T + public.q[:, t, None, None] * Q
        want = 0.5 * np.log10(V[:, 0, 0] + V[:, 2, 2])
        np.testing.assert_allclose(told[f"log10_sigma_position_{t + 1}"], want, rtol=1e-9)
        np.testing.assert_allclose(told[f"log10_q_{t + 1}"], np.log10(public.q[:, t]))


def test_noise_densities_are_log_uniform():
    """Kolmogorov-Smirnov at a level of 0.1 %."""
    q = later(CameraSlew(horizon=3), 500, 0)[0].public.q
    assert kstest(np.log(q / 0.02).ravel() / math.log(100.0), "uniform").pvalue > 1e-3


def test_a_batch_is_its_elements():
    system = CameraSlew(horizon=25)
    state, worlds = later(system, 5, 25)
    for e in range(5):
        alone, rng = system.begin(oracles.rows(worlds, slice(e, e + 1))), np.random.default_rng(0)
        for _ in range(25):
            action = rng.integers(4, size=5)[e : e + 1]
            alone = system.advance(alone, action, oracles.rows(worlds, slice(e, e + 1)))
        trees.tree_map(lambda a, b, e=e: np.testing.assert_array_equal(a[0], b[e]), alone, state)
        np.testing.assert_array_equal(system.observe(alone.public)[0], system.observe(state.public)[e])


def test_the_filter_is_consistent():
    """NEES of 4 within the scatter of 200 worlds, where the camera goes where it gains: range alone bends too much."""
    system = CameraSlew()
    worlds = oracles.worlds(system, 200)
    state = system.begin(worlds)
    for _ in range(50):
        wait = system.delay(state.public)
        index = system.gain(state.public, wait, 14) / (1.0 + 2.0 * wait)
        state = system.advance(state, index.argmax(axis=1), worlds)
    assert 3.5 < system.metrics(state)["nees"].mean() < 4.7


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
    ({"settle": -1}, r"settle is -1 steps, expected a number in \[0, 1000\] \(nearest: 0\)"),
    ({"settle": 1001}, "settle is 1001 .*nearest: 1000"),
    ({"half_field": 0.0}, "half_field is 0.0 rad"),
    ({"half_field": 2.0}, "half_field is 2.0 rad.*nearest: 1.5708"),
    ({"detection": 1.5}, "detection is 1.5, .*nearest: 1"),
    ({"horizon": 0}, "horizon is 0, .*nearest: 1"),
    ({"targets": 0}, "targets is 0, .*nearest: 1"),
    ({"sector": (1.0, -1.0)}, r"sector is \(1, -1\).*nearest: \(-1, 1\)"),
    ({"sector": (-4.0, 1.0)}, "azimuth in sector is -4.0 rad"),
    ({"ranges": (0.0, 1e3)}, "least of ranges is 0.0 m"),
    ({"ranges": (2e3, 1e3)}, "ranges is"),
    ({"q": (0.0, 1.0)}, "low of q is 0.0"),
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


def test_a_gain_over_no_step_is_refused():
    state, _ = later(CameraSlew(horizon=3), 1, 0)
    with pytest.raises(InputError, match="ahead is 0, expected an integer >= 1"):
        CameraSlew(horizon=3).gain(state.public, 0, 0)
