"""Hold until detected: the gain of a measurement until the next one is possible."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.capabilities import GainByTarget, delays
from wavegym.core.errors import check_int
from wavegym.schedulers.heuristics.base import Heuristic, greatest

FAR = 32  # steps: longest time out of sight that is distinguished


class HoldUntilDetected(Heuristic):
    """The greatest gain, summed for each target over ``ahead`` steps and the steps in which it is hidden afterwards.

    The measurement of a target that stays in sight must last until its next turn, or until it is visible again if it is
    about to hide. For systems that offer ``GainByTarget`` and whose belief has ``visible``, (env, H, target).

    Args:
        ahead: steps over which the gain of a pulse is summed where the target stays in sight.

    Raises:
        InputError: fewer than one step.
    """

    name = "hold-until-detected"
    needs = (GainByTarget,)

    def __init__(self, ahead: int = 4) -> None:
        self.ahead = check_int("ahead", ahead, 1)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        visible, rows = belief.visible, np.arange(len(belief.step))[:, None]
        when = belief.step[:, None] + np.arange(1, FAR + 1)
        back = visible[rows, np.minimum(when, visible.shape[1] - 1)]  # (env, step, target)
        hidden = np.where(back.any(axis=1), back.argmax(axis=1), FAR)
        values = self.system.gain(belief, 0, self.ahead + hidden)
        return self.candidates[greatest(values, mask, delays(self.system, belief))]
