"""Known occlusions: the clear slots left, the hidden steps after the next slot, and a price by clear slots."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import shortcuts, trees
from wavegym.core.arrays import Array
from wavegym.core.errors import check_non_negative, check_positive
from wavegym.schedulers.heuristics.base import Heuristic, greatest
from wavegym.schedulers.myopic import impossible

FAR = 32  # steps: longest time out of sight that is distinguished


def hidden_steps(belief: Any) -> Array:
    """Hidden steps between the next slot and the first clear slot after it, at most FAR, (env,) or (env, target).

    Args:
        belief: has ``visible``, (env, H) or (env, H, target), and ``step``. The last slot stands for those after it.
    """
    visible, rows = belief.visible, np.arange(len(belief.step))[:, None]
    when = belief.step[:, None] + np.arange(1, FAR + 1)
    back = visible[rows, np.minimum(when, visible.shape[1] - 1)]  # (env, step[, target])
    hidden: Array = np.where(back.any(axis=1), back.argmax(axis=1), FAR)
    return hidden


def clear_slots_left(belief: Any, horizon: int) -> Array:
    """The clear slots from this one to the episode's end, (env,): those in which some target is visible.

    Args:
        belief: has ``visible``, (env, H) or (env, H, target), and ``step``.
        horizon: H.
    """
    left: Array = (_some(belief.visible) & (np.arange(horizon) >= belief.step[:, None])).sum(axis=1)
    return left


def _some(visible: Array) -> Array:
    """Whether some target is visible in each slot, (env, H)."""
    some: Array = visible if visible.ndim == 2 else np.any(visible, axis=2)
    return some


def gain_until_clear(system: Any, belief: Any, ahead: Array) -> Array:
    """Gain of each candidate over ``ahead`` (env,) steps, (env, candidate): one call for each number of steps."""
    out = np.empty((len(belief.step), len(system.candidates())))
    for steps in np.unique(ahead):
        rows = np.flatnonzero(ahead == steps)
        part = trees.take(belief, rows)
        out[rows] = shortcuts.gain(system, part, shortcuts.delay(system, part), int(steps))
    return out


class ClearSlotPrice(Heuristic):
    """The greatest gain until the next clear slot, minus a price of energy by the number of clear slots left.

    The gain of a look is summed over ``ahead`` steps and ``reach`` times the hidden steps that follow this slot: a look
    in the last clear slot must last until the target is visible again. The price is ``price`` times
    ((clear slots left + ``cushion``) / (energy + 1))^``power`` times (present cost)^``scale``. Energy is useful in
    clear slots only, so their number measures its scarcity. For systems that have ``gain`` and ``spending`` and whose
    belief has ``visible``, (env, H) or (env, H, target).

    Args:
        price: of one unit of spending.
        power: exponent of the scarcity.
        cushion: clear slots that are added.
        ahead: steps over which the gain of a pulse is summed where the next slot is clear.
        reach: weight of the hidden steps.
        scale: exponent of the present cost; with 1 the price is relative to it.

    Raises:
        InputError: an invalid constant, or a belief without ``visible``.
    """

    name = "clear-slot-price"
    needs = (shortcuts.gain, shortcuts.spending)

    def __init__(
        self,
        price: float = 100.0,
        power: float = 1.0,
        cushion: float = 1.0,
        ahead: float = 4.0,
        reach: float = 1.0,
        scale: float = 0.0,
    ) -> None:
        self.price, self.power = check_non_negative("price", price), check_non_negative("power", power)
        self.cushion, self.ahead = check_non_negative("cushion", cushion), check_positive("ahead", ahead)
        self.reach, self.scale = check_non_negative("reach", reach), check_non_negative("scale", scale)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        if not hasattr(belief, "visible"):
            raise impossible(self.name, self.system, "its belief does not know when slots are clear")
        hidden = hidden_steps(belief._replace(visible=_some(belief.visible)))
        ahead = np.maximum(np.rint(self.ahead + self.reach * hidden), 1.0).astype(np.int64)
        gain = gain_until_clear(self.system, belief, ahead)
        spending = shortcuts.spending(self.system)
        values = gain - self._prices(belief)[:, None] * spending
        return self.candidates[greatest(values, mask, spending)]

    def _prices(self, belief: Any) -> Array:
        """The price of one unit of spending, (env,)."""
        clear = clear_slots_left(belief, self.system.horizon)
        scarcity = (clear + self.cushion) / (belief.energy + 1.0)
        # one power at a time: NumPy's powers of long and short arrays may differ in the last bit
        factors = [
            self.price * float(ratio) ** self.power * float(cost) ** self.scale
            for ratio, cost in zip(scarcity, self.system.cost(belief), strict=True)
        ]
        return np.array(factors)
