"""Native vector environments for Stable-Baselines3, which has no adapter of its own; several of them as one batch.

    >>> from stable_baselines3 import PPO
    >>> from wavegym.envs.sb3 import SB3VecEnv
    >>> envs = SB3VecEnv("wavegym/KershawEvansPosition-v0", num_envs=64, reward="relative")
    >>> model = PPO("MlpPolicy", envs, n_steps=50, batch_size=1600, gamma=0.9).learn(6400)

Training through this adapter equals, bit for bit, training through ``DummyVecEnv`` over single environments.
"""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.vec_env import VecEnv

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.envs.vector import PER_ENVIRONMENT, row_of

Indices = None | int | Iterable[int]

NESTED = ("final_obs", "final_info")


class BatchedVecEnv(VecEnv):
    """The common part of environments that share a batch."""

    def seed(self, seed: int | Sequence[int | None] | None = None) -> Sequence[int | None]:
        """Seeds for the next reset: s (environment i gets s + i), a list, or None (drawn from NumPy's global state)."""
        if seed is None or isinstance(seed, (int, np.integer)):
            return super().seed(None if seed is None else int(seed))
        if len(seed) != self.num_envs:
            raise InputError(f"seed has {len(seed)} entries, expected {self.num_envs}: one for each environment")
        self._seeds = list(seed)
        return self._seeds

    @abstractmethod
    def saved(self) -> Any:
        """All that changes from step to step, as plain values and arrays."""

    @abstractmethod
    def restore(self, saved: Any) -> None:
        """Continue the episodes of ``saved``. Raises a KeyError, TypeError or ValueError where they are others."""

    def _check_all(self, attr_name: str, indices: Indices) -> None:
        """Raise an InputError where ``indices`` leaves out environments."""
        if set(self._get_indices(indices)) != set(range(self.num_envs)):
            raise InputError(f"{attr_name} cannot be set for some environments, expected all: they share one batch")


