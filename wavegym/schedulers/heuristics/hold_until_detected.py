"""Looks that have to last: what a target's look is worth until the next one is possible."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.capabilities import GainByTarget, delays
from wavegym.core.errors import check_int
from wavegym.schedulers.heuristics.base import Heuristic, greatest

FAR = 32  # steps out of sight that are told apart


class HoldUntilDetected(Heuristic):
    """The greatest gain, summed for each target over ``ahead`` steps and those in which it is hidden after the look.

    A look at a target that stays in sight has to last until its next turn, one before it hides until it is back. For
    systems that offer ``GainByTarget`` and whose belief has ``visible``, (env, H, target).

    Args:
        ahead: steps over which the gain of a look is summed where the target stays in sight.

    Raises:
        InputError: fewer than one step.
    """

    name = "hold-until-detected"
    needs = (GainByTarget,)

    def __init__(self, ahead: int = 4) -> None:
        self.ahead = check_int("ahead", ahead, 1)

    def choose(self, belief: Any, mask: Array | None, settled: Array | None) -> Array:
        """See ``Heuristic``."""
        visible, rows = belief.visible, np.arange(len(belief.step))[:, None]
        when = belief.step[:, None] + np.arange(1, FAR + 1)
        back = visible[rows, np.minimum(when, visible.shape[1] - 1)]  # (env, step, target)
        hidden = np.where(back.any(axis=1), back.argmax(axis=1), FAR)
        values = self.system.gain(belief, 0, self.ahead + hidden)
        return self.candidates[greatest(values, mask, delays(self.system, belief))]
