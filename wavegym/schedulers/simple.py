"""Policies without a model: the floor that every other one must beat."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wavegym.errors import InputError
from wavegym.systems.contract import System

Array = NDArray[Any]


class RandomChoice:
    """Uniform over the allowed candidates."""

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self._candidates, self._rng = system.candidates(), rng

    def act(self, public: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``: the largest of one uniform draw per candidate, which masks without rejection."""
        draws = self._rng.random((len(public.step), len(self._candidates)))
        return self._candidates[np.argmax(draws if mask is None else np.where(mask, draws, -1.0), axis=1)]


class Fixed:
    """Always the same candidate.

    Args:
        index: which of ``system.candidates()``.
    """

    def __init__(self, index: int) -> None:
        self.index = index

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError where there is no such candidate."""
        candidates = system.candidates()
        if not 0 <= self.index < len(candidates):
            last = len(candidates) - 1
            nearest = min(max(self.index, 0), last)
            raise InputError(f"fixed:{self.index} is not a waveform, expected 0 to {last} (nearest: {nearest})")
        self._action = candidates[self.index]

    def act(self, public: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``. A mask is the system's business here: it answers an action that cannot be had."""
        return np.repeat(self._action[None], len(public.step), axis=0)


class RoundRobin:
    """Every candidate in turn, skipping those not allowed."""

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self._candidates = system.candidates()

    def act(self, public: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        count = len(self._candidates)
        order = (public.step[:, None] + np.arange(count)) % count
        if mask is None:
            return self._candidates[order[:, 0]]
        allowed = np.take_along_axis(mask, order, axis=1)
        return self._candidates[np.take_along_axis(order, allowed.argmax(1)[:, None], axis=1)[:, 0]]
