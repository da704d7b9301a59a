"""Rollout and tree search: every action, or sequence of actions, followed by the base policy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.core.policy import Policy
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
