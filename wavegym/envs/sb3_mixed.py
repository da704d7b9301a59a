"""Environments of different parameters as one batch for Stable-Baselines3, so that an agent learns all of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.envs.sb3 import BatchedVecEnv, Indices


class SB3MixedVecEnv(BatchedVecEnv):
    """Several vector environments of the same spaces, one after the other.

        >>> parts = [SB3VecEnv("wavegym/MultifunctionRadar-v0", 32, targets=t) for t in (8.0, 20.0)]
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
