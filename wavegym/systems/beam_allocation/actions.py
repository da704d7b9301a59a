"""Action set of radars with one beam: a target and a chirp for every sensor."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import product

import numpy as np

from wavegym.core.action_sets import JointLibrary, Library
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.systems.agile_clutter.actions import ChirpActions
from wavegym.waveforms import PulseTrain, measurement_covariances, trapezoid_chirp_library
from wavegym.waveforms.waveform import Waveform


@dataclass(frozen=True)
class BeamActions(ChirpActions):
    """A target to illuminate and a chirp for every sensor; an action is one index for all sensors.

    Args:
        targets: number of targets.
        counts: number of pulses of each chirp's train; 1 is the chirp alone.
        interval: time between the pulses of a train, s.
    """

    targets: int
    counts: tuple[int, ...] = field(kw_only=True)
    interval: float = field(kw_only=True)

    @cached_property
    def library(self) -> Library:
        """Every law with each duration, sweep and number of pulses, rising.

        InputError for unequal numbers of them, or for an interval without room for a pulse.
        """
        given = {"durations": self.durations, "sweeps": self.sweeps, "counts": self.counts}
        if len({len(values) for values in given.values()}) > 1:
            listed = ", ".join(f"{name} is {values}" for name, values in given.items())
            raise InputError(f"{listed}, expected one of each for every chirp")
        trains = zip(*given.values(), strict=True)
        return Library(tuple(self._sent(law, *train) for law, train in product(self.laws, trains)))

    def _sent(self, law: str, duration: float, sweep: float, count: int) -> Waveform:
        """A chirp, or a train of it."""
        chirp = trapezoid_chirp_library((law,), (duration,), (sweep,))[0]
        return chirp if count == 1 else PulseTrain(chirp, count=count, interval=self.interval)

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

    @property
    def library_windows(self) -> Array:
        """The receive windows of the chirps, (chirp, 10)."""
        return self.sensor_windows[: len(self.library)]

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
