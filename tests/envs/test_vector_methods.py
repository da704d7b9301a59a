"""Our vector environments offer and refuse the same as Gymnasium's own."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError
from gymnasium.vector import SyncVectorEnv

import wavegym  # noqa: F401
from wavegym.core.errors import InputError

ID = "wavegym/KershawEvansPosition-v0"


def made(**settings: Any) -> Any:
    return gym.make_vec(ID, num_envs=3, **settings).unwrapped


def test_call_and_get_attr_give_what_single_environments_give() -> None:
    ours, theirs = made(action="library"), SyncVectorEnv([lambda: gym.make(ID)] * 3)
    for envs in (ours, theirs):
        envs.reset(seed=4)
    for name in ("action_space", "observation_space", "render_mode"):
        assert ours.get_attr(name) == theirs.get_attr(name)
    for mine, other in zip(ours.call("action_masks"), theirs.call("action_masks"), strict=True):
        np.testing.assert_array_equal(mine, other)
    beliefs = ours.get_attr("belief")
    assert [len(belief.step) for belief in beliefs] == [1, 1, 1]
    for mine, other in zip(beliefs, theirs.get_attr("belief"), strict=True):
        np.testing.assert_array_equal(mine.step, other.step)
    with pytest.raises(AttributeError):
        ours.get_attr("colour")


def test_set_attr_sets_one_value_for_all() -> None:
    envs = made()
    for values in (5, [6, 6, 6]):
        envs.set_attr("max_episode_steps", values)
        assert envs.get_attr("max_episode_steps") == (np.max(values),) * 3
    with pytest.raises(InputError, match=r"max_episode_steps is \[1, 2, 3\], expected one value for all environments"):
        envs.set_attr("max_episode_steps", [1, 2, 3])


@pytest.mark.parametrize("name", ["q", "reward"])
def test_a_parameter_that_would_change_nothing_is_refused(name: str) -> None:
    """In a single environment, a copy and a vector environment that was pickled."""
    wanted = rf"{name} is fixed, expected a new environment: gym.make\(..., {name}=1.0\)"
    single = gym.make(ID)
    for env in (single.unwrapped, copy.deepcopy(single.unwrapped), pickle.loads(pickle.dumps(made()))):
        with pytest.raises(InputError, match=wanted):
            setattr(env, name, 1.0)
    with pytest.raises(InputError, match=wanted):
        made().set_attr(name, 1.0)


@pytest.mark.parametrize("action", ["library", "box"])
def test_actions_of_a_wrong_type_are_a_type_error(action: str) -> None:
    envs = made(action=action)
    envs.reset(seed=0)
    wrong: Any = np.array(["a"] * 3) if action == "box" else np.zeros(3)
    with pytest.raises(TypeError, match="action has the type") as caught:
        envs.step(wrong)
    assert isinstance(caught.value, InputError)


def test_a_closed_environment_answers_with_an_error() -> None:
    envs = made()
    envs.reset(seed=0)
    envs.close()
    envs.close()
    for ask in (envs.reset, lambda: envs.step(envs.action_space.sample())):
        with pytest.raises(ClosedEnvironmentError, match=r"the environment is closed, expected a new one") as caught:
            ask()
        assert isinstance(caught.value, InputError)
