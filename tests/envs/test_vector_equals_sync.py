"""The native vector environment is Gymnasium's SyncVectorEnv over single environments, bit for bit."""

import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from small_systems import BRIEF, has_form

import wavegym
from wavegym.testing.lockstep import difference

POSITION = "wavegym/KershawEvansPosition-v0"
MODES = ["NextStep", "SameStep", "Disabled"]
SETTINGS = {
    "trace": {"reward": "trace"},
    "box, log-cost": {"reward": "log-cost", "action": "box", "start_covariance": "steady"},
    "relative": {"reward": "relative"},
    "acceleration, error": {"reward": "error", "model": "ca", "weights": (1, 0, 0), "prior_variance": (1e4, 1e4, 10)},
}
EPISODES = {1: 6, 3: 12, 17: 34}  # 52 for each mode and settings: 624 in all


def pair(num_envs, mode, **settings):
    native = gym.make_vec(POSITION, num_envs, autoreset_mode=mode, **settings)
    oracle = SyncVectorEnv([lambda: gym.make(POSITION, **settings)] * num_envs, autoreset_mode=mode)
    return native, oracle


def assert_same(got, want):
    wrong = difference(got, want)
    assert wrong is None, wrong


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("num_envs", EPISODES)
@pytest.mark.slow
def test_native_equals_sync_over_episodes_with_partial_resets(num_envs, mode, settings):
    native, oracle = pair(num_envs, mode, horizon=8, **settings)
    rng = np.random.default_rng(num_envs)
    native.action_space.seed(num_envs)
    assert_same(native.reset(seed=5), oracle.reset(seed=5))
    ended, episodes = np.zeros(num_envs, np.bool_), 0
    while episodes < EPISODES[num_envs]:
        mask = (rng.random(num_envs) < 0.5) & (rng.random() < 0.15) | (ended if mode == "Disabled" else False)
        if mask.any():
            seeds = [None if s < 50 else int(s) for s in rng.integers(100, size=num_envs)]
            got = native.reset(seed=seeds, options={"reset_mask": mask})
            assert_same(got, oracle.reset(seed=seeds, options={"reset_mask": mask.copy()}))
        actions = native.action_space.sample()
        got, want = native.step(actions), oracle.step(actions)
        assert_same(got, want)
        ended = got[2] | got[3]
        episodes += int(ended.sum())
    assert ended.any()


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("limit", [1, 5, 8])
def test_max_episode_steps_truncates_as_timelimit_does(mode, limit):
    native, oracle = pair(3, mode, horizon=8, max_episode_steps=limit)
    native.action_space.seed(0)
    assert_same(native.reset(seed=1), oracle.reset(seed=1))
    cut = terminated = 0
    for _ in range(3 * limit):
        actions = native.action_space.sample()
        got = native.step(actions)
        assert_same(got, oracle.step(actions))
        cut, terminated = cut + got[3].sum(), terminated + got[2].sum()
        if mode == "Disabled" and got[3].any():
            assert_same(native.reset(), oracle.reset())
    assert cut >= 3
    assert (terminated > 0) == (limit == 8)  # the horizon's end is a termination, and then both are set


def test_worlds_depend_on_seed_and_episode_only():
    lone = gym.make(POSITION).unwrapped
    many = gym.make_vec(POSITION, 3)
    observations, _ = many.reset(seed=[4, None, 7])
    alone, _ = lone.reset(seed=7)
    assert_same(alone, observations[2])
    second, _ = many.reset(options={"reset_mask": np.array([False, False, True])})
    assert_same(lone.reset()[0], second[2])
    assert_same(lone.np_random.random(3), many.unwrapped.episodes.generators[2].random(3))


def test_a_pickled_copy_goes_on_identically():
    for env in (gym.make(POSITION, reward="relative"), gym.make_vec(POSITION, 3, reward="relative")):
        env.action_space.seed(0)
        env.reset(seed=3)
        for _ in range(20):
            env.step(env.action_space.sample())
        copy = pickle.loads(pickle.dumps(env))
        for _ in range(40):
            actions = env.action_space.sample()
            result = env.step(actions)
            assert_same(copy.step(actions), result)
            if np.shape(result[2]) == () and result[2]:
                assert_same(copy.reset(), env.reset())


@pytest.mark.parametrize("id", wavegym.list_envs())
def test_specifications_survive_json(id):
    for env in (gym.make(id, dt=0.5), gym.make_vec(id, 3, dt=0.5, autoreset_mode="SameStep")):
        again = gym.envs.registration.EnvSpec.from_json(env.spec.to_json())
        assert again.id == id
        assert again.kwargs["dt"] == 0.5
    remade = gym.make_vec(again)
    assert remade.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert remade.num_envs == 3


@pytest.mark.parametrize("id", wavegym.list_envs())
@pytest.mark.slow
def test_both_environment_checkers_pass_without_a_warning(id):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(id, render_mode="rgb_array", horizon=16).unwrapped, skip_render_check=False)
        checker.check_env(gym.make(id), warn=True)
        if has_form(id, "box"):
            checker.check_env(gym.make(id, action="box"), warn=True)


@pytest.mark.parametrize("id", wavegym.list_envs())
def test_a_whole_episode_stays_inside_the_spaces(id):
    env = gym.make_vec(id, 8, autoreset_mode="Disabled", **BRIEF.get(id, {}))
    env.action_space.seed(1)
    observations, _ = env.reset(seed=1)
    system = env.unwrapped.system
    for k in range(1, system.horizon + 1):
        assert env.observation_space.contains(observations)
        observations, rewards, terminated, truncated, info = env.step(env.action_space.sample())
        assert rewards.dtype == np.float64
        assert (rewards == -info["cost"]).all()
        assert not info["saturated"].any()
        over, other = (terminated, truncated) if system.terminates else (truncated, terminated)
        assert not other.any()
        assert (over == (k == system.horizon)).all()
