"""Episodes that are saved and taken over by another environment go on as if nothing had happened."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import wavegym  # noqa: F401
from wavegym.core.files import packed, unpacked
from wavegym.registration import full_id

IDS = {
    "KershawEvansPosition": {"reward": "relative"},
    "AgileClutter": {},
    "RfEo": {"observation": "measurements"},
    "Urban": {},
    "CameraSlew": {"forecasts": True},
    "EnergyBudget": {"autoreset_mode": "SameStep"},
    "MultifunctionRadar": {"slots": 16, "targets": 4.0},
}


def made(name: str, settings: dict[str, Any]) -> Any:
    return gym.make_vec(full_id(name), num_envs=3, max_episode_steps=6, **settings)


@pytest.mark.parametrize("name", IDS)
def test_saved_episodes_go_on_elsewhere(name: str) -> None:
    """Past the end of an episode, where new worlds are drawn."""
    first, other = made(name, IDS[name]), made(name, IDS[name])
    first.reset(seed=5)
    first.action_space.seed(0)
    for _ in range(4):
        first.step(allowed(first))
    other.unwrapped.restore(unpacked(packed(first.unwrapped.saved())))
    for _ in range(10):
        actions = allowed(first)
        for one, same in zip(first.step(actions)[:4], other.step(actions)[:4], strict=True):
            np.testing.assert_array_equal(one, same)


def allowed(env: Any) -> Any:
    """Random actions that the masks admit."""
    system, actions = env.unwrapped.system, env.action_space.sample()
    if not isinstance(env.single_action_space, gym.spaces.Discrete):
        return actions
    masks = system.mask(env.unwrapped.belief)
    return actions if masks is None else np.where(masks[np.arange(3), actions], actions, masks.argmax(axis=1))


def test_episodes_of_other_environments_are_refused() -> None:
    saved = made("KershawEvansPosition", {})
    saved.reset(seed=1)
    for name, count in (("AgileClutter", 3), ("KershawEvansPosition", 2)):
        other = gym.make_vec(full_id(name), num_envs=count)
        with pytest.raises(ValueError, match="expected"):
            other.unwrapped.restore(saved.unwrapped.saved())
