"""PettingZoo's ParallelEnv of a system, whose decision makers act at the same time; and many such worlds at once.

PettingZoo itself has no vector environments.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from pettingzoo import ParallelEnv

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.system import System
from wavegym.envs.episodes import Seed
from wavegym.envs.single import WaveformEnv
from wavegym.envs.vector import WaveformVectorEnv
from wavegym.integrations.pettingzoo.views import AgentViews
from wavegym.registration import full_id

Infos = dict[str, dict[str, Any]]
ByAgent = dict[str, Array]


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


class BatchedParallelEnv:
    """``num_envs`` parallel environments in one batch: every value of ``reset`` and ``step`` has axis 0 = environment.

    Environment i equals ``WaveformParallelEnv`` bit for bit. Ended episodes begin again as in Gymnasium's vector
    environments; all agents are always there.

    Args:
        env: a registered id, a System or its class.
        num_envs: number of environments.
        sees: as in ``WaveformParallelEnv``.
        autoreset_mode: "NextStep", "SameStep" or "Disabled", as in ``gym.make_vec``.
        **settings: settings of ``gym.make_vec``, and parameters of the system.

    Attributes:
        system, views, possible_agents, observation_spaces, action_spaces: as in ``WaveformParallelEnv``; the spaces are
            those of one environment.

    Raises:
        InputError: see ``WaveformParallelEnv``.
    """

    def __init__(
        self,
        env: str | System | type[System],
        num_envs: int = 1,
        *,
        sees: str = "own",
        autoreset_mode: str = "NextStep",
        **settings: Any,
    ) -> None:
        settings["autoreset_mode"] = autoreset_mode
        batch: Any = (
            gym.make_vec(full_id(env), num_envs, vectorization_mode="vector_entry_point", **settings)
            if isinstance(env, str)
            else WaveformVectorEnv(env, num_envs, **settings)
        )
        self.batch, self.num_envs, self.system = batch, num_envs, batch.unwrapped.system
        self.views = AgentViews(self.system, sees)
        self.views.check_observation(self.batch.single_observation_space)
        self.possible_agents = list(self.views.names)
        self.observation_spaces, self.action_spaces = self.views.observation_spaces, self.views.action_spaces
        self._waits_for_next_step = self.batch.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
        self._restarting: Array | None = None
        self._state: Array | None = None

    def reset(self, *, seed: Seed = None, options: dict[str, Any] | None = None) -> tuple[ByAgent, Infos]:
        """Begin new episodes: in all environments, or in those of ``options["reset_mask"]`` (env,) bool.

        ``seed``: None, s (environment i is seeded with s + i) or a list. Returns each agent's observations (env,
        fields) and its info, as ``WaveformVectorEnv`` lays it out.
        """
        self._state, info = self.batch.reset(seed=seed, options=options)
        if self._restarting is not None:
            self._restarting = self._restarting & ~(options or {}).get("reset_mask", np.True_)
        return self.views.shares(self.state()), self._infos(info)

    def step(self, actions: Mapping[str, Any]) -> tuple[ByAgent, ByAgent, ByAgent, ByAgent, Infos]:
        """One step of every environment.

        Args:
            actions: for each agent indices (env,), or points (env, parameters).

        Returns:
            By agent: observations (env, fields), rewards, terminations and truncations (env,), infos.

        Raises:
            InputError: see ``WaveformParallelEnv``; the environments are unchanged.
        """
        joint = self.views.joined(actions, self.num_envs, self._restarting)
        self._state, reward, terminated, truncated, info = self.batch.step(joint)
        if self._waits_for_next_step:
            self._restarting = terminated | truncated
        rewards, ends, cuts = (
            {name: values.copy() for name in self.possible_agents} for values in (reward, terminated, truncated)
        )
        return self.views.shares(self.state()), rewards, ends, cuts, self._infos(info)

    def state(self) -> Array:
        """The whole observations, (env, fields) float32; a fresh array.

        Raises:
            InputError: before the first reset.
        """
        if self._state is None:
            raise InputError("the environments have no state yet, expected reset() first")
        return self._state.copy()

    def close(self) -> None:
        """Close the vector environment."""
        self.batch.close()

    def _infos(self, info: dict[str, Any]) -> Infos:
        """The batch's info for every agent: a dictionary each, with arrays that all agents share.

        ``final_obs``, the last observations of ended episodes, are the agent's own.
        """
        infos: Infos = {name: dict(info) for name in self.possible_agents}
        if "final_obs" in info:
            for name in self.possible_agents:
                infos[name]["final_obs"] = np.full(self.num_envs, None, dtype=object)
            for row in np.flatnonzero(info["_final_obs"]):
                for name, own in self.views.shares(info["final_obs"][row]).items():
                    infos[name]["final_obs"][row] = own
        return infos
