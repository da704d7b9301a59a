"""Rollout, tree and beam search: actions, or sequences of actions, followed by the base policy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.core.policy import Policy
from wavegym.core.shortcuts import scores, simulate
from wavegym.schedulers.heuristics.base import Heuristic
from wavegym.schedulers.heuristics.timeline_rules import SearchedDwell
from wavegym.schedulers.planners.base import Planner

FINALISTS = 4  # plans that are simulated in all futures


class RolloutPlanner(Planner):
    """One step of policy iteration: first actions followed by the base policy in sampled futures (Bertsekas).

    Args:
        base, depth, futures, errors: see ``Planner``.
        holds: numbers of steps for which each first action is held before the base takes over: the base might at once
            abandon an action that takes several steps to pay. More than one step needs actions that are indices.

    Raises:
        InputError: a number out of range, or empty ``holds``.
    """

    def __init__(self, base: Policy, depth: int = 20, holds: Sequence[int] = (1,), **settings: Any) -> None:
        super().__init__(base, depth, **settings)
        if not holds:
            raise InputError("holds is empty, expected numbers of steps (nearest: (1,))")
        self.holds = tuple(check_int("holds", steps, 1) for steps in holds)

    def improved(self, belief: Any, own: Array, mask: Array | None, prepared: Array | None, rows: Array) -> Array:
        """See ``Planner``."""
        options, permitted = self.options(belief, mask)
        allowed = permitted.repeat(len(self.holds), axis=1)
        return self.chosen(belief, own, self._plans(options), allowed, prepared, FINALISTS)

    def advantages(self, belief: Any, mask: Array | None) -> Array:
        """The saving of each option over the mean cost of all options, as a share of that mean, (env, option).

        All options meet the same futures; the best of several holds counts. NaN where an option is not allowed. The
        estimate is noisy with next to no bias, so a few futures are enough to learn from.
        """
        options, permitted = self.options(belief, mask)
        draws = self.futures.draw(len(options))
        costs = self.futures.costs(belief, self._plans(options), self.futures.base.prepare(belief), draws).mean(axis=2)
        least = costs.reshape(*permitted.shape, -1).min(axis=2)
        least = np.where(permitted, least, np.nan)
        mean = np.nanmean(least, axis=1, keepdims=True)
        return np.divide(mean - least, mean, out=np.where(permitted, 0.0, np.nan), where=permitted & (mean > 0.0))

    def _plans(self, options: Array) -> Array:
        """Every option held for each number of steps, (env, option * hold, steps, ...)."""
        if max(self.holds) == 1:
            return options[:, :, None]
        is_held = np.arange(max(self.holds)) < np.array(self.holds)[:, None]  # (hold, step)
        return np.where(is_held, options[:, :, None, None], -1).reshape(len(options), -1, is_held.shape[1])


class TreeSearch(Planner):
    """Tries every sequence of ``levels`` actions, followed by the base policy.

    Args:
        base, depth, futures, errors: see ``Planner``.
        levels: length of a sequence. At most MOST sequences are tried, of the candidates of least one-step cost.
    """

    MOST = 4096

    def __init__(self, base: Any, levels: int, depth: int = 20, **settings: Any) -> None:
        super().__init__(base, max(depth, levels), **settings)
        self.levels = check_int("levels", levels, 1)
        self.shortlist = min(self.shortlist, int(self.MOST ** (1.0 / self.levels) + 1e-9))

    def improved(self, belief: Any, own: Array, mask: Array | None, prepared: Array | None, rows: Array) -> Array:
        """See ``Planner``."""
        options, permitted = self.options(belief, mask)
        count = options.shape[1]
        places = np.indices((count,) * self.levels).reshape(self.levels, -1).T
        return self.chosen(belief, own, options[:, places], permitted[:, places[:, 0]], prepared, FINALISTS)


class DwellRollout(Heuristic):
    """Simulate futures of the dwells with the greatest scores, and take the dwell of least cost.

    The base rule continues each future. The numbers of candidates, futures and seconds set the time of a decision.

    Args:
        base: the rule.
        futures: drawn for each candidate.
        candidates: dwells that are tried.
        seconds: length of a future.

    Raises:
        InputError: the base is another policy than ``searched-dwell``.
    """

    name = "dwell-rollout"
    needs = SearchedDwell.needs

    def __init__(self, base: Any, futures: int, candidates: int = 8, seconds: float = 0.1) -> None:
        if not isinstance(base, SearchedDwell):
            name = getattr(base, "name", type(base).__name__)
            raise InputError(f"base of {self.name} is {name!r}, expected {SearchedDwell.name!r}")
        self.rule, self.futures, self.tried, self.seconds = base.rule, futures, candidates, seconds

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        score = scores(self.system, belief, self.rule)
        if mask is not None:
            score = np.where(mask, score, -np.inf)
        best = np.argsort(-score, axis=1, kind="stable")[:, : self.tried]
        cost = simulate(self.system, belief, best, self.rule, self.seconds, self.futures)
        chosen: Array = best[np.arange(len(best)), cost.argmin(axis=1)]
        return chosen


class BeamSearch(Planner):
    """Beginnings of up to ``levels`` actions; the best ``width``, each followed by the base, are kept at every level.

    At most half of them begin with the same action, so that one first action does not crowd out all others.

    Args:
        base, depth, futures, errors: see ``Planner``.
        width: number of beginnings kept.
        levels: actions of a complete beginning.
        sampled: futures in which beginnings are compared while they grow; 0 for the expected recursion.
    """

    def __init__(
        self, base: Policy, width: int, depth: int = 20, levels: int = 4, sampled: int = 0, **settings: Any
    ) -> None:
        super().__init__(base, max(depth, levels), **settings)
        self.width, self.levels, self.sampled = (
            check_int("beam width", width, 1),
            check_int("levels", levels, 1),
            sampled,
        )

    def improved(self, belief: Any, own: Array, mask: Array | None, prepared: Array | None, rows: Array) -> Array:
        """See ``Planner``."""
        options, permitted = self.options(belief, mask)
        draws = self.futures.draw(len(rows), self.sampled) if self.sampled else None
        count, at = options.shape[1], np.arange(len(rows))[:, None]
        plans, first = options[:, :, None], np.broadcast_to(np.arange(count), (len(rows), count))
        allowed = permitted
        for level in range(1, self.levels + 1):
            values = self.futures.costs(belief, plans, prepared, draws).mean(axis=2)
            kept = _diverse(np.where(allowed, values, np.inf), first, self.width)
            plans, first, allowed = plans[at, kept], first[at, kept], allowed[at, kept]
            if level < self.levels:
                grown = np.repeat(plans, count, axis=1)
                ends = np.tile(options, (1, plans.shape[1], *(1,) * (options.ndim - 2)))
                plans = np.concatenate([grown, ends[:, :, None]], axis=2)
                first, allowed = np.repeat(first, count, axis=1), np.repeat(allowed, count, axis=1)
        return self.chosen(belief, own, plans, allowed, prepared)


def _diverse(values: Array, first: Array, width: int) -> Array:
    """Indices (env, <= width) of the least ``values`` (env, plan), at most half of them with the same ``first``."""
    order = np.argsort(values, axis=1, kind="stable")
    most, kept = max(1, (width + 1) // 2), min(width, values.shape[1])
    begins = np.take_along_axis(first, order, axis=1)
    earlier = np.tril(begins[:, :, None] == begins[:, None, :], -1).sum(axis=2)  # better ones that begin alike
    crowded = earlier >= most
    return np.take_along_axis(order, np.argsort(crowded, axis=1, kind="stable")[:, :kept], axis=1)
