"""The dwells from which the multifunction radar chooses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wavegym.core.action_sets import Library, quantity
from wavegym.core.arrays import Array
from wavegym.systems.multifunction_radar.step_kernels import SEARCH, UPDATE, WAIT


@dataclass(frozen=True)
class Dwells:
    """Update a slot, search a sector, each with one of several dwells, or wait: in this order.

    Args:
        seconds: of transmission of each dwell, s.
        overhead: time before each dwell, s.
        wait: length of the wait, s.
        slots: number of tracks.
        sectors: number of sectors.
    """

    seconds: tuple[float, ...]
    overhead: float
    wait: float
    slots: int
    sectors: int

    @cached_property
    def library(self) -> Library:
        """The actions by name."""
        dwells = [quantity(each, "s") for each in self.seconds]
        updates = [f"update {k} {dwell}" for k in range(self.slots) for dwell in dwells]
        searches = [f"search {s} {dwell}" for s in range(self.sectors) for dwell in dwells]
        return Library((*updates, *searches, "wait"))

    @cached_property
    def menu(self) -> tuple[Array, Array, Array, Array]:
        """Kind, slot or sector, seconds of transmission and duration of every action, (action,) each."""
        each, dwells = len(self.seconds), np.array(self.seconds)
        kind = np.repeat([UPDATE, SEARCH, WAIT], [self.slots * each, self.sectors * each, 1])
        index = np.concatenate([np.arange(self.slots).repeat(each), np.arange(self.sectors).repeat(each), [0]])
        seconds = np.append(np.tile(dwells, self.slots + self.sectors), 0.0)
        duration = np.append(seconds[:-1] + self.overhead, self.wait)
        return kind, index, seconds, duration

    @property
    def each(self) -> int:
        """Number of dwells with which a slot or sector can be seen."""
        return len(self.seconds)

    def update(self, slot: Array, dwell: Array) -> Array:
        """Actions that update slots with dwells, both int (...)."""
        return slot * self.each + dwell

    def search(self, sector: Array, dwell: Array) -> Array:
        """Actions that search sectors with dwells, both int (...)."""
        return (self.slots + sector) * self.each + dwell

    def mask(self, occupied: Array) -> Array:
        """Which actions are allowed, (env, action) bool: updates of the slots ``occupied`` (env, slot), all else."""
        rest = np.ones((len(occupied), self.sectors * len(self.seconds) + 1), np.bool_)
        return np.concatenate([occupied.repeat(len(self.seconds), axis=1), rest], axis=1)
