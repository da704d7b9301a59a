"""H-step lookahead: the first action of the cheapest predicted sequence."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.action_sets import PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.shortcuts import best_sequence, plan
from wavegym.core.system import System
from wavegym.schedulers.rollout import check_equal_steps

NODES = 200_000  # beliefs in memory at a time, about 20 MB for two states
SEQUENCES = 1_000_000  # tried in one decision: enough for 88 candidates three steps ahead


class Lookahead:
    """The first action of the best sequence of ``depth`` candidates; sequences are shorter near the episode's end.

    The system's own search is used where it has ``best_sequence`` (the same, compiled) or ``plan`` (a local search of
    any depth), and nothing is masked. Otherwise every sequence is tried by repeated ``predict``, in chunks of at most
    ``NODES`` beliefs.

    Args:
        depth: steps ahead; 1 is the myopic scheduler.
        fused: whether the system's own search may be used.
        most: sequences of several steps that may be tried in one decision; a ``plan`` has no limit.

    Raises:
        InputError: a depth below 1.
    """

    def __init__(self, depth: int, fused: bool = True, most: int = SEQUENCES) -> None:
        if depth < 1:
            raise InputError(f"lookahead depth is {depth}, expected at least 1 (nearest: 1)")
        self.depth, self.fused, self.most = depth, fused, most

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``.

        Raises:
            InputError: steps that differ in length, or more than ``most`` sequences (nearest depth named).
        """
        check_equal_steps("lookahead", system)
        self._system: Any = system
        self._sequence = best_sequence.of(system) if self.fused else None
        self._plan = plan.of(system) if self.fused and not self._sequence else None
        self._ready = False
        if not self._plan:
            self._enumerate()

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``. Where a mask forbids the system's plan, raises as ``begin`` does."""
        if self._plan and mask is None:
            return self._plan(belief, self.depth)[0]
        if not self._ready:
            self._enumerate()
        if self._sequence and mask is None:
            first, _ = self._sequence(belief, self.depth)
        else:
            first = np.argmin(self._values(belief, self.depth, mask), axis=1)
        return self._candidates[first]

    def values(self, belief: Any) -> Array:
        """Predicted cost of the best sequence that starts with each candidate, (env, candidate); nothing masked."""
        if not self._ready:
            self._enumerate()
        return self._values(belief, self.depth, None)

    def _enumerate(self) -> None:
        """List the candidates. Raises an InputError where they make too many sequences."""
        system = self._system
        self._candidates = system.candidates()
        count, steps, possible = len(self._candidates), min(self.depth, system.horizon), 1
        while possible < steps and count ** (possible + 1) <= self.most:
            possible += 1
        if possible < steps:
            joint = isinstance(system.actions, PerSensorLibrary)
            hint = "; action='joint', where a system has it, has fewer candidates" if joint else ""
            what = f"lookahead depth is {self.depth}, which makes {count}^{steps} sequences a decision"
            raise InputError(f"{what}, expected at most {self.most} (nearest: {possible}){hint}")
        self._ready = True

    def _values(self, belief: Any, depth: int, mask: Array | None) -> Array:
        """Cost of the best sequence that starts with each candidate, (env, candidate)."""
        count, branches = len(belief.step), len(self._candidates)
        chunk = max(1, NODES // branches ** min(depth, 2))
        if count > chunk:
            parts = [np.arange(start, min(start + chunk, count)) for start in range(0, count, chunk)]
            masks = [None if mask is None else mask[part] for part in parts]
            work = zip(parts, masks, strict=True)
            return np.concatenate([self._values(trees.take(belief, part), depth, m) for part, m in work])
        predicted = self._system.predict(belief, self._candidates[None])
        values = self._system.cost(predicted)
        if mask is not None:
            values = np.where(mask, values, np.inf)
        if depth > 1:
            leaves = trees.tree_map(lambda a: a.reshape(count * branches, *a.shape[2:]), predicted)
            over = self._system.terminal(leaves)
            if not over.all():
                below = self._values(leaves, depth - 1, self._masks(leaves)).min(axis=1)
                values = values + np.where(over, 0.0, below).reshape(count, branches)
        return values

    def _masks(self, belief: Any) -> Array | None:
        mask = self._system.mask(belief)
        return None if mask.all() else mask
