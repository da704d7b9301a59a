"""Environments registered by users."""

import gymnasium as gym
import numpy as np
import pytest

import wavegym
from wavegym.core.errors import InputError

ID = "tests/CutOff-v0"


@pytest.fixture
def cut_off():
    wavegym.register(ID, "wavegym.systems.kershaw_evans.system:KershawEvansPosition", max_episode_steps=5, horizon=9)
    yield
    del gym.registry[ID]


def length(env):
    """Steps to the end of the first episode, and whether it was truncated."""
    env.action_space.seed(0)
    env.reset(seed=0)
    for k in range(1, 20):
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        if np.any(terminated | truncated):
            return k, bool(np.all(truncated))
    return None


@pytest.mark.usefixtures("cut_off")
@pytest.mark.parametrize(
    ("override", "want"), [({}, (5, True)), ({"max_episode_steps": 3}, (3, True)), ({"q": 2.0}, (5, True))]
)
def test_a_registered_time_limit_holds_until_it_is_overridden(override, want):
    assert length(gym.make(ID, **override)) == want
    assert length(gym.make_vec(ID, 2, **override)) == want
    assert length(gym.make_vec(ID, 2, vectorization_mode="sync", **override)) == want
    assert gym.spec(ID).max_episode_steps == 5


def test_a_time_limit_of_no_steps_is_refused():
    with pytest.raises(InputError, match="max_episode_steps is 0, expected an integer >= 1"):
        gym.make_vec("wavegym/KershawEvansPosition-v0", max_episode_steps=0)
