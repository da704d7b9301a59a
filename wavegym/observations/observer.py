"""The observation of agents: the system's scaled fields, with forecasts on request; or the measurements."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from wavegym.core.action_sets import ParameterBox, by_sensor, sensor_count, waveform_labels
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.shortcuts import measured_fields
from wavegym.core.system import ObservationField, System
from wavegym.observations.forecasts import Forecasts
from wavegym.observations.scaling import LIMIT, ObservationScaler
from wavegym.observations.shortlist import shortlist


class Observer:
    """Observations of a batch of beliefs.

    Args:
        system: the closed loop.
        forecasts: whether ``Forecasts`` follow the system's own fields.
        candidates: the forecasts are those of the ``shortlist`` of this length, and ``forecasts`` is not needed.

    Attributes:
        forecasts: of each candidate, or None.
        shortlist: from which an agent picks by rank; None where its actions are those of the system.

    Raises:
        InputError: ``forecasts`` is not a bool, or the system does not admit ``Forecasts`` or the list.
    """

    def __init__(self, system: System, forecasts: bool = False, candidates: int | None = None) -> None:
        if not isinstance(forecasts, bool):
            raise InputError(f"forecasts is {forecasts!r}, expected True or False (nearest: {bool(forecasts)})")
        self._system, self._scaler = system, ObservationScaler(system.observation_fields)
        self.shortlist = shortlist(system, candidates)
        shown = forecasts or candidates is not None
        self.forecasts = Forecasts(system, self.shortlist) if shown else None
        self.observation_fields: tuple[ObservationField, ...] = system.observation_fields
        if self.forecasts:
            self.observation_fields = (*self.observation_fields, *self.forecasts.observation_fields)
        self.space = spaces.Box(-LIMIT, LIMIT, (len(self.observation_fields),), np.float32)

    def __call__(self, belief: Any) -> tuple[Array, Array]:
        """Observations (env, fields) float32, and the number of the system's own fields that are saturated, (env,)."""
        observation, saturated = self._scaler(self._system.observe(belief))
        if self.forecasts:
            observation = np.concatenate([observation, self.forecasts(belief)], axis=1)
        return observation, saturated


class MeasurementObserver:
    """Observations without a tracker, for agents with a memory.

    The fields are the time, the last action, the sensor's own settings and the last measurements. The last action is
    one-hot for each sensor, or the point of a box. Before the first step no action is shown, and every measurement has
    the centre of its field.

    Args:
        system: the closed loop.

    Raises:
        InputError: a system without ``measured_fields``.
    """

    shortlist = None  # see ``Observer``

    def __init__(self, system: Any) -> None:
        if reason := measured_fields.why_not(system):
            wanted = f"'belief' (nearest): of {type(system).__name__}, {reason}"
            raise InputError(f"observation is 'measurements', expected {wanted}")
        self._system, self._sent = system, _sent_fields(system.actions)
        time = ObservationField("time", "1", 0.5, 0.3, "fraction of the horizon that is over")
        self._measured = measured_fields(system)
        self.observation_fields: tuple[ObservationField, ...] = (
            time,
            *self._sent,
            *self._measured.setting_fields,
            *self._measured.fields,
        )
        self._scaler = ObservationScaler(self.observation_fields)
        self.space = spaces.Box(-LIMIT, LIMIT, (len(self.observation_fields),), np.float32)

    def __call__(self, values: Array) -> tuple[Array, Array]:
        """Scaled observations (env, fields) float32, and the number of fields that are saturated, (env,)."""
        return self._scaler(values)

    def first(self, belief: Any) -> Array:
        """Values of all fields before the first step, (env, fields)."""
        count = len(belief.step)
        nothing = np.tile([field.centre for field in self._measured.fields], (count, 1))
        return self._joined(belief, np.zeros((count, len(self._sent))), nothing)

    def after(self, belief: Any, actions: Array, measurements: Any) -> Array:
        """Values of all fields after a step, (env, fields).

        Args:
            belief: after the step; only the time and the sensor's settings are read.
            actions: of the step, (env, ...).
            measurements: what ``measure`` reported.
        """
        return self._joined(belief, self._transmitted(actions), self._measured.values(measurements))

    def _joined(self, belief: Any, sent: Array, measured: Array) -> Array:
        time = belief.step[:, None] / self._system.horizon
        return np.concatenate([time, sent, self._measured.settings(belief), measured], axis=1)

    def _transmitted(self, actions: Array) -> Array:
        """Values of the fields of the last action."""
        known = self._system.actions
        if isinstance(known, ParameterBox):
            return np.asarray(actions, np.float64).reshape(len(actions), -1)
        chosen = by_sensor(known, np.asarray(actions))
        return np.eye(len(waveform_labels(known)))[chosen].reshape(len(chosen), -1)


def _sent_fields(actions: Any) -> tuple[ObservationField, ...]:
    """Fields of the last action."""
    if isinstance(actions, ParameterBox):
        return tuple(
            ObservationField(f"sent_{p.name}", "1", 0.0, 1.0, f"{p.name} of the last action, in the box")
            for p in actions.parameters
        )
    sensors = range(1, sensor_count(actions) + 1)
    return tuple(
        ObservationField(f"sent_{i}_{label}", "1", 0.0, 1.0, f"1 if sensor {i} transmitted {label} last, else 0")
        for i in sensors
        for label in waveform_labels(actions)
    )
