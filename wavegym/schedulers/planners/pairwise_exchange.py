"""Plans whose actions are paid from one account: pairs of changes, of which one pays for the other."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.shortcuts import spending
from wavegym.schedulers.heuristics.price_policies import ample
from wavegym.schedulers.planners.sampled_futures import SampledFutures

FAR, NEAR = 200, 300  # pairs of changes that are simulated: of any two steps, of two close steps
CLOSE = 3  # steps
MERGED = 100  # greatest number of pairs that are made together
ROUND = 1e-9  # of the account


def exchanged(
    futures: SampledFutures,
    belief: Any,
    plan: Array,
    options: Array,
    prepared: Array | None,
    draws: Array | None,
    rounds: int,
) -> Array:
    """Plans (env, depth) improved by exchanging energy between steps, one environment after the other.

    Every round simulates each change of one step with an account that never empties. The most promising pairs of
    changes that stay within the account are then simulated with the real account. All pairs that save cost and are
    apart from each other are made at once. The search ends when no pair saves cost.

    Args:
        futures: simulate the plans.
        belief: beliefs, axis 0 = environment.
        plan: actions to begin with, (env, depth).
        options: actions to choose from, (env, option).
        prepared: result of the base's ``prepare``.
        draws: of ``SampledFutures.draw``; None: the expected recursion.
        rounds: greatest number of rounds.
    """
    found = plan.copy()
    for env in range(len(plan)):
        at = slice(env, env + 1)
        one = trees.take(belief, np.array([env]))
        own, drawn = None if prepared is None else prepared[at], None if draws is None else draws[:, at]
        found[env] = _exchanged_one(futures, one, plan[env], options[env], own, drawn, rounds)
    return found


def _exchanged_one(
    futures: SampledFutures,
    belief: Any,
    plan: Array,
    options: Array,
    prepared: Array | None,
    draws: Array | None,
    rounds: int,
) -> Array:
    """``exchanged`` of one environment: ``belief`` (1,), ``plan`` (depth,), ``options`` (option,)."""
    system: Any = futures.system
    steps = min(system.horizon - int(belief.step[0]), len(plan))
    rich = ample(system, belief)

    def judged(purse: Any, plans: Array) -> Array:
        costs: Array = futures.costs(purse, plans[None], prepared, draws)[0].mean(axis=1)
        return costs

    for _ in range(rounds):
        single = _Singles(plan, options, steps, spending(system))
        single.judge(partial(judged, rich))
        better = _traded(single, partial(judged, belief), float(belief.energy[0]))
        if better is None:
            break
        plan = better
    return plan


class _Singles:
    """Changes of one step of a plan (depth,): the step, the new action, the energy paid and the cost added.

    The first entry is no change. Of changes at one step with the same energy only the best is kept.
    """

    def __init__(self, plan: Array, options: Array, steps: int, spending: Array) -> None:
        at, to = (a.ravel() for a in np.meshgrid(np.arange(steps), options, indexing="ij"))
        is_new = to != plan[at]
        self.plan, self.spent = plan, float(spending[plan[:steps]].sum())
        self.at, self.to = np.append(-1, at[is_new]), np.append(plan[-1], to[is_new])
        self.paid = np.append(0.0, (spending[to] - spending[plan[at]])[is_new])

    def judge(self, costs: Callable[[Array], Array]) -> None:
        """Find the cost that each change adds, and drop the changes that another one dominates."""
        values = costs(self.made(np.arange(len(self.at))[:, None]))
        self.added = values - values[0]
        order = np.lexsort((self.added, self.paid, self.at))
        is_first = np.append(True, (np.diff(self.at[order]) != 0) | (np.diff(self.paid[order]) != 0))
        best = order[is_first]
        self.at, self.to, self.paid, self.added = (a[best] for a in (self.at, self.to, self.paid, self.added))

    def made(self, changes: Array) -> Array:
        """The plan after changes (plan, change): (plan, depth). Later changes of a row overwrite earlier ones."""
        plans = np.repeat(self.plan[None], len(changes), axis=0)
        for column in changes.T:
            plans[np.arange(len(plans)), self.at[column]] = self.to[column]
        return plans


def _traded(single: _Singles, judge: Callable[[Array], Array], energy: float) -> Array | None:
    """The plan after the pairs of changes that save most, or None if no pair saves cost."""
    slack = energy - single.spent + ROUND
    pairs = _promising(single, slack)
    values = judge(np.concatenate([single.plan[None], single.made(pairs)]))
    saved = values[1:] - values[0]
    order = np.argsort(saved, kind="stable")[:MERGED]
    taken: list[int] = []
    touched = np.zeros(len(single.plan), np.bool_)
    for pair in pairs[order[saved[order] < 0.0]]:
        steps = single.at[pair][single.at[pair] >= 0]
        paid = float(single.paid[[*taken, *pair]].sum())
        if paid <= slack and not touched[steps].any():
            taken += pair.tolist()
            for step in steps:
                touched[max(step - CLOSE, 0) : step + CLOSE + 1] = True
    if not taken:
        return None
    growing = np.zeros((len(taken) // 2, len(taken)), np.int64)  # the first pair, the first two, ...; 0: no change
    for row in range(len(growing)):
        growing[row, : 2 * row + 2] = taken[: 2 * row + 2]
    # "No change" writes the last step's old action, so it comes first: a change of that step must overwrite it.
    plans = single.made(np.sort(growing, axis=1))
    costs = judge(plans)
    best = int(costs.argmin())
    return plans[best] if costs[best] < values[0] else None


def _promising(single: _Singles, slack: float) -> Array:
    """Pairs of changes (pair, 2), the earlier step first, that fit the account; those of least summed added cost."""
    first, second = single.at[:, None], single.at
    fits = (first < second) & (single.paid[:, None] + single.paid <= slack)
    promised = np.where(fits, single.added[:, None] + single.added, np.inf)
    is_close = (second - first <= CLOSE) & (first >= 0)
    best = np.union1d(_least(promised, FAR), _least(np.where(is_close, promised, np.inf), NEAR))
    return np.stack(np.unravel_index(best, promised.shape), axis=1)


def _least(values: Array, count: int) -> Array:
    """Flat indices of the ``count`` least values, finite ones only."""
    flat = values.ravel()
    best = np.argpartition(flat, count - 1)[:count] if count < len(flat) else np.arange(len(flat))
    return best[np.isfinite(flat[best])]
