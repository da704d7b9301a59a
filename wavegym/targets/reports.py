"""Filters of one target's reports: recorders repeat positions, set late time stamps and lose altitudes."""

from __future__ import annotations

import math
from heapq import heapify, heappop, heappush

import numpy as np
from numpy.typing import NDArray

from wavegym.core.arrays import FloatArray

Mask = NDArray[np.bool_]
POSITION_TOLERANCE = 25.0  # m: quantisation and noise of position reports


def last_of_each_time(times: FloatArray) -> Mask:
    """Mask (report,) of the last report of each time; times ascend."""
    return np.append(times[1:] != times[:-1], True)


def fresh(horizontal: FloatArray, height: FloatArray) -> Mask:
    """Mask (report,) of the reports that do not repeat the previous position.

    A recorder without new data repeats the last position with a new time: the target would seem to stop and then jump.
    A height (report,) may be missing (NaN); horizontal is (report, 2).
    """
    same_height = (height[1:] == height[:-1]) | np.isnan(height[1:]) | np.isnan(height[:-1])
    return np.append(True, ~((horizontal[1:] == horizontal[:-1]).all(axis=1) & same_height))


def fill_heights(times: FloatArray, height: FloatArray) -> tuple[FloatArray, bool]:
    """Heights (report,) with missing heights (NaN) interpolated in time, held at the ends; whether any was known."""
    known = ~np.isnan(height)
    if not known.any():
        return np.zeros_like(height), False
    return np.interp(times, times[known], height[known]), True


def flyable(times: FloatArray, positions: FloatArray, max_acceleration: float) -> Mask:
    """Mask (report,) of the reports that a target can reach with at most ``max_acceleration`` [m/s²].

    A position with a time stamp s seconds late lies s times the speed behind the path. The suspicion of a report is its
    distance to the chord between its neighbours relative to the greatest distance under an acceleration a,
    a h₁ h₂ / 2 (h: the times to the neighbours). Reports are removed until no suspicion exceeds 1. Each removal
    takes the worst report or a neighbour: the one that leaves the fewest suspects, then the least total suspicion.

    Args:
        times: ascending [s], (report,).
        positions: metres, (report, 3).
        max_acceleration: limit [m/s²], beyond ``POSITION_TOLERANCE``; inf keeps all reports.
    """
    level = np.zeros(len(times))
    level[1:-1] = _suspicion(times, positions, max_acceleration)
    if not (level > 1).any():
        return np.ones(len(times), np.bool_)
    chain = _Chain(times.tolist(), positions.tolist(), level.tolist(), max_acceleration)
    chain.remove_suspects()
    return np.array(chain.is_kept, np.bool_)


class _Chain:
    """The reports as a linked list, with a heap of those that are suspect: a removal costs the same in any file."""

    def __init__(self, times: list[float], positions: list[list[float]], level: list[float], limit: float) -> None:
        count = len(times)
        self.times, self.positions, self.level, self.limit = times, positions, level, limit
        self.before, self.after = list(range(-1, count - 1)), list(range(1, count + 1))
        self.is_kept = [True] * count

    def remove_suspects(self) -> None:
        """Remove reports until none is suspect; of equal suspicions the first report's comes first."""
        heap = [(-suspicion, i) for i, suspicion in enumerate(self.level) if suspicion > 1]
        heapify(heap)
        while heap:
            suspicion, worst = heappop(heap)
            if not self.is_kept[worst] or self.level[worst] != -suspicion:
                continue  # the entry is out of date
            gone = self._best_removal(worst)
            left, right = self.before[gone], self.after[gone]
            self.is_kept[gone] = False
            for i in self._link(left, right):
                self.level[i] = self._level(self.before[i], i, self.after[i])
                if self.level[i] > 1:
                    heappush(heap, (-self.level[i], i))

    def _link(self, left: int, right: int) -> list[int]:
        """Make two reports neighbours; those of them that exist."""
        if left >= 0:
            self.after[left] = right
        if right < len(self.times):
            self.before[right] = left
        return [i for i in (left, right) if 0 <= i < len(self.times)]

    def _best_removal(self, worst: int) -> int:
        """The worst report or a neighbour: see ``flyable``."""
        near = [worst]
        for _ in range(3):  # a removal changes the suspicion of neighbours only
            first, last = self.before[near[0]], self.after[near[-1]]
            near = [*([first] if first >= 0 else []), *near, *([last] if last < len(self.times) else [])]
        remaining = {}
        for suspect in (worst, self.before[worst], self.after[worst]):  # the worst first: it wins a tie
            others = [i for i in near if i != suspect]
            left = [self._level(*three) for three in zip(others, others[1:], others[2:], strict=False)]
            remaining[suspect] = (sum(level > 1 for level in left), sum(left))
        return min(remaining, key=remaining.__getitem__)

    def _level(self, before: int, here: int, after: int) -> float:
        """``_suspicion`` of one report, with the same roundings."""
        if before < 0 or after >= len(self.times):
            return 0.0
        h1, h2 = self.times[here] - self.times[before], self.times[after] - self.times[here]
        weight, square = h1 / (h1 + h2), 0.0
        for p, q, r in zip(self.positions[before], self.positions[here], self.positions[after], strict=True):
            away = q - ((1 - weight) * p + weight * r)
            square += away * away
        return math.sqrt(square) / (POSITION_TOLERANCE + self.limit * h1 * h2 / 2)


def _suspicion(times: FloatArray, positions: FloatArray, max_acceleration: float) -> FloatArray:
    """Distance of each inner report to its neighbours' chord relative to the allowed distance, (report - 2,)."""
    if len(times) < 3:
        return np.zeros(0)
    before, after = times[1:-1] - times[:-2], times[2:] - times[1:-1]
    weight = (before / (before + after))[:, None]
    chord = (1 - weight) * positions[:-2] + weight * positions[2:]
    allowed = POSITION_TOLERANCE + max_acceleration * before * after / 2
    return np.linalg.norm(positions[1:-1] - chord, axis=1) / allowed
