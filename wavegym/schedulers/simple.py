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
    """Always the same candidate; where that is not allowed, the next one in cyclic order that is, as ``RoundRobin``.

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
        self._candidates = candidates

    def act(self, public: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        return self._candidates[_first_allowed(np.full(len(public.step), self.index), len(self._candidates), mask)]


class RoundRobin:
    """Every candidate in turn, skipping those not allowed."""

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self._candidates = system.candidates()

    def act(self, public: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        return self._candidates[_first_allowed(public.step, len(self._candidates), mask)]


def _first_allowed(start: Array, count: int, mask: Array | None) -> Array:
    """The first index at or after ``start`` (env,), in cyclic order of ``count``, that ``mask`` allows."""
    if mask is None:
        return start % count
    order = (start[:, None] + np.arange(count)) % count
    allowed = np.take_along_axis(mask, order, axis=1)
    return np.take_along_axis(order, allowed.argmax(1)[:, None], axis=1)[:, 0]
