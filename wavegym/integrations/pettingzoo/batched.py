"""Many worlds of a parallel environment at once: PettingZoo itself has no vector environments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.system import System
from wavegym.envs.episodes import Seed
from wavegym.envs.vector import WaveformVectorEnv
from wavegym.integrations.pettingzoo.views import AgentViews
from wavegym.registration import full_id

ByAgent = dict[str, Array]
Infos = dict[str, dict[str, Any]]


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
