"""Hold until detected: the gain of a measurement until the next one is possible."""

from __future__ import annotations

from typing import Any

from wavegym.core.arrays import Array
from wavegym.core.errors import check_int
from wavegym.core.shortcuts import delay, gain_by_target
from wavegym.schedulers.heuristics.base import Heuristic, greatest
from wavegym.schedulers.heuristics.clear_slots import hidden_steps


class HoldUntilDetected(Heuristic):
    """The greatest gain, summed for each target over ``ahead`` steps and the steps in which it is hidden afterwards.

    The measurement of a visible target must last until its next turn. If the target will be hidden soon, it must last
    until the target is visible again. For systems that have ``gain_by_target`` and whose belief has ``visible``,
    (env, H, target).

    Args:
        ahead: steps over which the gain of a pulse is summed where the target stays in sight.

    Raises:
        InputError: fewer than one step.
    """

    name = "hold-until-detected"
    needs = (gain_by_target,)

    def __init__(self, ahead: int = 4) -> None:
        self.ahead = check_int("ahead", ahead, 1)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        values = gain_by_target(self.system, belief, 0, self.ahead + hidden_steps(belief))
        return self.candidates[greatest(values, mask, delay(self.system, belief))]
