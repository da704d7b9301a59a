"""An energy account in whole quanta, which avoids rounding errors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wavegym.core.arrays import Array


@dataclass(frozen=True)
class Account:
    """Pays joint actions, and replaces an action that the account cannot pay.

    Args:
        action_quanta: quanta that each action costs, (action,) int.
        options: each action's option at every sensor, (action, sensor): 0 for silence, then the pulses by duration.
        quanta: quanta in one unit of energy.
    """

    action_quanta: Array
    options: Array
    quanta: int

    @cached_property
    def _transmitted(self) -> Array:
        """The action transmitted, by quanta left (0 to the dearest action's) and action asked, (quanta + 1, action).

        The dearest affordable action in which no sensor transmits longer than asked; the first of equals.
        """
        is_within = (self.options[None] <= self.options[:, None]).all(axis=2)  # (asked, transmitted)
        left = np.arange(self.action_quanta.max() + 1)
        is_allowed = is_within & (self.action_quanta <= left[:, None])[:, None]
        return np.where(is_allowed, self.action_quanta, -1).argmax(axis=2)

    def left(self, energy: Array) -> Array:
        """Energy (...) in whole quanta (...)."""
        return np.rint(energy * self.quanta).astype(np.int64)

    def affordable(self, energy: Array) -> Array:
        """Which actions the account can pay, (..., action) bool."""
        return self.action_quanta <= self.left(energy)[..., None]

    def pay(self, energy: Array, asked: Array) -> tuple[Array, Array]:
        """The actions transmitted and the energy left after them, both of the broadcast shape of the arguments."""
        left = self.left(energy)
        used = self._transmitted[np.minimum(left, len(self._transmitted) - 1), asked]
        return used, (left - self.action_quanta[used]) / self.quanta
