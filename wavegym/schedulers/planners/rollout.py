"""Rollout: every first action is tried, and the base policy follows it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.core.policy import Policy
from wavegym.schedulers.planners.base import Planner

FINALISTS = 4  # first actions that are followed through all futures


class RolloutPlanner(Planner):
    """One step of policy iteration: first actions followed by the base policy in sampled futures (Bertsekas).

    Args:
        base, depth, futures, errors: see ``Planner``.
        holds: numbers of steps for which each first action is held before the base takes over; the base by itself might
            give up at once what takes several steps. For more than one step actions have to be indices.

    Raises:
        InputError: a number out of range, nothing held.
    """

    def __init__(self, base: Policy, depth: int = 20, holds: Sequence[int] = (1,), **settings: Any) -> None:
        super().__init__(base, depth, **settings)
        if not holds:
            raise InputError("holds is empty, expected numbers of steps (nearest: (1,))")
        self.holds = tuple(check_int("holds", steps, 1) for steps in holds)

    def improved(self, belief: Any, own: Array, mask: Array | None, settled: Array | None, rows: Array) -> Array:
        """See ``Planner``."""
        options, permitted = self.options(belief, mask)
        allowed = permitted.repeat(len(self.holds), axis=1)
        return self.chosen(belief, own, self._plans(options), allowed, settled, FINALISTS)

    def advantages(self, belief: Any, mask: Array | None) -> Array:
        """What each option saves of the mean cost of all options' futures, as a share of it, (env, option).

        All options meet the same futures; of several holds the best counts. NaN where an option is not allowed. It is a
        noisy estimate whose error has next to no mean, so that a few futures are enough to learn from.
        """
        options, permitted = self.options(belief, mask)
        draws = self.futures.draw(len(options))
        costs = self.futures.costs(belief, self._plans(options), self.futures.base.settle(belief), draws).mean(axis=2)
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
    """Every sequence of ``levels`` actions is tried, and the base policy follows it.

    Args:
        base, depth, futures, errors: see ``Planner``.
        levels: actions of a sequence; at most MOST sequences are tried, of the candidates of least one-step cost.
    """

    MOST = 4096

    def __init__(self, base: Any, levels: int, depth: int = 20, **settings: Any) -> None:
        super().__init__(base, max(depth, levels), **settings)
        self.levels = check_int("levels", levels, 1)
        self.shortlist = min(self.shortlist, int(self.MOST ** (1.0 / self.levels) + 1e-9))

    def improved(self, belief: Any, own: Array, mask: Array | None, settled: Array | None, rows: Array) -> Array:
        """See ``Planner``."""
        options, permitted = self.options(belief, mask)
        count = options.shape[1]
        places = np.indices((count,) * self.levels).reshape(self.levels, -1).T
        return self.chosen(belief, own, options[:, places], permitted[:, places[:, 0]], settled, FINALISTS)
