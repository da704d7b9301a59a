"""One world as PettingZoo's ParallelEnv: the decision makers of a system act at the same time."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.system import System
from wavegym.envs.single import WaveformEnv
from wavegym.integrations.pettingzoo.views import AgentViews
from wavegym.registration import full_id

Infos = dict[str, dict[str, Any]]


class WaveformParallelEnv(ParallelEnv):
    """A closed loop whose sensors are agents: each chooses its own waveform or settings in every step.

    Rewards are the team's, the same for every agent, and so are terminations, truncations and infos; they are those of
    the single environment.

    Args:
        env: a registered id, a System or its class.
        sees: "own" (an agent observes the fields of its own sensor, and those that belong to no sensor) or "all".
        **settings: settings of ``gym.make``, and parameters of the system.

    Attributes:
        system: the closed loop.
        views: which fields and parameters are whose.
        possible_agents: the agents' names.
        state_space: of ``state()``.

    Raises:
        InputError: an unknown id or setting, a system with a single decision maker or with a mask that environments
            enforce, or forecasts.
    """

    metadata: dict[str, Any] = {**WaveformEnv.metadata, "name": "wavegym", "is_parallelizable": True}

    def __init__(self, env: str | System | type[System], *, sees: str = "own", **settings: Any) -> None:
        single: Any = _single(env, settings)
        self._env, self.system = single, single.unwrapped.system
        self.views = AgentViews(self.system, sees)
        self.views.check_observation(self._env.observation_space)
        self.render_mode: str | None = self._env.render_mode
        name = full_id(env) if isinstance(env, str) else type(self.system).__name__
        self.metadata = {**type(self).metadata, "name": name}
        self.possible_agents = list(self.views.names)
        self.agents: list[str] = []
        self.observation_spaces = dict(self.views.observation_spaces)
        self.action_spaces = dict(self.views.action_spaces)
        self.state_space: spaces.Space[Any] = self._env.observation_space
        self._state: Array | None = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The observation space of one agent, always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The action space of one agent, always the same object."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict[str, Array], Infos]:
        """Begin a new episode; ``seed=None`` continues with the environment's generator.

        ``options`` are ignored, as PettingZoo's test demands.
        """
        self._state, info = self._env.reset(seed=seed)
        self.agents = list(self.possible_agents)
        return self.views.shares(self.state()), self._infos(info)

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[dict[str, Array], dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """All agents act; the targets move, the sensors measure, the tracker tracks.

        Raises:
            InputError: an agent without an action, an action out of range or not finite, or a step past the episode's
                end; the environment is unchanged.
        """
        if not self.agents:
            raise InputError("no episode is running, expected reset() before step()")
        if not isinstance(actions, dict):
            raise InputError(f"actions are {actions!r}, expected a dictionary with one for each of {self.agents}")
        joint = self.views.joined({name: np.asarray(action)[None] for name, action in actions.items()}, 1)[0]
        self._state, reward, terminated, truncated, info = self._env.step(joint)
        if terminated or truncated:
            self.agents = []
        names = self.possible_agents
        rewards, ends, cuts = (dict.fromkeys(names, value) for value in (reward, terminated, truncated))
        return self.views.shares(self.state()), rewards, ends, cuts, self._infos(info)

    def state(self) -> Array:
        """The whole observation, (fields,) float32: what an agent sees with ``sees="all"``; a fresh array.

        Raises:
            InputError: before the first reset.
        """
        if self._state is None:
            raise InputError("the environment has no state yet, expected reset() first")
        return self._state.copy()

    def render(self) -> Array | None:
        """A frame (height, width, 3) uint8, or None without a render mode."""
        frame: Array | None = self._env.render()
        return frame

    def close(self) -> None:
        """Close the single environment."""
        self._env.close()

    def _infos(self, info: dict[str, Any]) -> Infos:
        """The single environment's info for every agent, in dictionaries and arrays of its own."""
        return {
            name: {key: value.copy() if isinstance(value, np.ndarray) else value for key, value in info.items()}
            for name in self.possible_agents
        }


def parallel_env(env: str | System | type[System], *, sees: str = "own", **settings: Any) -> WaveformParallelEnv:
    """``WaveformParallelEnv``, under the name that PettingZoo gives to such functions."""
    return WaveformParallelEnv(env, sees=sees, **settings)


def _single(env: str | System | type[System], settings: dict[str, Any]) -> gym.Env:
    """The single environment of an id, a System or its class."""
    if isinstance(env, str):
        return gym.make(full_id(env), disable_env_checker=True, **settings)
    return WaveformEnv(env, **settings)
