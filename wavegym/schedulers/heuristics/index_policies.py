"""Index policies: one number for each candidate, from the gain and the delay of its pulse."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import shortcuts, trees
from wavegym.core.arrays import Array
from wavegym.core.errors import check_int, check_non_negative
from wavegym.core.horizon_weights import horizon_weights
from wavegym.core.shortcuts import delay, gain_by_target, linear_cost
from wavegym.core.system import System
from wavegym.schedulers.heuristics.base import Heuristic, greatest
from wavegym.schedulers.heuristics.price_policies import hidden_steps
from wavegym.schedulers.myopic import impossible

BELIEFS = 200_000  # in memory at a time


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

    The value is gain(delay) - alpha * gain(delay + later), divided by (1 + delay)^power. It is multiplied by 1 + bonus
    if the delay is 0, which favours the present set-up. A target that will be hidden soon has no gain later, so it
    comes first. A target that loses nothing by a delay waits.

    Args:
        alpha: weight of the gain of the same pulse ``later`` steps later.
        later: steps of the postponement.
        ahead: steps over which the gain of a pulse is summed.
        power: exponent of the steps that a candidate takes.
        bonus: factor for the present set-up, minus 1.

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


class Gain(Heuristic):
    """L-step gain: the candidate after which the next ``ahead`` steps cost least without further measurements.

    It minimises trace(M P) summed over the targets, with P as ``predict`` expects it after one step and M of
    ``horizon_weights``. It needs one ``predict``, one covariance for each target and a linear motion model. With
    ``ahead=1`` it is the myopic scheduler. A pulse with a delay has no gain here; for delays see ``AwareGreedy`` and
    ``CostOfDelay``.

    Args:
        ahead: L, steps.

    Raises:
        InputError: fewer than one step.
    """

    needs = (linear_cost,)

    def __init__(self, ahead: int) -> None:
        self.ahead = check_int("ahead", ahead, 1)
        self.name = f"gain:{self.ahead}"

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        super().begin(system, num_envs, rng)
        known = linear_cost(system)
        self._weights = horizon_weights(known.F, known.weights, self.ahead)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``. Raises an InputError where the belief has no covariance."""
        if not hasattr(belief, "covariance"):
            raise impossible(self.name, self.system, "its belief has no single covariance")
        count, chunk = len(belief.step), max(1, BELIEFS // len(self.candidates))
        values = np.empty((count, len(self.candidates)))
        for start in range(0, count, chunk):
            part = np.arange(start, min(start + chunk, count))
            predicted = self.system.predict(trees.take(belief, part), self.candidates[None])
            values[part] = weighted(predicted.covariance, self._weights)
        return self.candidates[np.argmin(values if mask is None else np.where(mask, values, np.inf), axis=1)]


def weighted(covariance: Array, M: Array) -> Array:
    """trace(M P) summed over the targets, (env, candidate), of covariances (env, candidate[, target], n, n)."""
    products = covariance * M
    return products.reshape(*products.shape[:2], -1).sum(axis=2)
