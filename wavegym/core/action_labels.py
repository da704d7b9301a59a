"""Who transmitted what: choices from a finite action set by sensor, and the labels of actions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wavegym.core.action_sets import SEPARATOR, JointLibrary, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.parameter_box import ParameterBox
from wavegym.core.system import Choices
from wavegym.core.units import quantity


@dataclass(frozen=True)
class Menu:
    """A finite action set that is a plain list of names; an action is an index.

    Args:
        labels: a short name for each action.
    """

    labels: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.labels)


def sensor_count(actions: Choices | PerSensorLibrary) -> int:
    """How many sensors choose at a time."""
    return actions.sensors if isinstance(actions, (PerSensorLibrary, JointLibrary)) else 1


def waveform_labels(actions: Choices | PerSensorLibrary) -> tuple[str, ...]:
    """The labels of what one sensor may transmit."""
    return actions.library.labels if isinstance(actions, JointLibrary) else actions.labels


def by_sensor(actions: Choices | PerSensorLibrary, chosen: Array) -> Array:
    """Which of ``waveform_labels`` each sensor transmitted, (time, sensor), for actions (time,) or (time, sensor)."""
    if isinstance(actions, JointLibrary):
        return actions.indices[chosen]
    return chosen.reshape(len(chosen), -1)


def action_label(actions: Choices | PerSensorLibrary | ParameterBox, action: Array) -> str:
    """A short name of ``action``, (1,) or (1, ...)."""
    if isinstance(actions, ParameterBox):
        values = zip(actions.parameters, actions.decode(action)[0], strict=True)
        return ", ".join(
            f"{p.name} {value:.3g}" if p.unit == "1" else f"{p.name} {quantity(float(value), p.unit)}"
            for p, value in values
        )
    return SEPARATOR.join(actions.labels[i] for i in np.ravel(action))
