"""Action sets: a library (an action is an index), a library at several sensors, or a box of parameters."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.core.parameter_box import ParameterBox
from wavegym.core.units import quantity

SEPARATOR = " | "  # between the labels of the sensors' waveforms in one action


@dataclass(frozen=True)
class Library:
    """A finite set of actions in a fixed order: action ``a`` transmits ``library[a]``.

    Args:
        entries: at least one: waveforms, or anything else with a ``label``, or plain names.

    Raises:
        InputError: no entries, an entry without a label, or two entries with the same label.
    """

    entries: tuple[Any, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "entries", tuple(self.entries))
        if not self.entries:
            raise InputError("library is empty, expected at least one entry")
        for entry in self.entries:
            if not isinstance(entry, str) and not hasattr(entry, "label"):
                raise InputError(f"library holds {entry!r}, expected waveforms or names only")
        label, times = Counter(self.labels).most_common(1)[0]
        if times > 1:
            raise InputError(f"library holds {label!r} {times} times, expected distinct labels")

    def __len__(self) -> int:
        return len(self.entries)

    def __iter__(self) -> Iterator[Any]:
        return iter(self.entries)

    def __getitem__(self, action: int) -> Any:
        return self.entries[action]

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """A short name for each action, in order."""
        return tuple(entry if isinstance(entry, str) else entry.label for entry in self.entries)


@dataclass(frozen=True)
class _AtEverySensor:
    """The same library at every sensor.

    Args:
        library: the waveforms of each sensor.
        sensors: number of sensors, >= 1.

    Raises:
        InputError: if sensors is not an integer >= 1.
    """

    library: Library
    sensors: int

    def __post_init__(self) -> None:
        check_int("sensors", self.sensors, 1)

    def combinations(self) -> Array:
        """Every combination of library indices, (waveforms^sensors, sensors); the first sensor's index changes slowest.

        Returns a fresh array.
        """
        indices = np.indices((len(self.library),) * self.sensors).reshape(self.sensors, -1)
        return np.ascontiguousarray(indices.T)


class PerSensorLibrary(_AtEverySensor):
    """The same library at every sensor; an action is one index for each, in the order of the sensors."""

    def __len__(self) -> int:
        """Number of waveforms of each sensor."""
        return len(self.library)

    @property
    def labels(self) -> tuple[str, ...]:
        """The waveforms' labels, the same for every sensor."""
        return self.library.labels


class JointLibrary(_AtEverySensor):
    """Every combination of a library's waveforms at several sensors, as one finite set; an action is one index.

    For few waveforms: the number of actions is their number to the power ``sensors``.
    """

    def __len__(self) -> int:
        """Number of joint actions."""
        return len(self.library) ** self.sensors

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """``"a | b"`` for each joint action."""
        return tuple(SEPARATOR.join(labels) for labels in product(self.library.labels, repeat=self.sensors))

    def encode(self, choices: Array) -> Array:
        """Joint actions (...) of library indices (..., sensor), one for each sensor: the inverse of ``indices``."""
        weights = len(self.library) ** np.arange(self.sensors)[::-1]
        return (choices * weights).sum(axis=-1)

    @cached_property
    def indices(self) -> Array:
        """``combinations()``, computed once: (joint action, sensor)."""
        return self.combinations()


FiniteSet = Library | JointLibrary | PerSensorLibrary
ActionSet = FiniteSet | ParameterBox


def sensor_count(actions: FiniteSet) -> int:
    """Number of sensors for which an action chooses."""
    return actions.sensors if isinstance(actions, (PerSensorLibrary, JointLibrary)) else 1


def waveform_labels(actions: FiniteSet) -> tuple[str, ...]:
    """The labels of one sensor's waveforms."""
    return actions.library.labels if isinstance(actions, JointLibrary) else actions.labels


def by_sensor(actions: FiniteSet, chosen: Array) -> Array:
    """Each sensor's index into ``waveform_labels``, (time, sensor), of actions (time,) or (time, sensor)."""
    if isinstance(actions, JointLibrary):
        return actions.indices[chosen]
    return chosen.reshape(len(chosen), -1)


def action_label(actions: ActionSet, action: Array) -> str:
    """A short name of ``action``, (1,) or (1, ...)."""
    if isinstance(actions, ParameterBox):
        values = zip(actions.parameters, actions.decode(action)[0], strict=True)
        return ", ".join(
            f"{p.name} {value:.3g}" if p.unit == "1" else f"{p.name} {quantity(float(value), p.unit)}"
            for p, value in values
        )
    return SEPARATOR.join(actions.labels[i] for i in np.ravel(action))
