"""Heuristics for systems whose pulses are paid from an account that must last to the episode's end.

Known occlusions tell the clear slots left, the hidden steps after the next slot, and a price by clear slots.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from wavegym.core import shortcuts, trees
from wavegym.core.arrays import Array
from wavegym.core.errors import check_int, check_non_negative, check_positive
from wavegym.schedulers.heuristics.base import Heuristic, greatest
from wavegym.schedulers.myopic import impossible

PRICES = 8  # tried at a time
STRIDES = (81, 9, 1)  # between prices on the ladder: each round divides one of the PRICES + 1 parts of the round before
# Prices in units of the greatest possible gain of a pulse, 2.9 % apart. A table, so that a batch equals its elements.
LADDER = np.geomspace(1e-8, 10.0, 9 * STRIDES[0] + 1)
CUSHION = 1.0  # longest pulses: keeps the price finite and positive when the account is nearly empty
ROWS = 100_000  # beliefs predicted at a time
FAR = 32  # steps: longest time out of sight that is distinguished


class LagrangianPrice(Heuristic):
    """The greatest gain minus price times spending.

    The price rises where the account holds less than one unit for each remaining step, and falls where it holds more.
    This feedback takes no simulation, so it also serves in the futures that a planner simulates.

    Args:
        price: of one unit of spending where the account holds one for each remaining step, in units of the cost.
        ahead: steps over which the gain of a pulse is summed.
        power: exponent of (remaining steps / account) in the price; 0 for a constant price.

    Raises:
        InputError: a price or a power that is negative or not finite, fewer than one step.
    """

    name = "lagrangian-price"
    needs = (shortcuts.gain, shortcuts.spending)

    def __init__(self, price: float = 1.0, ahead: int = 8, power: float = 0.0) -> None:
        self.price, self.ahead = check_non_negative("price", price), check_int("ahead", ahead, 1)
        self.power = check_non_negative("power", power)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        left = np.maximum(self.system.horizon - belief.step, 0)
        scarcity = (left + CUSHION) / (belief.energy + CUSHION)
        return priced_choice(self, belief, mask, self.price * scarcity**self.power)


class AdaptiveLagrangianPrice(Heuristic):
    """A Lagrangian price at which the account is predicted to last just to the episode's end.

    At each step a search finds this price. It follows the expected recursion of ``predict`` to the episode's end with
    an unlimited account, for several prices at once. It repeatedly divides the interval in which the predicted spending
    falls to the account. In a planner's simulated futures this search would take too long. There the price at the root
    is multiplied by the cube of (account predicted for this step / account), so that the account lasts exactly to the
    end.

    Args:
        ahead: steps over which the gain of a pulse is summed.
        thrift: share of the account that the predicted spending should use; the true spending differs by chance.

    Raises:
        InputError: fewer than one step, a thrift that is not positive.
    """

    name = "adaptive-lagrangian-price"
    needs = (shortcuts.gain, shortcuts.spending)

    def __init__(self, ahead: int = 8, thrift: float = 1.0) -> None:
        self.ahead, self.thrift = check_int("ahead", ahead, 1), check_positive("thrift", thrift)

    def prepare(self, belief: Any) -> Array:
        """(env, 1 + H + 1): lowest price at which the account lasts, to 2.9 %, and the account predicted by step."""
        count, chunk = len(belief.step), max(1, ROWS // PRICES)
        parts = [trees.take(belief, np.arange(start, min(start + chunk, count))) for start in range(0, count, chunk)]
        return np.concatenate([self._prepared(part) for part in parts])

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``; ``prepared`` as ``prepare`` returns it."""
        return priced_choice(self, belief, mask, self.price(belief, prepared))

    def leftover(self, belief: Any, prepared: Array | None) -> Array:
        """Minus the value of the account at the prepared price where a simulated future is cut off, a cost (env,)."""
        return -np.asarray(prepared)[:, 0] * belief.energy

    def price(self, belief: Any, prepared: Any) -> Array:
        """The price at a belief, (env,); at the root it is the prepared price."""
        predicted = prepared[np.arange(len(prepared)), 1 + np.minimum(belief.step, self.system.horizon)]
        ratio = (predicted + CUSHION) / (belief.energy + CUSHION)
        price: Array = prepared[:, 0] * (ratio * ratio * ratio)
        return price

    def _prepared(self, belief: Any) -> Array:
        aim, scale = self.thrift * belief.energy[:, None], self.scale(belief)[:, None]
        low = np.zeros((len(aim), 1), np.int64)
        for stride in STRIDES:
            levels = low + stride * np.arange(1, PRICES + 1)
            fits = self.spent(belief, scale * LADDER[levels]) <= aim
            below = np.where(fits.any(axis=1), np.argmax(fits, axis=1), PRICES)
            low += stride * below[:, None]
        price = (scale * LADDER[low + 1])[:, 0]
        return np.concatenate([price[:, None], self._left(belief, price)], axis=1)

    def _left(self, belief: Any, price: Array) -> Array:
        """The account predicted at each step, (env, H + 1)."""
        left = np.repeat(belief.energy[:, None], self.system.horizon + 1, axis=1)
        rich = ample(self.system, belief)
        for here, rows in self._followed(rich, lambda here, rows: priced_choice(self, here, None, price[rows])):
            paid = (rich.energy[rows] - here.energy) / self.thrift
            left[rows, here.step] = np.maximum(belief.energy[rows] - paid, 0.0)
        return left

    def scale(self, belief: Any) -> Array:
        """The cost (env,) at the episode's end under the least spending, times ``ahead``: no gain is much greater."""
        cheapest = int(np.argmin(shortcuts.spending(self.system)))
        cost = np.zeros(len(belief.step))

        def silent(here: Any, rows: Array) -> Array:
            return np.full(len(rows), self.candidates[cheapest])

        for here, rows in self._followed(belief, silent):
            cost[rows] = self.system.cost(here)
        return np.maximum(cost, self.system.cost(belief)) * self.ahead

    def spent(self, belief: Any, prices: Array) -> Array:
        """The predicted spending to the episode's end at each price (env, price), from an unlimited account."""
        count = prices.shape[1]
        belief = ample(self.system, trees.repeated(belief, count))
        paid, held = np.zeros(prices.size), prices.ravel()
        for here, rows in self._followed(belief, lambda here, rows: priced_choice(self, here, None, held[rows])):
            paid[rows] = belief.energy[rows] - here.energy
        return paid.reshape(prices.shape)

    def _followed(self, belief: Any, choose: Callable[[Any, Array], Array]) -> Iterator[tuple[Any, Array]]:
        """The beliefs after each step of the expected recursion to the episode's end, and their rows in ``belief``."""
        rows = np.arange(len(belief.step))
        while True:
            is_on = ~self.system.terminal(belief)
            if not is_on.all():
                belief, rows = trees.take(belief, is_on), rows[is_on]
            if not len(rows):
                return
            belief = self.system.predict(belief, choose(belief, rows))
            yield belief, rows


