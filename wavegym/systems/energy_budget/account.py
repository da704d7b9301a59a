"""An account of energy, in whole quanta so that nothing is lost to rounding, and the pulses that are paid from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from wavegym.core.action_sets import JointLibrary, Library
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.waveforms import (
    Waveform,
    measurement_covariances,
    trapezoid_chirp_library,
)

FINEST = 1000  # quanta in the longest pulse, at most


@dataclass(frozen=True)
class Account:
    """Energy that joint actions take, and what is transmitted in place of one that cannot be afforded.

    Args:
        takes: quanta that each action takes, (action,) int.
        options: each action's option at every sensor, (action, sensor), 0 for silence, longer pulses after shorter.
        quanta: in one unit of energy.
    """

    takes: Array
    options: Array
    quanta: int

    @cached_property
    def _instead(self) -> Array:
        """What is transmitted of quanta left (0 to the dearest action's) and action asked for, (quanta + 1, action).

        The dearest affordable action in which no sensor transmits longer than asked; the first of equals.
        """
        is_within = (self.options[None] <= self.options[:, None]).all(axis=2)  # (asked, instead)
        left = np.arange(self.takes.max() + 1)
        open_to = is_within & (self.takes <= left[:, None])[:, None]
        return np.where(open_to, self.takes, -1).argmax(axis=2)

    def left(self, energy: Array) -> Array:
        """Whole quanta (...) of energy (...)."""
        return np.rint(energy * self.quanta).astype(np.int64)

    def affordable(self, energy: Array) -> Array:
        """Which actions can be paid, (..., action)."""
        return self.takes <= self.left(energy)[..., None]

    def pay(self, energy: Array, asked: Array) -> tuple[Array, Array]:
        """What is transmitted and the energy left after it, of the shape that energy and ``asked`` have together."""
        left = self.left(energy)
        used = self._instead[np.minimum(left, len(self._instead) - 1), asked]
        return used, (left - self.takes[used]) / self.quanta


@dataclass(frozen=True)
class PulseActions:
    """One chirp at constant peak power in several durations, or silence, for each of several sensors.

    A sensor's options are silence and the durations from the shortest to the longest. The energy of a pulse, and with
    it the SNR, is its duration over the longest. The names of ChirpActions, for what AgileClutter asks of a action_set.

    Args:
        law: phase function of the chirp.
        durations: s.
        sweep: Hz.
        direction: "up" or "down".
        carrier_hz: fc.
        sensors: how many.

    Raises:
        InputError: durations whose ratios are no simple fractions, or what a chirp refuses.
    """

    law: str
    durations: tuple[float, ...]
    sweep: float
    direction: str
    carrier_hz: float
    sensors: int

    @cached_property
    def _chirps(self) -> Any:
        return trapezoid_chirp_library([self.law], sorted(self.durations), [self.sweep], [self.direction])

    @property
    def sensor_library(self) -> tuple[Waveform | None, ...]:
        """The chirp of each of a sensor's choices; None for silence."""
        return (None, *self._chirps)

    @cached_property
    def actions(self) -> JointLibrary:
        """Silence or a duration at every sensor, as one index."""
        return JointLibrary(Library(("silent", *self._chirps.labels)), self.sensors)

    @property
    def candidates(self) -> Array:
        """Every joint action."""
        return np.arange(len(self.actions))

    @cached_property
    def constants(self) -> Array:
        """One option wherever a sensor transmits: at all sensors, at some, at none."""
        return np.array([a for a, row in enumerate(self.actions.indices) if len(set(row[row > 0])) <= 1])

    @cached_property
    def shares(self) -> tuple[Fraction, ...]:
        """What each option takes, silence first, the longest pulse 1."""
        longest = max(self.durations)
        exact = [d / longest for d in sorted(self.durations)]
        shares = [Fraction(value).limit_denominator(FINEST) for value in exact]
        if math.lcm(*(s.denominator for s in shares)) > FINEST or not np.allclose(
            [float(s) for s in shares], exact, rtol=1e-9, atol=0.0
        ):
            wanted = f"multiples of one unit of at least 1/{FINEST} of the longest"
            raise InputError(f"durations is {self.durations}, expected {wanted}")
        return Fraction(0), *shares

    @cached_property
    def quanta(self) -> int:
        """Quanta of energy in the longest pulse."""
        return math.lcm(*(share.denominator for share in self.shares))

    @cached_property
    def takes(self) -> Array:
        """Quanta that each joint action takes, (action,) int."""
        each = np.array([int(share * self.quanta) for share in self.shares])
        return each[self.actions.indices].sum(axis=1)

    @cached_property
    def strength(self) -> Array:
        """SNR of each option over that of the longest pulse, (option,); 1 for silence, which nobody sees."""
        return np.array([1.0, *map(float, self.shares[1:])])

    @cached_property
    def unit_covariances(self) -> Array:
        """C (option, 2, 2) at unit SNR; silence has the longest pulse's, which nobody sees."""
        C = measurement_covariances(self._chirps, self.carrier_hz)
        return np.concatenate([C[-1:], C])

    @property
    def sensor_covariances(self) -> Array:
        """Measurement covariances (option, 2, 2) where the longest pulse has unit SNR."""
        return self.unit_covariances / self.strength[:, None, None]

    @cached_property
    def account(self) -> Account:
        """What pays for the pulses."""
        return Account(self.takes, self.actions.indices, self.quanta)
