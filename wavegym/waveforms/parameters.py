"""Continuous waveform parameters as a box: what a continuous action in [-1, 1] means in physical units."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.errors import InputError, choice, positive

Array = NDArray[np.float64]

_ROUNDING = 1e-12  # relative to the bound: a value this far outside is a rounded bound, not a mistake


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
        choice(f"scale of {self.name}", self.scale, ("log", "linear"))
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise InputError(f"range of {self.name} is [{self.low!r}, {self.high!r}], expected finite low < high")
        if self.scale == "log":
            positive(f"low of {self.name} (log scale)", self.low, self.unit)

    def decode(self, action: Array) -> Array:
        """Physical value of an action in [-1, 1], any shape."""
        share = 0.5 * (action + 1.0)
        if self.scale == "log":
            value = self.low * np.exp(share * math.log(self.high / self.low))
        else:
            value = self.low + share * (self.high - self.low)
        return np.clip(value, self.low, self.high)

    def encode(self, value: Array) -> Array:
        """Action in [-1, 1] of a physical value inside the range, any shape."""
        if self.scale == "log":
            share = np.log(value / self.low) / math.log(self.high / self.low)
        else:
            share = (value - self.low) / (self.high - self.low)
        return np.clip(2.0 * share - 1.0, -1.0, 1.0)


@dataclass(frozen=True)
class ParameterBox:
    """Several parameters: the action space of a continuous scheduler, [-1, 1]^d.

    Args:
        parameters: at least one, with distinct names; the order is that of the action's last axis.

    Raises:
        InputError: if there is none, one is not a Parameter, or two share a name.
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

    def decode(self, action: ArrayLike) -> Array:
        """Physical values of actions in [-1, 1]^d: (..., d) -> (..., d), never outside the bounds.

        Raises:
            InputError: if the last axis is not d long, or an action is NaN or outside [-1, 1].
        """
        actions = self._checked("action", action, np.full(len(self), -1.0), np.ones(len(self)), slack=0.0)
        values = np.empty_like(actions)
        for i, parameter in enumerate(self.parameters):
            values[..., i] = parameter.decode(actions[..., i])
        return values

    def encode(self, values: ArrayLike) -> Array:
        """Actions in [-1, 1]^d of physical values, the inverse of ``decode``: (..., d) -> (..., d).

        Raises:
            InputError: if the last axis is not d long, or a value is NaN or outside its range.
        """
        low = np.array([parameter.low for parameter in self.parameters])
        high = np.array([parameter.high for parameter in self.parameters])
        physical = np.clip(self._checked("value", values, low, high, slack=_ROUNDING), low, high)
        actions = np.empty_like(physical)
        for i, parameter in enumerate(self.parameters):
            actions[..., i] = parameter.encode(physical[..., i])
        return actions

    def _checked(self, what: str, given: ArrayLike, low: Array, high: Array, slack: float) -> Array:
        array = np.asarray(given, dtype=np.float64)
        if array.ndim == 0 or array.shape[-1] != len(self):
            raise InputError(f"{what} has shape {array.shape}, expected (..., {len(self)}) for {', '.join(self.names)}")
        # Written so that NaN counts as outside.
        outside = ~((array >= low - slack * np.abs(low)) & (array <= high + slack * np.abs(high)))
        if outside.any():
            where = tuple(np.argwhere(outside)[0])
            i = int(where[-1])
            raise InputError(f"{what} of {self.names[i]} is {array[where]:.9g}, expected [{low[i]:.9g}, {high[i]:.9g}]")
        return array
