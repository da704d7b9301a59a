"""The learning curve: mean cost of the episodes that ended, not the reward that the agent was trained on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.arrays import Array


class Row(NamedTuple):
    """One point of the curve."""

    steps: int
    episodes: int
    cost: float  # mean over the episodes since the row before, of each one's mean cost per step


class LearningCurve:
    """Collects episode costs; belongs to a training run's state, so that a resumed run has no row twice."""

    def __init__(self, num_envs: int) -> None:
        self.rows: list[Row] = []
        self._sums, self._lengths = np.zeros(num_envs), np.zeros(num_envs, np.int64)
        self._finished: list[float] = []

    def add(self, cost: Array, ended: Array) -> None:
        """One step of every environment: cost (env,) after it, and whether it ended an episode."""
        self._sums += cost
        self._lengths += 1
        if ended.any():
            self._finished += (self._sums[ended] / self._lengths[ended]).tolist()
            self._sums[ended] = 0.0
            self._lengths[ended] = 0

    def close_row(self, steps: int, spacing: int) -> None:
        """Add a row at ``steps`` if episodes have ended and the last row is at least ``spacing`` steps back."""
        last = self.rows[-1].steps if self.rows else 0
        if self._finished and steps - last >= spacing:
            self.rows.append(Row(steps, len(self._finished), float(np.mean(self._finished))))
            self._finished = []

    def csv(self) -> str:
        """The rows as CSV."""
        return "\n".join([",".join(Row._fields), *(f"{r.steps},{r.episodes},{r.cost!r}" for r in self.rows)]) + "\n"
