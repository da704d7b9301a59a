"""The data of a frame, and the protocol of the scenes that draw it."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from wavegym.core.action_sets import action_label
from wavegym.core.arrays import Array
from wavegym.core.system import State, System


class Moment(NamedTuple):
    """One environment's episode so far; arrays of states and actions have a leading axis of one."""

    system: System
    states: list[State]  # at steps 0, 1, ..., now
    actions: list[Array]  # each (1, ...), one fewer than states
    costs: Array  # (step,), one for each state

    def label(self, action: Array) -> str:
        """A short name of ``action``, (1,) or (1, ...)."""
        return action_label(self.system.actions, action)


class Scene(Protocol):
    """Draws frames in one figure: axes are made once and cleared for each frame (see ``panels``)."""

    def draw(self, moment: Moment) -> None:
        """Draw ``moment``; nothing of an earlier frame remains."""
