"""Rules for systems whose pulses are paid from an account that must last to the episode's end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.capabilities import Gain, Spending, delays
from wavegym.core.errors import check_int, check_non_negative, check_positive
from wavegym.schedulers.heuristics.base import Heuristic, greatest

PRICES = 8  # tried at a time
STRIDES = (81, 9, 1)  # between them, on the ladder: each round divides one of the PRICES + 1 parts of the one before
# Prices in units of what one look could gain at most, 2.9 % apart: a table, so that a batch equals its elements.
LADDER = np.geomspace(1e-8, 10.0, 9 * STRIDES[0] + 1)
CUSHION = 1.0  # longest pulses, so that an account near its end sends the price neither to 0 nor to infinity
ROWS = 100_000  # beliefs followed at a time


class LagrangianPrice(Heuristic):
    """The greatest gain less price times spending.

    The price rises where less is left than one unit for each step left, and falls where more is: a feedback, as cheap
    in the futures that a planner simulates as in life.

    Args:
        price: of one unit of spending where one is left for each step left, in units of the cost.
        ahead: steps over which the gain of a look is summed.
        power: of the steps left over what is left; 0 for a constant price.

    Raises:
        InputError: a price or a power that is negative or not finite, fewer than one step.
    """

    name = "lagrangian-price"
    needs = (Gain, Spending)

    def __init__(self, price: float = 1.0, ahead: int = 8, power: float = 0.0) -> None:
        self.price, self.ahead = check_non_negative("price", price), check_int("ahead", ahead, 1)
        self.power = check_non_negative("power", power)

    def choose(self, belief: Any, mask: Array | None, settled: Array | None) -> Array:
        """See ``Heuristic``."""
        left = np.maximum(self.system.horizon - belief.step, 0)
        scarcity = (left + CUSHION) / (belief.energy + CUSHION)
        return priced_choice(self, belief, mask, self.price * scarcity**self.power)


class AdaptiveLagrangianPrice(Heuristic):
    """Priced, at the price with which what is left would last just to the end.

    At each step the rule is followed to the episode's end in the recursion that ``predict`` expects, with a purse that
    never empties, for a grid of prices at once; the interval in which the predicted spending comes down to what is left
    is divided again and again. Inside futures that a planner simulates that would be too dear: there the price settled
    at the root goes with the cube of what was predicted to be left by now over what is, so that the account does not
    run dry, nor is it left over, as if nobody watched it.

    Args:
        ahead: steps over which the gain of a look is summed.
        thrift: factor on what is left: the spending aimed at. Chance makes the spending differ from the prediction.

    Raises:
        InputError: fewer than one step, a thrift that is not positive.
    """

    name = "adaptive-lagrangian-price"
    needs = (Gain, Spending)

    def __init__(self, ahead: int = 8, thrift: float = 1.0) -> None:
        self.ahead, self.thrift = check_int("ahead", ahead, 1), check_positive("thrift", thrift)

    def settle(self, belief: Any) -> Array:
        """(env, 1 + H + 1): the lowest price, to 2.9 %, at which what is left lasts, and what is then left by step."""
        count, chunk = len(belief.step), max(1, ROWS // PRICES)
        parts = [trees.take(belief, np.arange(start, min(start + chunk, count))) for start in range(0, count, chunk)]
        return np.concatenate([self._settled(part) for part in parts])

    def choose(self, belief: Any, mask: Array | None, settled: Array | None) -> Array:
        """See ``Heuristic``; ``settled`` as ``settle`` returns it."""
        return priced_choice(self, belief, mask, self.price(belief, settled))

    def leftover(self, belief: Any, settled: Array | None) -> Array:
        """What the account still holds at the settled price where a simulated future is cut off, a cost (env,)."""
        return -np.asarray(settled)[:, 0] * belief.energy

    def price(self, belief: Any, settled: Any) -> Array:
        """The price at a belief, (env,): at the root the one settled."""
        predicted = settled[np.arange(len(settled)), 1 + np.minimum(belief.step, self.system.horizon)]
        ratio = (predicted + CUSHION) / (belief.energy + CUSHION)
        price: Array = settled[:, 0] * (ratio * ratio * ratio)
        return price

    def _settled(self, belief: Any) -> Array:
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
        """What is predicted to be left at each step, (env, H + 1), of what is there now."""
        left = np.repeat(belief.energy[:, None], self.system.horizon + 1, axis=1)
        rich = ample(self.system, belief)
        for here, rows in self._followed(rich, lambda here, rows: priced_choice(self, here, None, price[rows])):
            paid = (rich.energy[rows] - here.energy) / self.thrift
            left[rows, here.step] = np.maximum(belief.energy[rows] - paid, 0.0)
        return left

    def scale(self, belief: Any) -> Array:
        """The cost (env,) at the episode's end if the least is spent, for ``ahead`` steps: no look gains much more."""
        cheapest = int(np.argmin(self.system.spending))
        cost = np.zeros(len(belief.step))

        def silent(here: Any, rows: Array) -> Array:
            return np.full(len(rows), self.candidates[cheapest])

        for here, rows in self._followed(belief, silent):
            cost[rows] = self.system.cost(here)
        return np.maximum(cost, self.system.cost(belief)) * self.ahead

    def spent(self, belief: Any, prices: Array) -> Array:
        """What each price (env, price) is predicted to take from a full purse to the episode's end, (env, price)."""
        count = prices.shape[1]
        belief = ample(self.system, trees.repeated(belief, count))
        paid, held = np.zeros(prices.size), prices.ravel()
        for here, rows in self._followed(belief, lambda here, rows: priced_choice(self, here, None, held[rows])):
            paid[rows] = belief.energy[rows] - here.energy
        return paid.reshape(prices.shape)

    def _followed(self, belief: Any, choose: Callable[[Any, Array], Array]) -> Iterator[tuple[Any, Array]]:
        """The beliefs after each step of the expected recursion, to the episode's end, and which rows they are of."""
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
    """The greatest gain among the candidates that spend at most ``share`` of an even pace, or the least spending.

    Args:
        ahead: steps over which the gain of a look is summed.
        share: factor on what is left for each of the steps left.

    Raises:
        InputError: fewer than one step, a share that is not positive.
    """

    name = "constant-pace"
    needs = (Gain, Spending)

    def __init__(self, ahead: int = 1, share: float = 1.0) -> None:
        self.ahead, self.share = check_int("ahead", ahead, 1), check_positive("share", share)

    def choose(self, belief: Any, mask: Array | None, settled: Array | None) -> Array:
        """See ``Heuristic``."""
        spending = self.system.spending
        left = np.maximum(self.system.horizon - belief.step, 1)
        within = spending <= (self.share * belief.energy / left)[:, None]
        if mask is not None:
            within = within & mask
        gain = self.system.gain(belief, delays(self.system, belief), self.ahead)
        none = ~within.any(axis=1, keepdims=True)  # then the least spending that the mask allows
        values = np.where(none, -np.broadcast_to(spending, gain.shape), gain)
        open_to = np.where(none, True if mask is None else mask, within)
        return self.candidates[greatest(values, open_to, spending)]


def ample(system: Any, belief: Any) -> Any:
    """Beliefs with a purse that never empties."""
    return belief._replace(energy=np.full(len(belief.step), 2.0 * system.horizon * float(np.max(system.spending))))


def priced_choice(rule: Any, belief: Any, mask: Array | None, prices: Array | None) -> Array:
    """The greatest gain less spending times ``prices`` (env,); of equals the one that spends least."""
    spending = rule.system.spending
    gain = rule.system.gain(belief, delays(rule.system, belief), rule.ahead)
    values = gain - np.asarray(prices)[:, None] * spending
    return rule.candidates[greatest(values, mask, spending)]
