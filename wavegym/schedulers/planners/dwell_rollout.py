"""A rollout planner for one beam on a time line."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.shortcuts import scores, simulate
from wavegym.schedulers.heuristics.base import Heuristic
from wavegym.schedulers.heuristics.timeline_rules import SearchedDwell


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
