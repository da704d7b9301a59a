"""Action sets of radars with generalised FM chirps: a library per sensor, a joint library, or a box."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product

import numpy as np

from wavegym.core.action_sets import JointLibrary, Library, Parameter, ParameterBox, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.sensors import false_return_threshold
from wavegym.sensors.eclipsing import (
    NEVER_CUT,
    NO_TABLES,
    EclipsedLibrary,
    EclipsedPulse,
    EclipseTables,
    receive_windows,
)
from wavegym.waveforms import (
    chirp_law,
    measurement_covariances,
    parse_law,
    trapezoid_chirp_library,
)
from wavegym.waveforms.fisher import unchecked_covariance
from wavegym.waveforms.trapezoid import unchecked_trapezoid_factors
from wavegym.waveforms.waveform import Waveform


def eclipsed_library(waveforms: Iterable[Waveform]) -> EclipsedLibrary:
    """The waveforms with their receivers. InputError for one that has no table of its cut."""
    try:
        return EclipsedLibrary([EclipsedPulse(waveform) for waveform in waveforms])
    except InputError as error:
        raise InputError(f"{error}; or eclipsing=False, for a receiver that is always open") from error


def numbered(windows: Array) -> Array:
    """Receive windows with the number of their waveform, a row of the clutter field, in the last column, (row, 11)."""
    return np.column_stack([windows, np.arange(len(windows))])


@dataclass(frozen=True)
class ChirpActions:
    """Every phase law with every duration, sweep and direction, at each of several sensors.

    Args:
        laws: phase functions: ``"lfm"``, ``"pfm:3"``, ``"hfm:0.5"``, ``"efm:0.5"``; the shape is optional.
        durations: s.
        sweeps: Hz, > 0.
        carrier_hz: carrier frequency fc, Hz.
        sensors: number of sensors.
        form: "library" (an index per sensor), "joint" (one index for all sensors, over every law and direction at the
            longest duration and the widest sweep) or "box" (the parameters of every sensor).
        own: pulses of each sensor in place of the chirps, in the forms "library" and "joint".
        eclipsing: whether the receivers are closed while their radar transmits.
        false_alarms: probabilities of a false alarm in a cell, from which a sensor chooses with its waveform.
        alarm_density: density of the false returns of noise, in place of ``false_alarms``; None for none.
    """

    laws: tuple[str, ...]
    durations: tuple[float, ...]
    sweeps: tuple[float, ...]
    carrier_hz: float
    sensors: int
    form: str
    own: Library | None = field(default=None, kw_only=True)
    eclipsing: bool = field(default=False, kw_only=True)
    false_alarms: tuple[float, ...] = field(default=(0.01,), kw_only=True)
    alarm_density: float | None = field(default=None, kw_only=True)

    @cached_property
    def library(self) -> Library:
        """One sensor's waveforms: law, duration, sweep, direction, the last fastest; or the given ones."""
        return self.own or trapezoid_chirp_library(self.laws, self.durations, self.sweeps)

    @cached_property
    def widest(self) -> Library:
        """Every law and direction at the longest duration and the widest sweep, or the given waveforms."""
        return self.own or trapezoid_chirp_library(self.laws, (max(self.durations),), (max(self.sweeps),))

    @cached_property
    def joint(self) -> JointLibrary:
        """The widest waveforms in all combinations of the sensors."""
        return JointLibrary(self._choices, self.sensors)

    @cached_property
    def box(self) -> ParameterBox:
        """Per sensor: the law's index, rounded down (left out for a single law), duration and signed sweep."""
        widest = max(self.sweeps)
        parameters = []
        for i in range(1, self.sensors + 1):
            if len(self.laws) > 1:
                parameters.append(Parameter(f"law_{i}", "1", 0.0, float(len(self.laws)), "linear"))
            parameters.append(Parameter(f"duration_{i}", "s", min(self.durations), max(self.durations), "log"))
            parameters.append(Parameter(f"sweep_{i}", "Hz", -widest, widest, "linear"))
        return ParameterBox(tuple(parameters))

    @property
    def actions(self) -> PerSensorLibrary | JointLibrary | ParameterBox:
        """The action set of this form."""
        if self.form == "box":
            return self.box
        return self.joint if self.form == "joint" else PerSensorLibrary(self._choices, self.sensors)

    @property
    def waveforms(self) -> Library:
        """The waveforms of one sensor that enumerating schedulers try, each once."""
        return self.widest if self.form == "joint" else self.library

    @cached_property
    def _choices(self) -> Library:
        """Every waveform with every threshold, the threshold fastest."""
        if len(self.false_alarms) == 1:
            return self.waveforms
        choices = product(self.waveforms.labels, self.false_alarms)
        return Library(tuple(f"{label}, Pf {alarm:g}" for label, alarm in choices))

    @cached_property
    def sensor_library(self) -> tuple[Waveform | None, ...]:
        """The waveform of each of a sensor's choices that enumerating schedulers try."""
        return tuple(waveform for waveform in self.waveforms for _ in self.false_alarms)

    @cached_property
    def thresholds(self) -> tuple[Array, Array]:
        """Pf at each threshold (row,), and the row of each choice of a sensor, (choice,) int."""
        count = len(self.sensor_library)
        if self.alarm_density is None:
            rows = np.arange(len(self.false_alarms))
            return np.array(self.false_alarms), np.resize(rows, count)
        T = false_return_threshold(self.sensor_covariances, self.alarm_density)
        return np.unique(np.exp(-T), return_inverse=True)

    def alarms(self, actions: Array) -> Array:
        """Rows of the thresholds of ``actions``, (..., sensor) int; (...) is (1,) for each axis if there is one row."""
        alarms, rows = self.thresholds
        if len(alarms) == 1:
            leading = np.ndim(actions) - (self.form != "joint")
            return np.zeros((*(1,) * leading, self.sensors), np.int64)
        return rows.take(self.joint.indices.take(actions, axis=0) if self.form == "joint" else actions)

    @cached_property
    def sensor_covariances(self) -> Array:
        """C (choice, 2, 2): measurement covariances of ``sensor_library`` at unit SNR."""
        C = measurement_covariances(self.waveforms, self.carrier_hz)
        return C.repeat(len(self.false_alarms), axis=0)

    @cached_property
    def _sensor_chirps(self) -> Array:
        """(3, waveform): law, duration and signed sweep of the library, as ``encode_chirps`` takes them."""
        chirps = product(range(len(self.laws)), self.durations, self.sweeps, (1.0, -1.0))
        return np.array([(law, duration, sign * sweep) for law, duration, sweep, sign in chirps]).T

    def encode(self, choices: Array) -> Array:
        """Actions that transmit one waveform of ``sensor_library`` per sensor, (..., sensor) int."""
        if self.form == "library":
            return choices
        if self.form == "joint":
            return self.joint.encode(choices)
        return self.encode_chirps(*self._sensor_chirps[:, choices])

    def encode_chirps(self, law: Array, duration: Array, sweep: Array) -> Array:
        """Box actions of any chirps, each (..., sensor): index of the law, duration (s), signed sweep (Hz)."""
        parts = [law + 0.5, duration, sweep] if len(self.laws) > 1 else [duration, sweep]
        values = np.stack(parts, axis=-1)
        return self.box.encode(values.reshape(*values.shape[:-2], -1))

    def decode_chirps(self, actions: Array) -> tuple[Array, Array, Array]:
        """Index of the law, duration (s) and signed sweep (Hz) of box actions, each (..., sensor)."""
        values = self.box.decode(actions)
        values = values.reshape(*values.shape[:-1], self.sensors, -1)
        law = values[..., 0].astype(np.int64) if len(self.laws) > 1 else np.zeros(values.shape[:-1], np.int64)
        return np.minimum(law, len(self.laws) - 1), values[..., -2], values[..., -1]

    @cached_property
    def constants(self) -> Array:
        """Fixed schedules: one law, duration and sweep for all sensors, each sensor up or down; or a given pulse."""
        if self.own:
            return self.encode(np.repeat(np.arange(len(self.sensor_library))[:, None], self.sensors, axis=1))
        alarms = len(self.false_alarms)
        pairs = 2 * alarms * np.arange(len(self.waveforms) // 2)[:, None] + np.arange(alarms)
        directions = alarms * np.array(list(product((0, 1), repeat=self.sensors)))
        choices = pairs.reshape(-1, 1, 1) + directions
        return self.encode(choices.reshape(-1, self.sensors))

    @cached_property
    def candidates(self) -> Array:
        """Every combination of one waveform per sensor, as actions."""
        return self.encode(PerSensorLibrary(self._choices, self.sensors).combinations())

    def unit_covariance(self, actions: Array) -> Array:
        """C (..., sensor, 2, 2) of the waveforms that ``actions`` name."""
        if self.form == "library":
            return self.sensor_covariances.take(actions, axis=0)
        if self.form == "joint":
            return self.sensor_covariances.take(self.joint.indices.take(actions, axis=0), axis=0)
        return self.chirp_covariance(*self.decode_chirps(actions))

    @cached_property
    def _eclipsed(self) -> EclipsedLibrary:
        """The waveforms, each once; of a box, of every law one chirp of 1 s and 1 Hz."""
        unit = trapezoid_chirp_library(self.laws, (1.0,), (1.0,), ("up",))
        return eclipsed_library(unit if self.form == "box" else self.waveforms)

    @property
    def tables(self) -> EclipseTables:
        """The tables to which ``windows`` refer."""
        return self._eclipsed.tables if self.eclipsing else NO_TABLES

    @cached_property
    def sensor_windows(self) -> Array:
        """The receive windows of ``sensor_library``, (choice, 11)."""
        if self.form == "box":
            return self.chirp_windows(*self._sensor_chirps)
        return numbered(self.library_windows).repeat(len(self.false_alarms), axis=0)

    @property
    def library_windows(self) -> Array:
        """The receive windows of the waveforms, each once, (waveform, 10)."""
        return self._eclipsed.windows if self.eclipsing else NEVER_CUT.repeat(len(self.waveforms), axis=0)

    def windows(self, actions: Array) -> tuple[Array, Array]:
        """Rows (..., sensor) of the second array, and the receive windows (row, 11), of ``actions``."""
        if self.form == "library":
            return actions, self.sensor_windows
        if self.form == "joint":
            return self.joint.indices.take(actions, axis=0), self.sensor_windows
        found = self.chirp_windows(*self.decode_chirps(actions))
        return np.arange(found[..., 0].size).reshape(found.shape[:-1]), found.reshape(-1, found.shape[-1])

    def chirp_windows(self, law: Array, duration: Array, sweep: Array) -> Array:
        """The receive windows (..., 11) of any chirps, see ``chirp_covariance``. No clutter field has them."""
        law = np.asarray(law, np.int64)
        if not self.eclipsing:
            return np.broadcast_to(np.append(NEVER_CUT[0], 0.0), (*np.shape(duration), NEVER_CUT.shape[1] + 1))
        table, unit = self._eclipsed.pulses
        timing = unit[law] * np.asarray(duration)[..., None]  # W and the count are no times
        timing[..., 1], timing[..., 6] = 2.0 * np.pi * np.asarray(sweep), 1.0
        windows = receive_windows(self._eclipsed.tables, table[law], timing)
        return np.concatenate([windows, np.zeros_like(windows[..., :1])], axis=-1)

    def chirp_covariance(self, law: Array, duration: Array, sweep: Array) -> Array:
        """C (..., 2, 2) of any chirps: index of the law, duration (s) and signed sweep (Hz), each (...)."""
        factors = unchecked_trapezoid_factors(self._moments[law], duration, sweep)
        return unchecked_covariance(*factors, self.carrier_hz)

    @cached_property
    def _moments(self) -> Array:
        """Moments of each law, (law, 4)."""
        return np.array([chirp_law(*parse_law(law)).moments for law in self.laws])
