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


@pytest.mark.parametrize(
    ("name", "way"), [("q", r"reset\(options={'parameters': {'q': 1.0}}\)"), ("reward", r"gym.make\(..., reward=1.0\)")]
)
def test_a_parameter_that_would_change_nothing_is_refused(name: str, way: str) -> None:
    """In a single environment, a copy and a vector environment that was pickled."""
    wanted = rf"{name} is fixed in an episode, expected .*{way}"
    single = gym.make(ID)
    for env in (single.unwrapped, copy.deepcopy(single.unwrapped), pickle.loads(pickle.dumps(made()))):
        with pytest.raises(InputError, match=wanted):
            setattr(env, name, 1.0)
    for values in (1.0, (1.0, 2.0)):
        with pytest.raises(InputError, match=f"{name} is fixed in an episode, expected "):
            made().set_attr(name, values)


def test_parameters_may_change_between_episodes() -> None:
    """As in a new environment with these parameters and seeds, in both forms; a scheduler takes them up."""
    changed = {"q": 7.0, "horizon": 5}
    envs, single = made(), gym.make(ID).unwrapped
    policy, one = envs.policy("myopic"), single.policy("myopic")
    other = made(**changed)
    others = other.policy("myopic")
    for env in (envs, single):
        env.reset(seed=1)
        env.reset(seed=3, options={"parameters": changed})
        assert (env.system.q, env.system.horizon) == (7.0, 5)
    other.reset(seed=3)
    for _ in range(5):
        expected = other.step(others())
        for found, row in ((envs.step(policy()), slice(None)), (single.step(one()), 0)):
            for mine, its in zip(found[:4], expected[:4], strict=True):
                np.testing.assert_array_equal(mine, its[row])
    assert expected[2].all()
    envs.reset()  # they stay
    assert envs.system.q == 7.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parameters": {"qq": 1.0}}, "unexpected keyword argument 'qq'; did you mean 'q'"),
        ({"parameters": {"q": -1.0}}, "q is -1.0"),
        ({"parameters": {"durations": (1e-5, 2e-5)}}, "has durations, expected parameters that keep observations and"),
        (
            {"parameters": {"model": "ca", "weights": (1, 0, 0), "prior_variance": (1, 1, 1)}},
            "has model, weights, prior",
        ),
        ({"parameters": 3}, "is 3, expected a dictionary by name"),
        ({"parameters": {"q": 1.0}, "reset_mask": np.array([True, False, False])}, "environments share one system"),
        ({"parameter": {}}, "option is 'parameter', expected .*did you mean 'parameters'"),
    ],
)
def test_parameters_that_cannot_change_are_refused_and_nothing_changes(options: Any, message: str) -> None:
    envs, other = made(), made()
    for env in (envs, other):
        env.reset(seed=1)
    with pytest.raises(InputError, match=message):
        envs.reset(seed=2, options=options)
    for mine, its in zip(envs.step(np.zeros(3, int))[:4], other.step(np.zeros(3, int))[:4], strict=True):
        np.testing.assert_array_equal(mine, its)
    np.testing.assert_array_equal(envs.reset()[0], other.reset()[0])


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
