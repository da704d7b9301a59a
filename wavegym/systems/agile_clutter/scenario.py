"""The parameters of AgileClutter, their checks, and what follows: motion, pulses, tables of the kernels, cost."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import NonNegativeInt

from wavegym.core.action_sets import JointLibrary, Library, ParameterBox, PerSensorLibrary
from wavegym.core.arrays import Array, for_kernel
from wavegym.core.covariances import check_precision
from wavegym.core.errors import InputError, check_positive, check_within
from wavegym.core.horizon_weights import LinearCost
from wavegym.core.parameters import Positive, Probability, parameter, system_parameters
from wavegym.core.system import System
from wavegym.core.traits import TimedPulses
from wavegym.sensors import (
    echo_law,
    false_return_density,
    gate_probability,
    range_and_rate,
    range_and_rate_jacobian,
    range_law_snr,
)
from wavegym.sensors.detection import Fluctuation
from wavegym.sensors.scatterers import KINDS, Kind, Scatterers, clutter_field
from wavegym.sensors.scatterers_kernels import ClutterField
from wavegym.sensors.trains import LOWEST, check_threshold
from wavegym.systems.agile_clutter import kernels
from wavegym.systems.agile_clutter import prediction_kernels as prediction
from wavegym.systems.agile_clutter.actions import ChirpActions
from wavegym.systems.agile_clutter.state import (
    TRACKERS,
    Belief,
    NonNegativeState,
    PlanarState,
    PositiveState,
    greatest_gate_volume,
)
from wavegym.systems.recorded_targets import (
    PlaysRecordings,
    farthest_range_parameter,
    radar_parameter,
    smoothing_parameter,
    targets_parameter,
    tracks_parameter,
)
from wavegym.targets import MotionModel, constant_turn
from wavegym.trackers import predict_covariance
from wavegym.trackers.association_kernels import CLUSTER_LIMIT
from wavegym.trackers.protocol import Tracker, TrackerWithMemory, given_tracker
from wavegym.waveforms import PulseTiming, check_range_folds, check_time_on_target, pulse_timings
from wavegym.waveforms.timing import ENERGY

SEARCHED = 2  # quantities over which a receiver takes the greatest value: delay and Doppler
MOST_SENSORS = 16
FASTER = 100.0  # m/s, reach of the clutter's table beyond 1.25 times the greatest first speed
MOST_STARTS = 256  # of a recording, at which the clutter in the gates is checked


@system_parameters
class ClutterScenario(System, TimedPulses, PlaysRecordings):
    """Parameters of ``AgileClutter``, their checks, and what follows: motion, pulses, kernel tables, cost."""

    horizon: int = parameter(32, "steps in an episode", ge=1)
    dt: float = parameter(0.25, "time step", unit="s", gt=0)
    q: float = parameter(1.0, "process noise density", unit="m^2/s^3", truth=True, ge=0)
    turn_rate: float = parameter(
        0.0, "turn rate of all targets, positive to the left", unit="rad/s", truth=True, ge=-10, le=10
    )
    carrier_hz: float = parameter(10.4e9, "carrier frequency fc", unit="Hz", gt=0)
    eclipsing: bool = parameter(
        True,
        f"a receiver is off while its radar transmits {100 * ENERGY:g} % of a pulse's energy",
        unit="",
    )
    reference_range: float = parameter(50e3, "r0, the range at which eta = 1", unit="m", truth=True, gt=0)
    nearest_range: float = parameter(100.0, "below this range the SNR stays constant", unit="m", truth=True, gt=0)
    sensors: tuple[tuple[float, float], ...] = parameter(
        ((3e3, -16e3), (3e3, 20.4e3)), "position (x, y) of each sensor", unit="m"
    )
    starts: tuple[PlanarState, ...] = parameter(
        ((2e3, -1e3, -100.0, 800.0), (1e3, -1e3, 100.0, 800.0)),
        "first [x y xdot ydot] of each target",
        unit="m, m/s",
        truth=True,
    )
    births: tuple[NonNegativeInt, ...] = parameter((0, 7), "step at which the tracker receives each target")
    lifetime: int = parameter(25, "number of steps in which each target is tracked", ge=1, le=100_000)
    prior_variance: PositiveState = parameter(
        (4e3, 4e3, 100.0, 100.0),
        "diagonal of P0, the covariance of the first estimate",
        unit="m^2, m^2/s^2",
        truth=True,
    )
    snr_law: Literal["realised", "printed"] = parameter(
        "realised",
        '"realised": the SNR of each echo decides on detection and errors, and noise has false returns; "printed": '
        "Pd = Pf^(1 / (1 + eta)), errors at the mean SNR, and no false returns of noise",
        unit="",
    )
    fluctuation: Fluctuation = parameter(
        "swerling1",
        "fluctuation of echoes from step to step; a pulse or coherent train is one look, so swerling2 equals swerling1 "
        "and swerling4 equals swerling3",
        unit="",
        truth=True,
    )
    false_alarm: float = parameter(
        0.01, "false alarm probability Pf of a cell, which sets the threshold", truth=True, gt=0, lt=1
    )
    false_alarms: tuple[Probability, ...] = parameter(
        (), "several Pf in place of false_alarm: a sensor chooses one with its waveform", unit=""
    )
    alarm_density: float | None = parameter(
        None,
        "density of the false returns of noise, the same for all waveforms; each waveform then has its own threshold, "
        "in place of false_alarm",
        unit="s/m^2",
        gt=0,
    )
    clutter_density: float = parameter(
        1e-4,
        "density of other false returns, per m of range and m/s of range-rate",
        unit="s/m^2",
        truth=True,
        ge=0,
    )
    scatterers: Kind | Scatterers | None = parameter(
        None,
        'field of scatterers that compete with an echo in its filter: "ground", "sea", "rain" or a Scatterers',
        unit="",
        truth=True,
    )
    gate: float = parameter(4.0, "radius of the validation gates in standard deviations", gt=0)
    weights: NonNegativeState = parameter((1.0, 1.0, 1.0, 1.0), "diagonal of Lambda", unit="1, s^2")
    laws: tuple[str, ...] = parameter(
        ("lfm", "pfm:3", "hfm:0.5", "efm:0.5"),
        'phase functions: "lfm", "pfm:KAPPA", "hfm:SHAPE" or "efm:SHAPE"',
        unit="",
    )
    durations: tuple[Positive, ...] = parameter((10e-6, 30e-6, 100e-6), "durations of the library", unit="s")
    sweeps: tuple[Positive, ...] = parameter(
        (1e6, 4e6, 15e6),
        "sweeps of the library: every law, with every duration and sweep, up and down",
        unit="Hz",
    )
    library: Library | None = parameter(
        None, "a Library of your own waveforms; replaces ``laws``, ``durations`` and ``sweeps``", unit=""
    )
    action: Literal["library", "joint", "box"] = parameter(
        "library",
        '"library": a waveform per sensor; "joint": one index for all sensors (every law up and down, at the longest '
        'duration and the widest sweep); "box": a point; for every sensor the law\'s index, rounded down (omitted for '
        "a single law), log duration and signed sweep",
        unit="",
    )
    tracker: Any = parameter(
        "mixture",
        '"mixture" (Gaussian mixtures), "jpda" (joint probabilistic data association), "particle" (a Rao-Blackwellised '
        "particle filter), a Tracker of ``wavegym.trackers.protocol``, or ``package.module:name`` of its factory",
        unit="",
    )
    particles: int = parameter(1000, "number of particles with tracker='particle'", ge=2, le=1_000_000)
    components: int = parameter(16, "maximum number of components of a target with tracker='mixture'", ge=1, le=10_000)
    targets: Literal["random", "recorded"] = targets_parameter()
    tracks: Path | None = tracks_parameter()
    radar: tuple[float, ...] | None = radar_parameter()
    farthest_range: float = farthest_range_parameter(50e3)
    smoothing: float | None = smoothing_parameter()

    def __post_init__(self) -> None:
        """Check several fields together."""
        check_positive("sum of weights", sum(self.weights))
        self._given_tracker  # noqa: B018  (an invalid tracker is reported here)
        self._check_library()
        self._check_thresholds()
        self._check_targets()
        self._recorded  # noqa: B018  (an invalid recording is reported here)
        self._check_clutter()
        self._check_scatterers()
        self._check_precision()
        check_time_on_target(self.timings, self.dt)
        check_range_folds(self.timings, self._farthest_range())

    def _check_library(self) -> None:
        """InputError if both ``library`` and parameters of the built-in library are given."""
        if self.library is None:
            return
        if self.action == "box":
            raise InputError(
                "library is given with action='box', expected action='library' or 'joint': a box spans built-in chirps"
            )
        for field in dataclasses.fields(self):
            if field.name in ("laws", "durations", "sweeps") and getattr(self, field.name) != field.default:
                given = f"{field.name} is {getattr(self, field.name)} with library="
                raise InputError(f"{given}, expected one of the two: the library takes the place of the chirps")

    def _check_thresholds(self) -> None:
        """InputError for thresholds that do not fit together, or that lie in the noise."""
        several = [name for name in ("false_alarms", "alarm_density") if getattr(self, name)]
        if several and self.snr_law == "printed":
            raise InputError(f"{several[0]} is given with snr_law='printed', expected snr_law='realised'")
        if several and self.action == "box":
            raise InputError(f"{several[0]} is given with action='box', expected action='library' or 'joint'")
        if len(several) > 1:
            raise InputError("false_alarms and alarm_density are given, expected one of the two")
        if several and self.false_alarm != type(self).false_alarm:
            given = f"false_alarm is {self.false_alarm!r} with {several[0]}="
            raise InputError(f"{given}, expected one of the two: it takes the place of false_alarm")
        if len(set(self.false_alarms)) < len(self.false_alarms):
            raise InputError(f"false_alarms is {self.false_alarms}, expected each probability once")
        if self.snr_law == "printed" and self.fluctuation != "swerling1":
            raise InputError(f"fluctuation is {self.fluctuation!r} with snr_law='printed', expected 'swerling1'")
        if self.alarm_density:
            greatest = float(false_return_density(self.action_set.sensor_covariances, LOWEST).min())
            if self.alarm_density > greatest:
                wanted = f"at most {greatest:.6g}: beyond it the noise peaks of the coarsest waveform merge"
                raise InputError(f"alarm_density is {self.alarm_density:g} s/m^2, expected {wanted}")
        for alarm in () if self.snr_law == "printed" else self.false_alarms or (self.false_alarm,):
            check_threshold(alarm)

    def _check_targets(self) -> None:
        """InputError for numbers of sensors and targets, or times, that do not make a scenario."""
        check_within("number of sensors", len(self.sensors), 1, MOST_SENSORS)
        check_within("number of targets (exact joint association)", len(self.starts), 1, CLUSTER_LIMIT)
        if len(self.births) != len(self.starts):
            raise InputError(f"births is {self.births}, expected {len(self.starts)} steps, one for each of starts")
        last = max(self.births) + self.lifetime
        if self.horizon > last:
            wanted = f"1 to {last}, when the last target is gone (the greatest of births + lifetime)"
            raise InputError(f"horizon is {self.horizon} steps, expected {wanted}; nearest: {last}")
        check_within("least of births", min(self.births), 0, self.horizon - 1)

    def _check_clutter(self) -> None:
        """InputError for a density that expects too many points in a gate, even of a target that is never detected."""
        C, snr = self.action_set.sensor_covariances, (self.reference_range, self.nearest_range)
        starts = self._possible_starts()
        P, volume = np.diag(self.prior_variance), 0.0
        for age in (1, self.lifetime):
            coasting = self._motion_over(age * self.dt)
            after = starts @ coasting.F.T, predict_covariance(P, coasting.F, coasting.Q)
            volume = max(volume, greatest_gate_volume(*after, self.sensors, C, snr, self.gate))
        most = float(f"{kernels.MOST_CLUTTER / volume:.3g}")
        if not self.clutter_density <= most:
            raise InputError(
                f"clutter_density is {self.clutter_density!r} s/m^2, expected a number in [0, {most:g}] (nearest: "
                f"{most:g}): a target of prior_variance {self.prior_variance} that is not detected in {self.lifetime} "
                f"steps of {self.dt:g} s would have over {kernels.MOST_CLUTTER:g} false returns in its gate"
            )

    def _check_scatterers(self) -> None:
        """InputError for scatterers with chirps that have no table."""
        if self.scatterers is not None and self.action == "box":
            raise InputError("scatterers is given with action='box', expected action='library' or 'joint'")

    def _check_precision(self) -> None:
        """InputError for pulses too fine for the tracker; see ``check_precision``."""
        starts, places = np.array(self.starts), np.array(self.sensors)[:, None]
        H = range_and_rate_jacobian(starts, places)  # (sensor, target, 2, 4)
        P = H @ predict_covariance(np.diag(self.prior_variance), self.motion.F, self.motion.Q) @ np.swapaxes(H, -1, -2)
        eta = range_law_snr(range_and_rate(starts, places)[..., 0], self.reference_range, self.nearest_range)
        check_precision(P, self.action_set.sensor_covariances, eta, self.reference_range)

    def farthest_starts(self) -> Array:
        """First states of the targets that stand for all possible ones, (state, 4)."""
        return np.array(self.starts)

    def _farthest_range(self) -> float:
        """Range of the farthest target, without manoeuvres, at its birth or the end of its stay, m."""
        starts = self._possible_starts()
        last = starts @ self._motion_over(min(self.lifetime, self.horizon) * self.dt).F.T
        return float(range_and_rate(np.stack([starts, last])[:, :, None], np.array(self.sensors))[..., 0].max())

    @cached_property
    def motion(self) -> MotionModel:
        """The targets' motion model as the tracker assumes it; ``truth_model.motion`` is the world's."""
        return self._motion_over(self.dt)

    def _motion_over(self, seconds: float) -> MotionModel:
        return constant_turn(seconds, self.q, self.turn_rate, order="derivative")

    @cached_property
    def _given_tracker(self) -> Tracker | None:
        """The given tracker; None for one of TRACKERS.

        Raises:
            InputError: no such tracker, or one with a memory where targets come and go.
        """
        tracker = given_tracker(self.tracker, TRACKERS)
        if isinstance(tracker, TrackerWithMemory) and (any(self.births) or self.lifetime < self.horizon):
            wanted = "one without a memory: targets come and go (nearest: births of 0, and horizon <= lifetime)"
            raise InputError(f"tracker is {type(tracker).__name__}, expected {wanted}")
        return tracker

    @cached_property
    def action_set(self) -> ChirpActions:
        """The chirps of all sensors in the form that ``action`` names."""
        chirps = (self.laws, self.durations, self.sweeps, self.carrier_hz)
        return ChirpActions(
            *chirps, len(self.sensors), self.action, own=self.library, eclipsing=self.eclipsing,
            false_alarms=self.false_alarms or (self.false_alarm,), alarm_density=self.alarm_density,
        )  # fmt: skip

    @property
    def actions(self) -> PerSensorLibrary | JointLibrary | ParameterBox:
        """The action set."""
        return self.action_set.actions

    @property
    def timings(self) -> dict[str, PulseTiming]:
        """One pulse, or one train, of each sensor in a step."""
        return pulse_timings(filter(None, self.action_set.sensor_library), self.carrier_hz)

    @cached_property
    def _targets(self) -> tuple[Array, int]:
        return np.array(self.births, np.int64), self.lifetime

    @cached_property
    def _model(self) -> tuple[Array, Array]:
        return self.motion.F[None].copy(), self.motion.Q[None].copy()

    @cached_property
    def _radar(self) -> kernels.Radar:
        """Sensors, their laws, clutter and gates."""
        alarms, is_printed = self.action_set.thresholds[0], self.snr_law == "printed"
        if is_printed:
            law, noise = echo_law(alarms, energy=1.0, realised=False), np.zeros(len(alarms))
        else:
            law = echo_law(alarms, self.fluctuation, SEARCHED)
            noise = false_return_density(np.eye(2), law.threshold)  # of a cell with det C = 1
        return kernels.Radar(
            np.array(self.sensors), self.reference_range, self.nearest_range, law, noise, self.clutter_density,
            self.gate, float(gate_probability(self.gate)), self.carrier_hz, self.action_set.tables,
            self.clutter_field,
        )  # fmt: skip

    @cached_property
    def clutter_field(self) -> ClutterField | None:
        """c(r, v) of every waveform."""
        if self.scatterers is None:
            return None
        field = self.scatterers if isinstance(self.scatterers, Scatterers) else KINDS[self.scatterers]
        fastest = 1.25 * float(np.hypot(*self._possible_starts()[:, 2:].T).max()) + FASTER
        farthest = 1.25 * self._farthest_range()
        return clutter_field(field, tuple(self.action_set.waveforms), self.carrier_hz, farthest, fastest)

    @cached_property
    def linear_cost(self) -> LinearCost:
        """The cost as a function of the covariance, and the targets' transition."""
        return LinearCost(self.motion.F, self.weights)

    @cached_property
    def _weights(self) -> Array:
        return np.array(self.weights)

    @property
    def _recorded_shape(self) -> tuple[int, int]:
        """Targets, and steps for which each is tracked."""
        return len(self.starts), self.lifetime

    def _possible_starts(self) -> Array:
        """First states that stand for all possible ones, (state, 4): the given ones, or a selection of the recorded."""
        if not self._recorded:
            return self.farthest_starts()
        played = self._recorded.catalogue
        return played.samples[played.starts[:: -(-len(played) // MOST_STARTS)]]

    def cost(self, belief: Belief) -> Array:
        """trace(Lambda P) summed over the targets present."""
        step, P = for_kernel(belief.step), for_kernel(belief.covariance)
        cost = np.empty(step.size)
        prediction.weighted_trace(step.reshape(-1), P.reshape(-1, *P.shape[-3:]), self._targets, self._weights, cost)
        return cost.reshape(step.shape)
