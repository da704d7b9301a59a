"""Beam search: the best few beginnings of a plan are grown step by step, with a limit on equal first actions."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import check_int
from wavegym.core.policy import Policy
from wavegym.schedulers.planners.base import Planner


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
