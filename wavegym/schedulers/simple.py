"""Policies without a model: the floor that every other one must beat."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wavegym.errors import InputError
from wavegym.systems.contract import System

Array = NDArray[Any]

FEW = 1024  # candidates: up to here a random choice draws one number for each, which masks without rejection


class RandomChoice:
    """Uniform over the allowed candidates."""

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self._candidates, self._rng = system.candidates(), rng

    def act(self, public: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``: the largest of one uniform draw per candidate; of many unmasked ones, an index drawn."""
        count = len(self._candidates)
        if mask is None and count > FEW:
            return self._candidates[self._rng.integers(count, size=len(public.step))]
        draws = self._rng.random((len(public.step), count))
        return self._candidates[np.argmax(draws if mask is None else np.where(mask, draws, -1.0), axis=1)]


class Fixed:
    """Always the same constant; where that is not allowed, the next one in cyclic order that is, as ``RoundRobin``.

    Args:
        index: which of ``system.constants()``.
    """

    def __init__(self, index: int) -> None:
        self.index = index

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError where there is no such constant."""
        constants = system.constants()
        if not 0 <= self.index < len(constants):
            last = len(constants) - 1
            nearest = min(max(self.index, 0), last)
            raise InputError(f"fixed:{self.index} is no constant action, expected 0 to {last} (nearest: {nearest})")
        self._constants = constants

    def act(self, public: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        return _first_allowed(np.full(len(public.step), self.index), self._constants, mask)


class RoundRobin:
    """Every constant in turn, skipping those not allowed."""

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self._constants = system.constants()

    def act(self, public: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        return _first_allowed(public.step, self._constants, mask)


def _first_allowed(start: Array, constants: Array, mask: Array | None) -> Array:
    """The first of ``constants`` at or after ``start`` (env,), in cyclic order, that ``mask`` (env, actions) allows.

    Constants that are indices say which columns of the mask are theirs; points of a box have one column each.
    """
    count = len(constants)
    if mask is None:
        return constants[start % count]
    if constants.ndim == 1:
        mask = mask[:, constants]
    order = (start[:, None] + np.arange(count)) % count
    allowed = np.take_along_axis(mask, order, axis=1)
    return constants[np.take_along_axis(order, allowed.argmax(1)[:, None], axis=1)[:, 0]]