class ConstantPace(Heuristic):
    """The greatest gain among the candidates that spend at most ``share`` of a constant pace, or the least spending.

    Args:
        ahead: steps over which the gain of a pulse is summed.
        share: factor on the constant pace, which is the account over the remaining steps.

    Raises:
        InputError: fewer than one step, a share that is not positive.
    """

    name = "constant-pace"
    needs = (shortcuts.gain, shortcuts.spending)

    def __init__(self, ahead: int = 1, share: float = 1.0) -> None:
        self.ahead, self.share = check_int("ahead", ahead, 1), check_positive("share", share)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        spending = shortcuts.spending(self.system)
        left = np.maximum(self.system.horizon - belief.step, 1)
        within = spending <= (self.share * belief.energy / left)[:, None]
        if mask is not None:
            within = within & mask
        gain = shortcuts.gain(self.system, belief, shortcuts.delay(self.system, belief), self.ahead)
        none = ~within.any(axis=1, keepdims=True)  # in this case the least spending that the mask allows
        values = np.where(none, -np.broadcast_to(spending, gain.shape), gain)
        open_to = np.where(none, True if mask is None else mask, within)
        return self.candidates[greatest(values, open_to, spending)]


def ample(system: Any, belief: Any) -> Any:
    """The beliefs with an unlimited account."""
    most = float(np.max(shortcuts.spending(system)))
    return belief._replace(energy=np.full(len(belief.step), 2.0 * system.horizon * most))


def priced_choice(heuristic: Any, belief: Any, mask: Array | None, prices: Array | None) -> Array:
    """The greatest gain minus spending times ``prices`` (env,); among equals the one that spends least."""
    spending = shortcuts.spending(heuristic.system)
    gain = shortcuts.gain(heuristic.system, belief, shortcuts.delay(heuristic.system, belief), heuristic.ahead)
    values = gain - np.asarray(prices)[:, None] * spending
    return heuristic.candidates[greatest(values, mask, spending)]


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
