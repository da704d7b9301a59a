"""Action set of radars on an account of energy: silence, or one chirp in several durations, at every sensor."""

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
from wavegym.sensors.eclipsing import NEVER_CUT, NO_TABLES, EclipsedLibrary, EclipseTables
from wavegym.systems.agile_clutter.actions import eclipsed_library
from wavegym.systems.energy_budget.account import Account
from wavegym.waveforms import Waveform, measurement_covariances, trapezoid_chirp_library

FINEST = 1000  # quanta in the longest pulse, at most


@dataclass(frozen=True)
class PulseActions:
    """One chirp at constant peak power in several durations, or silence, for each of several sensors.

    A sensor's options are silence and the durations from the shortest to the longest. The energy of a pulse, and with
    it the SNR, is its duration over the longest. AgileClutter also reads the attributes of ChirpActions.

    Args:
        law: phase function of the chirp.
        durations: s.
        sweep: Hz.
        direction: "up" or "down".
        carrier_hz: carrier frequency fc, Hz.
        sensors: number of sensors.
        eclipsing: whether the receivers are closed while their radar transmits.

    Raises:
        InputError: durations whose ratios are no simple fractions, or an invalid chirp.
    """

    law: str
    durations: tuple[float, ...]
    sweep: float
    direction: str
    carrier_hz: float
    sensors: int
    eclipsing: bool = False

    @cached_property
    def _chirps(self) -> Any:
        return trapezoid_chirp_library([self.law], sorted(self.durations), [self.sweep], [self.direction])

    @property
    def sensor_library(self) -> tuple[Waveform | None, ...]:
        """The chirp of each of a sensor's options; None for silence."""
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
        """Joint actions in which all transmitting sensors send the same pulse; silence included."""
        return np.array([a for a, row in enumerate(self.actions.indices) if len(set(row[row > 0])) <= 1])

    @cached_property
    def shares(self) -> tuple[Fraction, ...]:
        """Energy of each option over that of the longest pulse, silence first."""
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
    def action_quanta(self) -> Array:
        """Quanta that each joint action costs, (action,) int."""
        each = np.array([int(share * self.quanta) for share in self.shares])
        return each[self.actions.indices].sum(axis=1)

    @cached_property
    def strength(self) -> Array:
        """SNR of each option over that of the longest pulse, (option,); 1 for silence, which has no effect."""
        return np.array([1.0, *map(float, self.shares[1:])])

    @cached_property
    def unit_covariances(self) -> Array:
        """C (option, 2, 2) at unit SNR; silence has the longest pulse's C, which has no effect."""
        C = measurement_covariances(self._chirps, self.carrier_hz)
        return np.concatenate([C[-1:], C])

    @cached_property
    def _eclipsed(self) -> EclipsedLibrary:
        return eclipsed_library(self._chirps)

    @property
    def tables(self) -> EclipseTables:
        """The tables to which ``sensor_windows`` refer."""
        return self._eclipsed.tables if self.eclipsing else NO_TABLES

    @cached_property
    def sensor_windows(self) -> Array:
        """The receive windows (option, 10); silence has the longest pulse's, which has no effect."""
        if not self.eclipsing:
            return NEVER_CUT.repeat(len(self._chirps) + 1, axis=0)
        return np.concatenate([self._eclipsed.windows[-1:], self._eclipsed.windows])

    @property
    def sensor_covariances(self) -> Array:
        """Measurement covariances (option, 2, 2) when the longest pulse has unit SNR."""
        return self.unit_covariances / self.strength[:, None, None]

    @cached_property
    def account(self) -> Account:
        """The account that pays the pulses."""
        return Account(self.action_quanta, self.actions.indices, self.quanta)