class SB3VecEnv(BatchedVecEnv):
    """A native vector environment as Stable-Baselines3 expects its environments.

    Args:
        env: an id, or a factory of native vector environments that takes ``num_envs``, ``autoreset_mode`` and settings.
        num_envs: number of environments.
        **settings: settings of the environment and parameters of its system.

    Raises:
        InputError: an unknown setting or one out of range, or a factory that does not reset in the same step.
    """

    def __init__(self, env: str | Callable[..., VectorEnv], num_envs: int = 1, **settings: Any) -> None:
        make = partial(gym.make_vec, env) if isinstance(env, str) else env
        self.batch: Any = make(num_envs=num_envs, autoreset_mode="SameStep", **settings)
        mode = self.batch.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise InputError(f"the environment's autoreset mode is {mode}, expected {AutoresetMode.SAME_STEP}")
        super().__init__(num_envs, self.batch.single_observation_space, self.batch.single_action_space)
        self.metadata = self.batch.metadata
        self._actions: Array = np.empty(0)

    def reset(self) -> Array:
        """Begin new episodes with the seeds and options set before, which are used only once."""
        first, *others = self._options
        if any(options != first for options in others):
            raise InputError("options differ between environments, expected the same for all: they share one batch")
        observations, info = self.batch.reset(seed=self._seeds, options=first or None)
        self.reset_infos = _rows(info, self.num_envs)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: Array) -> None:
        """Store the actions (env, ...) for ``step_wait``."""
        self._actions = actions

    def step_wait(self) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        """Step; an ended environment returns its next episode's first observation, and its info holds the last one.

        Returns:
            Observations (env, fields) float32, rewards (env,) float32, ended (env,) bool, a dict per environment.
        """
        observations, rewards, terminated, truncated, info = self.batch.step(self._actions)
        dones = terminated | truncated
        infos = _rows(info, self.num_envs)
        if dones.any():
            ended = np.flatnonzero(dones)
            for i, last in zip(ended.tolist(), _rows(info["final_info"], len(ended), ended), strict=True):
                self.reset_infos[i] = {key: value for key, value in infos[i].items() if info[f"_{key}"][i]}
                infos[i] = last
                last["terminal_observation"] = info["final_obs"][i]
        for row, late in zip(infos, (truncated & ~terminated).tolist(), strict=True):
            row["TimeLimit.truncated"] = late
        return observations, rewards.astype(np.float32), dones, infos

    def saved(self) -> Any:
        """See ``WaveformVectorEnv.saved``."""
        return self.batch.unwrapped.saved()

    def restore(self, saved: Any) -> None:
        """See ``WaveformVectorEnv.restore``."""
        self.batch.unwrapped.restore(saved)

    def close(self) -> None:
        """Close the vector environment."""
        self.batch.close()

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """The attribute of each single environment: its own spaces, its row of arrays, else the shared value."""
        value = getattr(self.batch, PER_ENVIRONMENT.get(attr_name, attr_name))
        return [row_of(value, i, self.num_envs) for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Set an attribute for all environments.

        Raises:
            InputError: ``indices`` leaves out environments, which share one batch.
        """
        self._check_all(attr_name, indices)
        setattr(self.batch, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Indices = None, **kwargs: Any) -> list[Any]:
        """Call the batch's method once and return the rows of its result, e.g. ``env_method("action_masks")``."""
        result = getattr(self.batch, method_name)(*args, **kwargs)
        return [row_of(result, i, self.num_envs) for i in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: Indices = None) -> list[bool]:
        """Native environments have no single wrappers: False for each."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[Array | None]:
        """A frame (height, width, 3) of each environment, or None without the render mode "rgb_array"."""
        if self.render_mode != "rgb_array":
            warnings.warn(f"the render mode is {self.render_mode}, expected 'rgb_array' to obtain images", stacklevel=2)
            return [None] * self.num_envs
        return list(self.batch.render())


def _rows(info: dict[str, Any], count: int, which: Array | None = None) -> list[dict[str, Any]]:
    """A vector environment's info without masks, as a dict for each of ``count`` environments (int rows ``which``)."""
    rows: list[dict[str, Any]] = [{} for _ in range(count)]
    for key, values in info.items():
        if key[0] == "_" or key in NESTED:
            continue
        column = values if which is None else values[which]
        for row, value in zip(rows, column.tolist() if column.ndim == 1 else column, strict=True):
            row[key] = value
    return rows


class SB3MixedVecEnv(BatchedVecEnv):
    """Several vector environments of the same spaces, one after the other.

        >>> parts = [SB3VecEnv("wavegym/MultifunctionRadar-v1", 32, targets=t) for t in (8.0, 20.0)]
        >>> envs = SB3MixedVecEnv(parts)

    Args:
        parts: the vector environments.

    Raises:
        InputError: the spaces of a part differ from those of the first one.
    """

    def __init__(self, parts: Sequence[VecEnv]) -> None:
        first = parts[0]
        for n, part in enumerate(parts):
            for name in ("observation_space", "action_space"):
                space, wanted = getattr(part, name), getattr(first, name)
                if space != wanted:
                    raise InputError(f"{name} of part {n} is {space}, expected that of part 0: {wanted}")
        self.parts: list[Any] = list(parts)
        self._ends = np.cumsum([part.num_envs for part in parts]).tolist()
        super().__init__(self._ends[-1], first.observation_space, first.action_space)

    def reset(self) -> Array:
        """Begin new episodes in all parts."""
        for part, seeds, options in zip(self.parts, self._split(self._seeds), self._split(self._options), strict=True):
            part.seed(seeds)
            part.set_options(options)
        observations = np.concatenate([part.reset() for part in self.parts])
        self._reset_seeds()
        self._reset_options()
        self._gather_reset_infos()
        return observations

    def step_async(self, actions: Array) -> None:
        """Hand each part its actions."""
        for part, own in zip(self.parts, self._split(actions), strict=True):
            part.step_async(own)

    def step_wait(self) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        """Step all parts; see ``SB3VecEnv.step_wait``."""
        observations, rewards, dones, infos = zip(*(part.step_wait() for part in self.parts), strict=True)
        self._gather_reset_infos()
        return (*(np.concatenate(rows) for rows in (observations, rewards, dones)), [i for own in infos for i in own])  # type: ignore[return-value]

    def saved(self) -> Any:
        """The saved state of each part."""
        return [part.saved() for part in self.parts]

    def restore(self, saved: Any) -> None:
        """Continue the episodes of each part; see ``WaveformVectorEnv.restore``."""
        for part, own in zip(self.parts, saved, strict=True):
            part.restore(own)

    def close(self) -> None:
        """Close all parts."""
        for part in self.parts:
            part.close()

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """The attribute of each single environment."""
        values = [value for part in self.parts for value in part.get_attr(attr_name)]
        return [values[i] for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Set an attribute in all environments. Raises an InputError where ``indices`` leaves out some."""
        self._check_all(attr_name, indices)
        for part in self.parts:
            part.set_attr(attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Indices = None, **kwargs: Any) -> list[Any]:
        """Call the method of every part; the rows of the environments ``indices``."""
        rows = [row for part in self.parts for row in part.env_method(method_name, *args, **kwargs)]
        return [rows[i] for i in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: Indices = None) -> list[bool]:
        """Whether each single environment is wrapped."""
        wrapped = [each for part in self.parts for each in part.env_is_wrapped(wrapper_class)]
        return [wrapped[i] for i in self._get_indices(indices)]

    def get_images(self) -> Sequence[Array | None]:
        """A frame of each environment; see ``SB3VecEnv.get_images``."""
        return [image for part in self.parts for image in part.get_images()]

    def _split(self, rows: Any) -> list[Any]:
        """The rows of each part."""
        return [rows[end - part.num_envs : end] for part, end in zip(self.parts, self._ends, strict=True)]

    def _gather_reset_infos(self) -> None:
        self.reset_infos = [info for part in self.parts for info in part.reset_infos]
