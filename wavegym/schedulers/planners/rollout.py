"""Rollout: every first action is tried, and the base policy follows it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wavegym.schedulers.planners.base import Planner

Array = NDArray[Any]

FINALISTS = 4  # first actions that are followed through all futures


class RolloutPlanner(Planner):
    """One step of policy iteration: first actions followed by the base policy in sampled futures (Bertsekas).

    Args: see ``Planner``.
    """

    def improved(self, public: Any, own: Array, mask: Array | None, settled: Array | None, rows: Array) -> Array:
        """See ``Planner``."""
        options, permitted = self.options(public, mask)
        return self.chosen(public, own, options[:, :, None], permitted, settled, FINALISTS)


class TreeSearch(Planner):
    """Every sequence of ``levels`` actions is tried, and the base policy follows it.

    Args:
        base, depth, futures, errors: see ``Planner``.
        levels: actions of a sequence; at most MOST sequences are tried, of the candidates of least one-step cost.
    """

    MOST = 4096

    def __init__(self, base: Any, levels: int, depth: int = 20, **settings: Any) -> None:
        super().__init__(base, max(depth, levels), **settings)
        self.levels = levels

    def begin(self, system: Any, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        super().begin(system, num_envs, rng)
        self.shortlist = min(self.shortlist, int(self.MOST ** (1.0 / self.levels) + 1e-9))

    def improved(self, public: Any, own: Array, mask: Array | None, settled: Array | None, rows: Array) -> Array:
        """See ``Planner``."""
        options, permitted = self.options(public, mask)
        count = options.shape[1]
        places = np.stack(np.meshgrid(*[np.arange(count)] * self.levels, indexing="ij"), axis=-1).reshape(
            -1, self.levels
        )
        return self.chosen(public, own, options[:, places], permitted[:, places[:, 0]], settled, FINALISTS)
