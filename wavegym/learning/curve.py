"""The learning curve: mean cost of finished episodes, not the training reward."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.files import csv_text


class Row(NamedTuple):
    """One point of the curve."""

    steps: int
    episodes: int
    cost: float  # mean cost per step of each episode since the last row, averaged


class LearningCurve:
    """Collects episode costs, and the CPU time of the run. A part of its snapshots: a resumed run repeats no row.

    Args:
        num_envs: of the training.
        planned: steps of the whole training.
    """

    def __init__(self, num_envs: int, planned: int) -> None:
        self.rows: list[Row] = []
        self.cpu_seconds = 0.0
        self.planned, self.extended_from = planned, list[int]()
        self._sums, self._lengths = np.zeros(num_envs), np.zeros(num_envs, np.int64)
        self._finished: list[float] = []

    def add(self, cost: Array, ended: Array) -> None:
        """Add one step of every environment: cost (env,) after the step, and whether the episode ended (env,) bool."""
        self._sums += cost
        self._lengths += 1
        if ended.any():
            self._finished += (self._sums[ended] / self._lengths[ended]).tolist()
            self._sums[ended] = 0.0
            self._lengths[ended] = 0

    def extend(self, planned: int) -> None:
        """Plan this number of steps, and note an earlier plan if it was different."""
        if planned != self.planned:
            self.extended_from.append(self.planned)
            self.planned = planned

    def close_row(self, steps: int, spacing: int) -> None:
        """Add a row at ``steps`` if episodes have ended and the last row is at least ``spacing`` steps earlier."""
        last = self.rows[-1].steps if self.rows else 0
        if self._finished and steps - last >= spacing:
            self.rows.append(Row(steps, len(self._finished), float(np.mean(self._finished))))
            self._finished = []

    def saved(self) -> dict[str, Any]:
        """All of it, as plain values and arrays."""
        return {**vars(self), "rows": [list(row) for row in self.rows]}

    @classmethod
    def restored(cls, saved: dict[str, Any]) -> LearningCurve:
        """The curve of ``saved``. Raises a KeyError, TypeError or ValueError for anything else."""
        curve = cls(len(saved["_sums"]), saved["planned"])
        for name in vars(curve):
            setattr(curve, name, saved[name])
        curve.rows = [Row(int(steps), int(episodes), float(cost)) for steps, episodes, cost in saved["rows"]]
        return curve

    def csv(self) -> str:
        """The rows as CSV."""
        return csv_text(Row._fields, self.rows)
