"""Action sets: a library (an action is an index), a library at several sensors, or a box of parameters.

A box takes actions in [-1, 1]^d to physical units and back.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import Array, FloatArray, for_kernel
from wavegym.core.errors import InputError, check_choice, check_int, check_positive

_ROUNDING = 1e-12  # relative to the bound: a value this far outside is a rounded bound, not a mistake
SEPARATOR = " | "  # between the labels of the sensors' waveforms in one action


@cache
def _decoder() -> Any:
    """The kernel that decodes actions, imported here so that importing waveforms loads no compiler."""
    from wavegym.core.array_kernels import decode

    return decode


@dataclass(frozen=True)
class Parameter:
    """One waveform parameter and its range.

    Args:
        name: e.g. ``"duration"``.
        unit: e.g. ``"s"``.
        low, high: bounds in that unit.
        scale: ``"log"`` (equal steps of the action are equal ratios) or ``"linear"``.

    Raises:
        InputError: if low >= high, a bound is not finite, the scale is unknown, or it is log and low <= 0.
    """

    name: str
    unit: str
    low: float
    high: float
    scale: str = "log"

    def __post_init__(self) -> None:
        check_choice(f"scale of {self.name}", self.scale, ("log", "linear"))
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise InputError(f"range of {self.name} is [{self.low!r}, {self.high!r}], expected finite low < high")
        if self.scale == "log":
            check_positive(f"low of {self.name} (log scale)", self.low, self.unit)


@dataclass(frozen=True)
class ParameterBox:
    """Several parameters: the action space of a continuous scheduler, [-1, 1]^d.

    Args:
        parameters: at least one, with distinct names; the order is that of the action's last axis.

    Raises:
        InputError: no parameters, an entry that is not a Parameter, or two with the same name.
    """

    parameters: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", tuple(self.parameters))
        if not self.parameters:
            raise InputError("parameter box is empty, expected at least one parameter")
        for parameter in self.parameters:
            if not isinstance(parameter, Parameter):
                raise InputError(f"parameter box holds {parameter!r}, expected Parameters only")
        name, times = Counter(self.names).most_common(1)[0]
        if times > 1:
            raise InputError(f"parameter box holds {name!r} {times} times, expected distinct names")

    def __len__(self) -> int:
        return len(self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters' names, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    def decode(self, action: ArrayLike) -> FloatArray:
        """Physical values of actions in [-1, 1]^d: (..., d) -> (..., d), never outside the bounds.

        Raises:
            InputError: if the last axis is not d long, or an action is NaN or outside [-1, 1].
        """
        actions = self._shaped("action", action)
        values = np.empty(actions.shape)
        rows = (-1, actions.shape[-1])
        if not _decoder()(for_kernel(actions).reshape(rows), *self._bounds, values.reshape(rows)):
            self._require("action", actions, np.full(len(self), -1.0), np.ones(len(self)))
        return values

    def encode(self, values: ArrayLike) -> FloatArray:
        """Actions in [-1, 1]^d of physical values, the inverse of ``decode``: (..., d) -> (..., d).

        Raises:
            InputError: if the last axis is not d long, or a value is NaN or outside its range.
        """
        low, high, width, log = self._bounds
        physical = self._shaped("value", values)
        slack_low, slack_high = _ROUNDING * np.abs(low), _ROUNDING * np.abs(high)
        self._require("value", physical, low - slack_low, high + slack_high, low, high)
        physical = np.clip(physical, low, high)
        logs = np.log(np.where(log, physical / np.where(log, low, 1.0), 1.0))
        return np.clip(2.0 * (np.where(log, logs, physical - low) / width) - 1.0, -1.0, 1.0)

    @cached_property
    def _bounds(self) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
        """Low, high, width (of the logarithm, where the scale is log) and whether the scale is log, (d,) each."""
        low, high = (np.array([getattr(p, name) for p in self.parameters]) for name in ("low", "high"))
        log = np.array([p.scale == "log" for p in self.parameters])
        width = np.array([math.log(p.high / p.low) if p.scale == "log" else p.high - p.low for p in self.parameters])
        return low, high, width, log

    def _shaped(self, what: str, given: ArrayLike) -> FloatArray:
        array = np.asarray(given, dtype=np.float64)
        if array.ndim == 0 or array.shape[-1] != len(self.parameters):
            raise InputError(f"{what} has shape {array.shape}, expected (..., {len(self)}) for {', '.join(self.names)}")
        return array

    def _require(self, what: str, array: FloatArray, low: FloatArray, high: FloatArray, *named: FloatArray) -> None:
        """Raise an InputError for the first element outside [low, high]; ``named``: bounds to print, if others."""
        outside = ~((array >= low) & (array <= high))  # so that NaN counts as outside
        if outside.any():
            where = tuple(np.argwhere(outside)[0])
            i = int(where[-1])
            least, most = named or (low, high)
            wanted = f"[{least[i]:.9g}, {most[i]:.9g}]"
            raise InputError(f"{what} of {self.names[i]} is {array[where]:.9g}, expected {wanted}")


def quantity(value: float, unit: str) -> str:
    """``value`` to four digits with an SI prefix: ``quantity(1e-4, "s") == "100 us"``."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n")):
        if abs(value) >= 0.99995 * factor:
            return f"{value / factor:.4g} {prefix}{unit}"
    return f"{value:.4g} {unit}"


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


def waveform_labels(actions: ActionSet) -> tuple[str, ...]:
    """The labels of one sensor's waveforms; () for a box."""
    if isinstance(actions, ParameterBox):
        return ()
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
