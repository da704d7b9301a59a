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
from wavegym.systems.agile_clutter.actions import eclipsed_library, numbered
from wavegym.waveforms import Waveform, measurement_covariances, trapezoid_chirp_library

FINEST = 1000  # quanta in the longest pulse, at most


@dataclass(frozen=True)
class Account:
    """Pays joint actions, and replaces an action that it cannot pay; in whole quanta, so that rounding loses nothing.

    Args:
        action_quanta: quanta that each action costs, (action,) int.
        options: each action's option at every sensor, (action, sensor): 0 for silence, then the pulses by duration.
        quanta: quanta in one unit of energy.
    """

    action_quanta: Array
    options: Array
    quanta: int

    @cached_property
    def _transmitted(self) -> Array:
        """The action transmitted, by quanta left (0 to the dearest action's) and action asked, (quanta + 1, action).

        The dearest affordable action in which no sensor transmits longer than asked; the first of equals.
        """
        is_within = (self.options[None] <= self.options[:, None]).all(axis=2)  # (asked, transmitted)
        left = np.arange(self.action_quanta.max() + 1)
        is_allowed = is_within & (self.action_quanta <= left[:, None])[:, None]
        return np.where(is_allowed, self.action_quanta, -1).argmax(axis=2)

    def left(self, energy: Array) -> Array:
        """Energy (...) in whole quanta (...)."""
        return np.rint(energy * self.quanta).astype(np.int64)

    def affordable(self, energy: Array) -> Array:
        """Which actions the account can pay, (..., action) bool."""
        return self.action_quanta <= self.left(energy)[..., None]

    def pay(self, energy: Array, asked: Array) -> tuple[Array, Array]:
        """The actions transmitted and the energy left after them, both of the broadcast shape of the arguments."""
        left = self.left(energy)
        used = self._transmitted[np.minimum(left, len(self._transmitted) - 1), asked]
        return used, (left - self.action_quanta[used]) / self.quanta


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
        false_alarm: probability of a false alarm in a cell.

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
    false_alarm: float = 0.01

    @cached_property
    def waveforms(self) -> Any:
        """The chirp in every duration."""
        return trapezoid_chirp_library([self.law], sorted(self.durations), [self.sweep], [self.direction])

    @property
    def sensor_library(self) -> tuple[Waveform | None, ...]:
        """The chirp of each of a sensor's options; None for silence."""
        return (None, *self.waveforms)

    @cached_property
    def actions(self) -> JointLibrary:
        """Silence or a duration at every sensor, as one index."""
        return JointLibrary(Library(("silent", *self.waveforms.labels)), self.sensors)

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
        C = measurement_covariances(self.waveforms, self.carrier_hz)
        return np.concatenate([C[-1:], C])

    @cached_property
    def _eclipsed(self) -> EclipsedLibrary:
        return eclipsed_library(self.waveforms)

    @property
    def thresholds(self) -> tuple[Array, Array]:
        """Pf at the one threshold, (1,), and its row for each option, (option,) int."""
        return np.array([self.false_alarm]), np.zeros(len(self.shares), np.int64)

    @property
    def tables(self) -> EclipseTables:
        """The tables to which ``sensor_windows`` refer."""
        return self._eclipsed.tables if self.eclipsing else NO_TABLES

    @cached_property
    def sensor_windows(self) -> Array:
        """The receive windows (option, 11); silence has the longest pulse's, which has no effect."""
        windows = self._eclipsed.windows if self.eclipsing else NEVER_CUT.repeat(len(self.waveforms), axis=0)
        return numbered(windows)[np.arange(-1, len(windows))]

    @property
    def sensor_covariances(self) -> Array:
        """Measurement covariances (option, 2, 2) when the longest pulse has unit SNR."""
        return self.unit_covariances / self.strength[:, None, None]

    @cached_property
    def account(self) -> Account:
        """The account that pays the pulses."""
        return Account(self.action_quanta, self.actions.indices, self.quanta)
