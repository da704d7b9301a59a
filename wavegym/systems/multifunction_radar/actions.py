"""The dwells from which the multifunction radar chooses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from wavegym.core.action_sets import Library, quantity
from wavegym.core.arrays import Array
from wavegym.systems.multifunction_radar.step_kernels import SEARCH, UPDATE, WAIT


class Train(NamedTuple):
    """The pulses of a dwell: bursts, each coherent."""

    pulses: int  # of a burst
    bursts: int
    interval: float  # s, between two pulses

    @property
    def burst(self) -> float:
        """Length of a burst, s."""
        return self.pulses * self.interval

    @property
    def seconds(self) -> float:
        """Time of transmission, s."""
        return self.bursts * self.burst

    @property
    def label(self) -> str:
        """As actions name it."""
        bursts = f" in {self.bursts} bursts" if self.bursts > 1 else ""
        return quantity(self.seconds, "s") + bursts


@dataclass(frozen=True)
class Dwells:
    """Update a slot, search a sector, each with one of several trains, or wait: in this order.

    Args:
        trains: of which a dwell sends one.
        overhead: time before each dwell, s.
        wait: length of the wait, s.
        slots: number of tracks.
        sectors: number of sectors.
    """

    trains: tuple[Train, ...]
    overhead: float
    wait: float
    slots: int
    sectors: int

    @cached_property
    def library(self) -> Library:
        """The actions by name."""
        labels = [train.label for train in self.trains]
        updates = [f"update {k} {label}" for k in range(self.slots) for label in labels]
        searches = [f"search {s} {label}" for s in range(self.sectors) for label in labels]
        return Library((*updates, *searches, "wait"))

    @cached_property
    def menu(self) -> tuple[Array, Array, Array, Array]:
        """Kind, slot or sector, train (the first for the wait) and duration of every action, (action,) each."""
        each, seconds = self.each, np.array(self.seconds)
        kind = np.repeat([UPDATE, SEARCH, WAIT], [self.slots * each, self.sectors * each, 1])
        index = np.concatenate([np.arange(self.slots).repeat(each), np.arange(self.sectors).repeat(each), [0]])
        train = np.append(np.tile(np.arange(each), self.slots + self.sectors), 0)
        duration = np.where(kind == WAIT, self.wait, seconds[train] + self.overhead)
        return kind, index, train, duration

    @property
    def seconds(self) -> tuple[float, ...]:
        """Time of transmission of each train, s."""
        return tuple(train.seconds for train in self.trains)

    @property
    def each(self) -> int:
        """Number of dwells with which a slot or sector can be seen."""
        return len(self.trains)

    def update(self, slot: Array, dwell: Array) -> Array:
        """Actions that update slots with dwells, both int (...)."""
        return slot * self.each + dwell

    def search(self, sector: Array, dwell: Array) -> Array:
        """Actions that search sectors with dwells, both int (...)."""
        return (self.slots + sector) * self.each + dwell

    def mask(self, occupied: Array) -> Array:
        """Which actions are allowed, (env, action) bool: updates of the slots ``occupied`` (env, slot), all else."""
        rest = np.ones((len(occupied), self.sectors * self.each + 1), np.bool_)
        return np.concatenate([occupied.repeat(self.each, axis=1), rest], axis=1)
