"""Traits change the form of a closed loop. A system derives from each that it has: ``class My(System, TimedPulses)``.

A subclass withdraws a trait by setting one of its members to None.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

from wavegym.core.arrays import Array


class UnequalSteps(ABC):
    """Steps whose lengths the actions choose. The cost of a step is that of its whole duration.

    Evaluation then averages over time: the summed cost over the summed duration.
    """

    @abstractmethod
    def duration(self, belief: Any) -> Array:
        """Seconds of the last step, (env,) or (env, candidate)."""


CONFIRMED = 0.9  # existence from which a track is confirmed; below it is tentative


class TrackSlots(ABC):
    """Tracks in numbered slots, and one beam that updates a track or searches a sector, a dwell at a time."""

    @abstractmethod
    def slots_now(self, belief: Any) -> Array:
        """The belief about each slot now, (env, slot, column); all 0 where it is free.

        Columns: probability of existence, range (m), azimuth (rad); standard deviations of the azimuth (beam widths),
        the position (m) and the velocity (m/s); seconds since the last update; expected density of the acceleration
        (m^2/s^3); E/N0 of a second of transmission; and the value of a find at its place, in s of its full cost.
        """

    @property
    @abstractmethod
    def dwells(self) -> Any:
        """The dwell of each candidate, a ``wavegym.systems.multifunction_radar.actions.Dwells``."""


class DwellRule(NamedTuple):
    """The constants of a rule for one beam on a time line.

    A dwell scores its gain per second times powers: of its duration, and for an update of the track's range and of the
    time since its last update. A find counts ``worth`` times the power ``power`` of its value.

    Attributes:
        long, tentative, long_search: powers of the duration, of an update of a confirmed or tentative track and of a
            search.
        far: power of the range over the greatest range.
        age: power of the time since the last update, of 10 ms or more.
    """

    long: float = 0.0
    tentative: float = 0.0
    worth: float = 0.5
    power: float = 0.75
    long_search: float = 0.0
    far: float = 0.0
    age: float = 0.0


class DecisionMaker(NamedTuple):
    """Who chooses a part of the action: a sensor, a platform or a transmitter."""

    name: str
    fields: tuple[str, ...] = ()  # names of the observation fields that are about this sensor alone
    parameters: tuple[str, ...] = ()  # names of its parameters in a ParameterBox; () for a finite action set


class DecisionMakers(ABC):
    """Several decision makers, which choose the action together."""

    @property
    @abstractmethod
    def decision_makers(self) -> tuple[DecisionMaker, ...]:
        """Who chooses which part of the action.

        One for each sensor of a PerSensorLibrary or a JointLibrary, in that order; of a ParameterBox, in any order, and
        every parameter belongs to exactly one. An observation field that belongs to none is shared. A single one where
        the parameters of the system leave a single sensor.
        """


class RecordedTargets(ABC):
    """True targets that may follow recordings.

    The system has the parameters ``tracks``, ``radar``, ``farthest_range`` and ``smoothing``.
    """

    @property
    @abstractmethod
    def recorded_windows(self) -> Any:
        """The windows of the recording that worlds draw, a ``wavegym.targets.Windows``; None without a recording."""


class TimedPulses(ABC):
    """Pulses with a timing, to be held against the targets' ranges and speeds.

    Attributes:
        bistatic: whether the receivers have their own antennas and listen while the transmitter transmits.
        chooses_prf: whether the PRF is chosen, so that a target may be ambiguous or hidden at some PRFs.
        duration_means: the definition of a pulse's duration, a sentence.
    """

    bistatic: ClassVar[bool] = False
    chooses_prf: ClassVar[bool] = False

    @property
    def duration_means(self) -> str:
        """By default that of ``wavegym.waveforms.transmitted_interval``."""
        return "The duration of a pulse holds 99 % of its energy."

    @property
    @abstractmethod
    def timings(self) -> Mapping[str, Any]:
        """The timing of every pulse of one sensor, a ``wavegym.waveforms.PulseTiming``, by the pulse's label."""

    @abstractmethod
    def target_ranges(self, world: Any) -> Array:
        """Range (m) and range-rate (m/s) of every target, at every sensor and step of its presence, (env, ..., 2).

        With separate receivers half of the path's length and of its rate.
        """


TRAITS: tuple[type, ...] = (UnequalSteps, TrackSlots, DecisionMakers, RecordedTargets, TimedPulses)


def lacks_trait(system: object, trait: type) -> str:
    """Why a system does not have a trait, for an error; "" where it has."""
    members = sorted(getattr(trait, "__abstractmethods__", ()))
    if isinstance(system, trait):
        return next((f"it withdraws {name}" for name in members if getattr(type(system), name) is None), "")
    have = [member for member in members if hasattr(system, member)]
    if have:
        return f"it has {have[0]} but no such trait, expected class {type(system).__name__}(System, {trait.__name__})"
    return f"it has no {members[0]}"
