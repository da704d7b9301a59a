"""Seeds and generators, as Gymnasium means them."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

from wavegym.core.errors import InputError
from wavegym.envs import WaveformEnv, WaveformVectorEnv
from wavegym.envs.episodes import seed_list
from wavegym.systems.kershaw_evans.system import KershawEvansPosition
from wavegym.testing.lockstep import difference

ID = "wavegym/KershawEvansPosition-v0"
SYSTEM = KershawEvansPosition(horizon=5)


@pytest.mark.parametrize(
    ("seed", "want"),
    [
        (None, [None] * 3),
        (4, [4, 5, 6]),
        (np.int64(4), [4, 5, 6]),
        (np.array(4), [4, 5, 6]),
        ([7, None, np.uint8(1)], [7, None, 1]),
        (np.array([3, 2, 1]), [3, 2, 1]),
        ((0, 1, 2**80), [0, 1, 2**80]),
    ],
)
def test_what_counts_as_a_seed(seed, want):
    got = seed_list(seed, 3)
    assert got == want
    assert all(each is None or type(each) is int for each in got)


@pytest.mark.parametrize(
    ("seed", "named"),
    [
        (-1, "seed is -1, expected an integer >= 0"),
        (1.5, "seed is 1.5"),
        ("7", "seed is '7'"),
        (True, "seed is True"),
        ([1, 2, -3], "seed is -3"),
        ([1, 2, 3.0], "seed is 3.0"),
        (np.array([1.0, 2.0, 3.0]), "seed is 1.0"),
        ([1, 2], "seed has 2 entries, expected 3"),
    ],
)
def test_a_wrong_seed_changes_no_generator(seed, named):
    env, twin = (WaveformVectorEnv(SYSTEM, 3) for _ in range(2))
    for each in (env, twin):
        each.reset(seed=0)
    with pytest.raises(InputError, match=named):
        env.reset(seed=seed)
    assert difference(env.reset(), twin.reset()) is None


@pytest.mark.parametrize("seed", [-1, 0.5, "1"])
def test_the_single_environment_names_a_wrong_seed(seed):
    with pytest.raises(InputError, match=f"seed is {seed!r}, expected an integer >= 0"):
        WaveformEnv(SYSTEM).reset(seed=seed)


def test_generators_and_seeds_are_those_of_sync_vector_env():
    native = gym.make_vec(ID, 3)
    oracle = SyncVectorEnv([lambda: gym.make(ID)] * 3)
    for seed, mask in ((5, None), (None, None), ([8, None, 9], None), ([1, 2, 3], np.array([True, False, False]))):
        for env in (native, oracle):
            env.reset(seed=seed, options=None if mask is None else {"reset_mask": mask.copy()})
        assert native.unwrapped.np_random_seed == oracle.np_random_seed
        states = [[g.bit_generator.state for g in env.np_random] for env in (native.unwrapped, oracle)]
        assert states[0] == states[1]


def test_without_a_seed_there_is_one_by_chance_that_repeats_the_episode():
    env = WaveformVectorEnv(SYSTEM, 2)
    seeds = env.np_random_seed
    assert len(set(seeds)) == 2
    first, _ = env.reset()
    again, _ = WaveformVectorEnv(SYSTEM, 2).reset(seed=list(seeds))
    assert (first == again).all()


def test_the_single_environments_generator_can_be_replaced():
    env, other = WaveformEnv(SYSTEM), WaveformEnv(SYSTEM)
    env.reset(seed=3)
    assert env.np_random_seed == 3
    env.reset()
    assert env.np_random_seed == 3  # the last one given
    env.np_random = np.random.default_rng(11)
    assert env.np_random_seed == -1
    other.np_random = np.random.default_rng(11)
    assert (env.reset()[0] == other.reset()[0]).all()
    assert env.np_random is env.batch.episodes.generators[0]
