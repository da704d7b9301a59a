"""Policies without a model: the baselines for all other policies."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core import shortcuts
from wavegym.core.action_sets import ParameterBox, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, nearest
from wavegym.core.system import System

FEW = 1024  # candidates: up to here a random choice draws one number for each, so that masks need no rejection


class RandomChoice:
    """Uniform over the allowed actions; with a ParameterBox, over the whole box [-1, 1]^d."""

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self._rng, self._system = rng, system
        enumerated = not isinstance(system.actions, (ParameterBox, PerSensorLibrary))
        self._candidates = system.candidates() if enumerated else None

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``: the largest of one uniform draw per candidate, or one drawn index if they are many."""
        envs, actions = len(belief.step), self._system.actions
        if isinstance(actions, ParameterBox):
            return self._rng.uniform(-1.0, 1.0, (envs, len(actions)))
        if isinstance(actions, PerSensorLibrary) and mask is None:
            return self._rng.integers(len(actions), size=(envs, actions.sensors))
        candidates = self._system.candidates() if self._candidates is None else self._candidates
        count = len(candidates)
        if mask is None and count > FEW:
            return candidates[self._rng.integers(count, size=envs)]
        draws = self._rng.random((envs, count))
        return candidates[np.argmax(draws if mask is None else np.where(mask, draws, -1.0), axis=1)]


class Cycle:
    """A periodic schedule: step t transmits slot t modulo the number of slots.

    The next allowed constant in cyclic order replaces an index that is not allowed. For an index that is not a constant
    the order begins at the first constant. Masks are for indices: other actions are transmitted unchanged.

    Args:
        actions: one action for each slot, (slots,) indices, (slots, sensor) indices or (slots, d) points of a box.

    Raises:
        InputError: no slots.
    """

    def __init__(self, actions: ArrayLike) -> None:
        self.actions = np.asarray(actions)
        if self.actions.ndim == 0 or not len(self.actions):
            raise InputError(f"actions of a cycle are {actions!r}, expected one action or more, axis 0 = slot")

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self._constants = shortcuts.constants(system)

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        action = self.slot_action(belief)
        if mask is None or action.ndim > 1:
            return action
        is_allowed = mask[np.arange(len(action)), action]
        if is_allowed.all():
            return action
        at = np.argmax(action[:, None] == self._constants, axis=1)
        return np.where(is_allowed, action, _first_allowed(at, self._constants, mask))

    def slot_action(self, belief: Any) -> Array:
        """The action of each environment's slot, allowed or not, (env, ...)."""
        return self.actions[belief.step % len(self.actions)]


class Fixed(Cycle):
    """The same constant at every step; where it is not allowed, the next allowed constant in cyclic order.

    Args:
        constant: an index into ``constants`` of the system, or a name in its ``named_constants``.
    """

    def __init__(self, constant: int | str) -> None:
        self.constant = constant

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError where there is no such constant."""
        self.actions = constant_action(system, self.constant)[None]
        super().begin(system, num_envs, rng)


def constant_action(system: System, constant: int | str) -> Array:
    """The action (...) of an index into ``constants`` of the system or of a name in its ``named_constants``.

    Raises:
        InputError: no such constant.
    """
    constants, named = shortcuts.constants(system), shortcuts.named_constants(system)
    if isinstance(constant, str):
        if constant in named:
            return np.asarray(named[constant])
        hint = nearest(constant, named)
    else:
        if 0 <= constant < len(constants):
            return np.asarray(constants[constant])
        hint = f" (nearest: {min(max(constant, 0), len(constants) - 1)})"
    names = f", {', '.join(map(repr, named))}" if named else ""
    raise InputError(f"fixed:{constant} is no constant action, expected 0 to {len(constants) - 1}{names}{hint}")


class RoundRobin:
    """Every constant in turn; constants that are not allowed are skipped."""

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self._constants = shortcuts.constants(system)

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        return _first_allowed(belief.step, self._constants, mask)


def _first_allowed(start: Array, constants: Array, mask: Array | None) -> Array:
    """The first of ``constants`` at or after ``start`` (env,), in cyclic order, that ``mask`` (env, actions) allows.

    Constants that are indices select columns of the mask; points of a box have one column each.
    """
    count = len(constants)
    if mask is None:
        return constants[start % count]
    if constants.ndim == 1:
        mask = mask[:, constants]
    order = (start[:, None] + np.arange(count)) % count
    allowed = np.take_along_axis(mask, order, axis=1)
    return constants[np.take_along_axis(order, allowed.argmax(1)[:, None], axis=1)[:, 0]]
