"""The single environment: a batch of one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.envs.policy_in_loop import PolicyInLoop
from wavegym.envs.rewards import Reward
from wavegym.envs.scenario import with_scenario
from wavegym.envs.vector import FixedParameters, WaveformVectorEnv


class WaveformEnv(FixedParameters, gym.Env):
    """One closed loop in which the action is the next waveform; see ``WaveformVectorEnv`` for the arguments."""

    metadata: dict[str, Any] = WaveformVectorEnv.metadata

    def __init__(
        self,
        system: System | type[System] | str,
        *,
        reward: str | Reward = "cost",
        render_mode: str | None = None,
        **parameters: Any,
    ) -> None:
        for name in ("num_envs", "num_threads", "autoreset_mode"):
            if name in parameters:
                raise InputError(f"{name} is a setting of vector environments, expected gym.make_vec(id, {name}=...)")
        self.batch = WaveformVectorEnv(system, 1, reward=reward, render_mode=render_mode, **parameters)
        self.metadata = dict(WaveformVectorEnv.metadata)  # a copy: Gymnasium 1.2's SyncVectorEnv writes into it
        self.render_mode = self.batch.render_mode
        self.action_space, self.observation_space = self.batch.single_action_space, self.batch.single_observation_space
        self._over = False
        self.fix(self.system)

    @property
    def system(self) -> System:
        """The closed loop; ``reset(options={"parameters": ...})`` may change it."""
        return self.batch.system

    @property
    def belief(self) -> Any:
        """A copy of the belief with a leading axis of one, as policies take it."""
        return self.batch.belief

    # Gymnasium's np_random and np_random_seed read and write these two, and its checker looks at them directly.
    @property
    def _np_random(self) -> np.random.Generator | None:
        return self.batch.episodes.generators[0]

    @_np_random.setter
    def _np_random(self, generator: np.random.Generator | None) -> None:
        self.batch.episodes.generators[0] = generator

    @property
    def _np_random_seed(self) -> int | None:
        return self.batch.episodes.seeds[0]

    @_np_random_seed.setter
    def _np_random_seed(self, seed: int | None) -> None:
        self.batch.episodes.seeds[0] = seed

    def action_masks(self) -> Array:
        """Which actions are allowed now, (actions,) bool."""
        return self.batch.action_masks()[0]

    def policy(self, policy: str | Policy, seed: int = 0) -> PolicyInLoop:
        """A scheduler by name, or a Policy, that follows this environment: ``action = policy()`` before each step.

        See ``wavegym.envs.policy_in_loop.PolicyInLoop``.
        """
        return PolicyInLoop(self.batch, policy, seed, is_single=True)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin a new episode; ``seed=None`` continues with the environment's generator."""
        observation, info = self.batch.reset(seed=[seed], options=options)
        self._over = False
        return observation[0], _first({key: value for key, value in info.items() if key[0] != "_"})

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Transmit a waveform, move, measure, track.

        Raises:
            InputError: an action out of range, masked or not finite, or a step past the episode's end; the environment
                is unchanged.
        """
        if self._over:
            raise InputError("the episode has ended, expected reset() before step()")
        one = np.asarray(action)
        if one.shape != self.action_space.shape:
            raise InputError(f"action has the shape {one.shape}, expected {self.action_space.shape}")
        observation, reward, terminated, truncated, state_info, transition_info = self.batch.transmit(one[None], None)
        over, late = terminated.item(), truncated.item()
        self._over = over or late
        return observation[0], reward.item(), over, late, _first(state_info | transition_info)

    def render(self) -> Array | None:
        """A frame (height, width, 3) uint8, or None without a render mode."""
        frames = self.batch.render()
        return frames[0] if frames else None


def _first(info: dict[str, Array]) -> dict[str, Any]:
    """The info of the only environment, as plain scalars and arrays."""
    return {key: values.item() if values.ndim == 1 else values[0] for key, values in info.items()}


def make_env(
    system: System | type[System] | str, *, registered: Mapping[str, Any] | None = None, **given: Any
) -> WaveformEnv:
    """A single environment; called by ``gym.make``.

    Args:
        system: see ``WaveformVectorEnv``.
        registered: parameters and settings of the registration; the file ``given["scenario"]`` and ``given`` win.
        **given: parameters and settings; they win over the file.

    Raises:
        InputError: see ``WaveformVectorEnv`` and ``scenario_parameters``.
    """
    return WaveformEnv(system, **with_scenario(system, registered or {}, given))


make_env.metadata = WaveformEnv.metadata  # type: ignore[attr-defined]  # which Gymnasium's ``make`` reads
