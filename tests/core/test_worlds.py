from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from evaluation_systems import Uneven
from hypothesis import given, settings
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.evaluation import draw_worlds, make_task, training_seeds, world_seeds

pytestmark = pytest.mark.usefixtures("own_environments")

seeds = st.integers(0, 2**40)


@settings(max_examples=20)
@given(first=seeds, second=st.integers(0, 1000))
def test_the_splits_never_share_a_seed(first, second):
    families = [world_seeds(first, split, 60) for split in ("train", "tune", "test")]
    families += [training_seeds(first, s, 64) for s in (second, second + 1)]
    everything = [seed for family in families for seed in family]
    assert len(set(everything)) == len(everything) == 3 * 60 + 2 * 64


@settings(max_examples=20)
@given(seed=seeds, count=st.integers(0, 30))
def test_a_world_does_not_depend_on_how_many_there_are(seed, count):
    assert world_seeds(seed, "test", count) == world_seeds(seed, "test", 40)[:count]


def test_seeds_are_those_of_the_published_rule_on_every_machine():
    crc32_of_test = 0xD87F7E0C  # the polynomial's well-known check value for "test"
    words = np.random.SeedSequence([5, crc32_of_test, 3]).generate_state(4)
    assert world_seeds(5, "test", 4)[3] == sum(int(w) << (32 * k) for k, w in enumerate(words))


@pytest.mark.parametrize("env_id", ["wavegym/KershawEvans-v0", "wavegym/KershawEvansPosition-v0", "tests/Uneven-v0"])
def test_drawn_worlds_are_those_of_the_environment(env_id):
    seeds = world_seeds(1, "test", 5)
    envs = gym.make_vec(env_id, num_envs=5)
    envs.reset(seed=seeds)
    drawn, shown = draw_worlds(make_task(env_id, {}).system, seeds), envs.unwrapped.world
    assert type(drawn) is type(shown)
    for one, other in zip(drawn, shown, strict=True):
        np.testing.assert_array_equal(one, other, strict=True)


def test_a_world_is_that_of_the_single_environment_too():
    seeds = world_seeds(2, "tune", 3)
    env = gym.make("tests/Uneven-v0")
    levels = [env.reset(seed=seed)[0][1] * 10.0 for seed in seeds]
    np.testing.assert_allclose(draw_worlds(Uneven(), seeds).level, levels, rtol=1e-6)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: world_seeds(0, "tests", 1), "split is 'tests'.*did you mean 'test'"),
        (lambda: world_seeds(-1, "test", 1), "seed is -1, expected an integer >= 0"),
        (lambda: world_seeds(0, "test", -5), "worlds is -5"),
        (lambda: training_seeds(0, -2, 4), "seed is -2"),
        (lambda: training_seeds(0, 1.5, 4), "seed is 1.5"),
    ],
)
def test_bad_seeds_are_named(call, words):
    with pytest.raises(InputError, match=words):
        call()
