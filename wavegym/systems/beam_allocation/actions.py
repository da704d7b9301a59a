"""Action set of radars with one beam: a target and a chirp for every sensor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from wavegym.core.action_sets import JointLibrary, Library
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.systems.agile_clutter.actions import ChirpActions
from wavegym.waveforms import measurement_covariances, trapezoid_chirp_library
from wavegym.waveforms.waveform import Waveform


@dataclass(frozen=True)
class BeamActions(ChirpActions):
    """A target to illuminate and a chirp for every sensor; an action is one index for all sensors.

    Args:
        targets: number of targets.
    """

    targets: int

    @cached_property
    def library(self) -> Library:
        """Every law with each pair of a duration and a sweep, rising. InputError for unequal numbers of them."""
        if len(self.durations) != len(self.sweeps):
            wanted = "as many durations as sweeps, one of each for every chirp"
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
    def illuminated(self) -> Array:
        """Whether a sensor's beam illuminates a target, (action, sensor, target) bool."""
        return self.joint.indices[..., None] // len(self.library) == np.arange(self.targets)

    @cached_property
    def chirp_codes(self) -> tuple[Array, int]:
        """The chirps that an action sends at each target as one number, (action, target); how many numbers there are.

        The number has one digit for every sensor, the last sensor's digit the lowest: 0 for a beam that points
        elsewhere, d > 0 for chirp d - 1.
        """
        base, digits = len(self.library) + 1, self.joint.indices % len(self.library) + 1
        weights = base ** np.arange(self.sensors)[::-1]
        return (self.illuminated * (digits * weights)[..., None]).sum(axis=1), base**self.sensors
