"""One beam a radar: tape, belief, what a sensor may do, what an agent is shown, and what makes a scenario."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from wavegym.core.action_sets import JointLibrary, Library
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_non_negative, check_within
from wavegym.core.system import ObservationField
from wavegym.systems.agile_clutter.actions import ChirpActions
from wavegym.systems.visibility_windows import given_windows, window_draws
from wavegym.waveforms import (
    measurement_covariances,
    trapezoid_chirp_library,
)
from wavegym.waveforms.waveform import Waveform

if TYPE_CHECKING:
    from wavegym.systems.beam_allocation.system import BeamAllocation

Quad = tuple[float, float, float, float]

MOST_ACTIONS = 10_000
SOON = 10  # steps of visibility that are observed


class World(NamedTuple):
    """One episode's tape."""

    start: Array  # (target, 4) normal: error of the first estimate
    process: Array  # (target, lifetime, 4) normal: manoeuvres
    detection: Array  # (H, sensor, target) uniform: detected where below Pd
    error: Array  # (H, sensor, target, 2) normal: measurement error
    key: Array  # () uint64: of the counter-based draws of clutter
    place: Array  # (target, 4) uniform: true start
    window: Array  # (target, n) uniform: windows of visibility


class Belief(NamedTuple):
    """The belief, and when each target can be seen."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    particles: None  # the parent's
    visible: Array  # (env, H, target) bool: whether it can be seen from step k to k + 1


@dataclass(frozen=True)
class BeamActions(ChirpActions):
    """A target to look at and a chirp for every sensor; an action is one index for all sensors.

    Args:
        targets: how many.
    """

    targets: int

    @cached_property
    def library(self) -> Library:
        """Every law with each pair of a duration and a sweep, rising. InputError where one has no partner."""
        if len(self.durations) != len(self.sweeps):
            wanted = "as many of the one as of the other, one of each for every chirp"
            raise InputError(f"durations is {self.durations} and sweeps is {self.sweeps}, expected {wanted}")
        pairs = product(self.laws, zip(self.durations, self.sweeps, strict=True))
        return Library(tuple(trapezoid_chirp_library((law,), (d,), (s,))[0] for law, (d, s) in pairs))

    @cached_property
    def joint(self) -> JointLibrary:
        """Every target with every chirp, in all combinations of the sensors."""
        labels = (f"target {t}: {chirp}" for t in range(1, self.targets + 1) for chirp in self.library.labels)
        return JointLibrary(Library(tuple(labels)), self.sensors)

    @property
    def sensor_library(self) -> tuple[Waveform, ...]:  # type: ignore[override]
        """The chirp of each of a sensor's choices."""
        return self.library.entries * self.targets

    @cached_property
    def chirp_covariances(self) -> Array:
        """C (chirp, 2, 2) at unit SNR."""
        return measurement_covariances(self.library, self.carrier_hz)

    @cached_property
    def sensor_covariances(self) -> Array:
        """C (choice, 2, 2) at unit SNR."""
        return np.tile(self.chirp_covariances, (self.targets, 1, 1))

    @cached_property
    def candidates(self) -> Array:
        """All joint actions."""
        return np.arange(len(self.joint))

    @cached_property
    def constants(self) -> Array:
        """All joint actions."""
        return self.candidates

    @cached_property
    def looks(self) -> Array:
        """Whether an action has a sensor look at a target, (action, sensor, target) bool."""
        return self.joint.indices[..., None] // len(self.library) == np.arange(self.targets)

    @cached_property
    def ways(self) -> tuple[Array, int]:
        """How an action looks at each target, (action, target), as a number below the second value.

        It has one digit for every sensor, the last sensor's the lowest: 0 for a look elsewhere, d > 0 for chirp d - 1.
        """
        base, digits = len(self.library) + 1, self.joint.indices % len(self.library) + 1
        weights = base ** np.arange(self.sensors)[::-1]
        return (self.looks * (digits * weights)[..., None]).sum(axis=1), base**self.sensors


def window_elements(targets: int) -> tuple[ObservationField, ...]:
    """Observation elements that say when each target can be seen."""
    listed: list[ObservationField] = []
    for t in range(1, targets + 1):
        listed += [
            ObservationField(f"visible_{t}", "1", 0.5, 0.5, f"whether target {t} can be seen in the coming step"),
            ObservationField(
                f"changes_{t}", "step", 0.5 * SOON, 0.5 * SOON, f"steps until that changes, at most {SOON}"
            ),
            ObservationField(
                f"soon_visible_{t}", "1", 0.5, 0.3, f"share of the next {SOON} steps in which it can be seen"
            ),
        ]
    return tuple(listed)


def check_beams(system: BeamAllocation) -> None:
    """InputError for targets that come or go, too many actions, or windows that make no scenario."""
    if any(system.births):
        raise InputError(f"births is {system.births}, expected 0 for every target: all are there throughout")
    for value in system.spread:
        check_non_negative("spread", value)
    count = (len(system.action_set.library) * len(system.starts)) ** len(system.sensors)
    check_within("number of joint actions", count, 1, MOST_ACTIONS)
    window_draws(system.horizon, system.shown, system.hidden)
    given_windows(system.windows, len(system.starts), system.horizon)
