"""What a frame is drawn from, and what draws it."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from wavegym.core.action_sets import action_label
from wavegym.core.arrays import Array
from wavegym.core.system import State, System


class Moment(NamedTuple):
    """One environment's episode up to now; arrays of states and actions keep a leading axis of one."""

    system: System
    states: list[State]  # at steps 0, 1, ..., now
    actions: list[Array]  # (1, ...), one fewer than states
    costs: Array  # (step,), one for each state

    def label(self, action: Array) -> str:
        """A short name of ``action``, (1,) or (1, ...)."""
        return action_label(self.system.actions, action)


class Scene(Protocol):
    """Draws in a figure that lasts: axes are made once and wiped for each frame (see ``panels``)."""

    def draw(self, moment: Moment) -> None:
        """Show ``moment`` and nothing of earlier ones."""
