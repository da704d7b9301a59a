"""Index policies: one number for each candidate, from the gain and the delay of its pulse."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.arrays import Array
from wavegym.core.errors import check_int, check_non_negative
from wavegym.core.system import System
from wavegym.schedulers.heuristics.base import Heuristic, greatest


class Greedy(Heuristic):
    """The candidate of the greatest gain, delays ignored.

    Args:
        ahead: steps over which the gain of a pulse is summed.

    Raises:
        InputError: fewer than one step.
    """

    name = "greedy"
    needs = (shortcuts.gain,)

    def __init__(self, ahead: int = 1) -> None:
        self.ahead = check_int("ahead", ahead, 1)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        gain = shortcuts.gain(self.system, belief, 0, self.ahead)
        return self.candidates[greatest(gain, mask, shortcuts.delay(self.system, belief))]


class AwareGreedy(Heuristic):
    """The greatest gain at the time of the pulse, divided by 1 + kappa * delay.

    Args:
        kappa: weight of a step of delay, >= 0.
        ahead: steps over which the gain of a pulse is summed.

    Raises:
        InputError: a kappa that is negative or not finite, fewer than one step.
    """

    name = "aware-greedy"
    needs = (shortcuts.gain, shortcuts.delay)

    def __init__(self, kappa: float = 0.4, ahead: int = 1) -> None:
        self.kappa, self.ahead = check_non_negative("kappa", kappa), check_int("ahead", ahead, 1)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        delay = shortcuts.delay(self.system, belief)
        values = shortcuts.gain(self.system, belief, delay, self.ahead) / (1.0 + self.kappa * delay)
        return self.candidates[greatest(values, mask, delay)]


class CostOfDelay(Heuristic):
    """The loss by postponing a candidate's pulse, per step of its delay.

    The value is gain(delay) - alpha * gain(delay + later), divided by (1 + delay)^power, and times 1 + bonus where the
    delay is 0, which favours the present set-up. A target that will be hidden soon has no gain later, so it comes
    first. A target that loses nothing by a delay waits.

    Args:
        alpha: weight of the gain of the same pulse ``later`` steps later.
        later: steps of the postponement.
        ahead: steps over which the gain of a pulse is summed.
        power: exponent of the steps that a candidate takes.
        bonus: factor for the present set-up, less 1.

    Raises:
        InputError: a constant that is negative or not finite, or fewer than one step.
    """

    name = "cost-of-delay"
    needs = (shortcuts.gain,)

    def __init__(
        self, alpha: float = 0.6, later: int = 9, ahead: int = 14, power: float = 1.3, bonus: float = 0.3
    ) -> None:
        self.alpha, self.power = check_non_negative("alpha", alpha), check_non_negative("power", power)
        self.bonus = check_non_negative("bonus", bonus)
        self.later, self.ahead = check_int("later", later, 1), check_int("ahead", ahead, 1)

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        super().begin(system, num_envs, rng)
        # A table, because NumPy's powers of long and short arrays may differ in the last bit.
        self._scale = (1.0 + np.arange(system.horizon + 1)) ** -self.power
        self._scale[0] *= 1.0 + self.bonus

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        delay = shortcuts.delay(self.system, belief)
        gain = shortcuts.gain(self.system, belief, delay, self.ahead)
        if self.alpha:
            gain = gain - self.alpha * shortcuts.gain(self.system, belief, delay + self.later, self.ahead)
        scale = self._scale[np.minimum(delay, self.system.horizon)]
        return self.candidates[greatest(np.where(gain > 0, gain * scale, gain / scale), mask, delay)]
