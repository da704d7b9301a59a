"""One waveform for each of several sensors: chosen sensor by sensor, or as a joint action of a small library."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Protocol

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import check_int

SEPARATOR = " | "  # between the labels of what the sensors transmit at a time


class Menu(Protocol):
    """What one sensor may transmit: a waveform library is one."""

    @property
    def labels(self) -> tuple[str, ...]:
        """A short name for each choice."""

    def __len__(self) -> int: ...


@dataclass(frozen=True)
class _AtEverySensor:
    """The same library at every sensor.

    Args:
        library: what any sensor may transmit.
        sensors: how many, >= 1.

    Raises:
        InputError: if sensors is not an integer >= 1.
    """

    library: Menu
    sensors: int

    def __post_init__(self) -> None:
        check_int("sensors", self.sensors, 1)

    def combinations(self) -> Array:
        """What each sensor transmits in every combination, the first sensor's index changing slowest: a fresh array.

        Indices into the library, (waveforms^sensors, sensors).
        """
        indices = np.indices((len(self.library),) * self.sensors).reshape(self.sensors, -1)
        return np.ascontiguousarray(indices.T)


class PerSensorLibrary(_AtEverySensor):
    """The same library at every sensor; an action is one index for each, in the order of the sensors."""

    def __len__(self) -> int:
        """Number of waveforms to choose from at each sensor."""
        return len(self.library)

    @property
    def labels(self) -> tuple[str, ...]:
        """The waveforms' labels, the same for every sensor."""
        return self.library.labels


class JointLibrary(_AtEverySensor):
    """Every combination of a library's waveforms at several sensors, as one finite set; an action is one index.

    For few waveforms: their number is raised to the power ``sensors``.
    """

    def __len__(self) -> int:
        """Number of joint actions."""
        return len(self.library) ** self.sensors

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """``"a | b"`` for each joint action."""
        return tuple(SEPARATOR.join(labels) for labels in product(self.library.labels, repeat=self.sensors))

    def encode(self, choices: Array) -> Array:
        """Joint actions (...) of an index into the library for every sensor, (..., sensor): undoes ``indices``."""
        weights = len(self.library) ** np.arange(self.sensors)[::-1]
        return (choices * weights).sum(axis=-1)

    @cached_property
    def indices(self) -> Array:
        """``combinations()``, made once: (joint action, sensor)."""
        return self.combinations()
