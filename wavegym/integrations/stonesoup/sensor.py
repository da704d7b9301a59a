"""A radar that chooses its waveform, as a sensor of Stone Soup, and its law as a measurement model."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.sensor.sensor import Sensor
from stonesoup.sensormanager.action import Action, ActionableProperty, ActionGenerator
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.detection import TrueDetection

from wavegym.core.action_sets import JointLibrary, Library, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.system import System
from wavegym.sensors import energy_detection_probability
from wavegym.systems.agile_clutter import AgileClutter
from wavegym.systems.agile_clutter.scenario import SEARCHED
from wavegym.systems.composed import LineOfSightRadar, Loop, PlanarRadar, Pulses
from wavegym.systems.kershaw_evans import KershawEvans
from wavegym.systems.kershaw_evans.actions import visible_information
from wavegym.waveforms import SPEED_OF_LIGHT


class WaveformMeasurement(NonLinearGaussianMeasurement):
    """The measurement of a radar with one waveform.

    ``noise_covar`` is R(theta) at the SNR of one state: that of the detected target. So the model of a detection has
    the covariance that the receiver knows.
    """

    law: Any = Property(doc="The law: a ``Sensor`` of ``wavegym.systems.composed``, seen from the radar")
    offset: np.ndarray = Property(doc="The radar's position and velocity in the order of the law's states, (n,)")

    @property
    def ndim_meas(self) -> int:
        """Number of measured quantities."""
        return len(self.law.quantities)

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        """The measurement of a state, a column for each of its vectors; ``noise``: as in Stone Soup."""
        vectors = state.state_vector
        if isinstance(noise, bool) or noise is None:
            noise = self.rvs(num_samples=vectors.shape[1], **kwargs) if noise else 0.0
        kind = StateVectors if isinstance(vectors, StateVectors) else StateVector
        return kind(self.law.measure(law_states(vectors, self.mapping, self.offset)).T) + noise

    def jacobian(self, state: Any, **kwargs: Any) -> Array:
        """Derivatives of the measurement, (quantity, state)."""
        H = np.zeros((self.ndim_meas, self.ndim_state))
        H[:, list(self.mapping)] = self.law.jacobian(law_states(state.state_vector, self.mapping, self.offset)[0])
        return H


def law_states(vectors: Any, mapping: Any, offset: Array) -> Array:
    """Stone Soup's vectors (state, sample) as states of a law seen from the radar, (sample, n)."""
    states: Array = np.asarray(vectors, np.float64)[list(mapping)].T - offset
    return states


@dataclass(frozen=True)
class PrintedRadar(PlanarRadar):
    """The law of ``AgileClutter`` with ``snr_law="printed"``: one eta is E/N0 of detection and 2E/N0 of errors."""

    def covariance(self, states: Array, pulse: Array) -> Array:
        """C / eta."""
        return pulse * (1.0 / self.snr(states))[..., None, None]

    def detection(self, states: Array, pulse: Array) -> Array:
        """Pd."""
        return energy_detection_probability(self.snr(states), float(self.false_alarm or 0.0))


class EclipsedChirpRadar(LineOfSightRadar):
    """The law of ``KershawEvans``: the receiver is off while it sends a Gaussian chirp of duration sqrt(2 C11)/c."""

    def covariance(self, states: Array, pulse: Array) -> Array:
        """C / eta of the visible part of the pulse."""
        share = visible_information(np.sqrt(2.0 * pulse[..., 0, 0]) / SPEED_OF_LIGHT, states[..., 0])
        return super().covariance(states, pulse) / share[..., None, None]


class ChangeWaveform(Action):
    """Transmit the waveform ``target_value``."""

    def act(self, current_time: Any, timestamp: Any, init_value: int, **kwargs: Any) -> int:
        """The index of the waveform, without delay."""
        index: int = self.target_value
        return index


class WaveformActionGenerator(ActionGenerator):
    """One ``ChangeWaveform`` for each waveform of the radar's library."""

    def __contains__(self, item: Any) -> bool:
        value = item.target_value if isinstance(item, ChangeWaveform) else item
        return value in range(len(self.owner.pulses.actions))

    def __iter__(self) -> Iterator[ChangeWaveform]:
        return (self.action_from_value(i) for i in range(len(self.owner.pulses.actions)))

    @property
    def default_action(self) -> ChangeWaveform:
        """The waveform stays as it is."""
        return self.action_from_value(self.current_value)

    def action_from_value(self, value: int) -> ChangeWaveform:
        """The action that transmits the waveform ``value``."""
        return ChangeWaveform(generator=self, end_time=self.end_time, target_value=value)


class WaveformRadar(Sensor):
    """A radar that measures each target with the waveform that it was told to transmit.

    Its law is stated relative to the radar. Stone Soup's ``position`` and platforms say where the radar is and how it
    moves. A detection carries the covariance R(theta) / eta at the target's true range: the receiver measures its SNR.
    It adds no clutter.

    Raises:
        InputError: a ``waveform`` that is not in the library; a ``mapping`` outside the state.
    """

    pulses: Pulses = Property(doc="What may be transmitted: ``Pulses`` of ``wavegym.systems.composed``")
    law: Any = Property(
        default_factory=LineOfSightRadar,
        doc="How a state is seen: a ``Sensor`` of ``wavegym.systems.composed``, such as ``LineOfSightRadar()`` or "
        "``PlanarRadar()``, as seen from the radar",
    )
    ndim_state: int = Property(default=2, doc="Number of elements of Stone Soup's state vectors")
    mapping: Sequence[int] = Property(
        default=(0, 1),
        doc="Where the state vector holds the law's state: positions first, then velocities. ``(0, 2, 1, 3)`` for "
        "vectors [x xdot y ydot] and a ``PlanarRadar``",
    )
    seed: int | None = Property(default=None, doc="Of the detections and measurement errors")
    waveform: int = ActionableProperty(
        default=0, generator_cls=WaveformActionGenerator, doc="Index of the waveform that is transmitted"
    )

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        if not all(0 <= i < self.ndim_state for i in self.mapping):
            raise InputError(f"mapping is {tuple(self.mapping)}, expected indices below ndim_state={self.ndim_state}")
        # Draws are counted: a copy costs nothing, and draws on as the original would.
        self._key: Any = np.random.SeedSequence(self.seed).entropy
        self._draws = 0

    @waveform.setter  # type: ignore[attr-defined, no-redef]
    def waveform(self, value: int) -> None:
        """Transmit another waveform from now on."""
        if value not in range(len(self.pulses.actions)):
            most = len(self.pulses.actions) - 1
            raise InputError(f"waveform is {value!r}, expected the index of a waveform, 0 to {most}")
        self._property_waveform = int(value)

    def __deepcopy__(self, memo: dict[int, Any]) -> WaveformRadar:
        """A copy that shares what never changes: a sensor manager copies the sensor for each action that it tries."""
        made = type(self).__new__(type(self))
        memo |= {id(self): made, id(self.law): self.law, id(self.pulses): self.pulses}
        shared = {"scheduled_actions": dict(self.scheduled_actions)}
        moving = {
            name: copy.deepcopy(value, memo)
            for name, value in self.__dict__.items()
            if name not in shared and not isinstance(value, (int, float, tuple, datetime, type(None)))
        }
        made.__dict__.update(self.__dict__ | moving | shared)
        return made

    @property
    def offset(self) -> Array:
        """The radar's position and velocity in the order of the law's states, (n,).

        Raises:
            InputError: a position of more elements than the law has.
        """
        offset = np.zeros(len(self.mapping))
        if self.position is None:
            return offset
        place, speed = (np.asarray(v, np.float64).ravel() for v in (self.position, self.velocity))
        if 2 * len(place) > len(offset):
            wanted = f"{len(offset) // 2}, half as many as mapping={tuple(self.mapping)}"
            raise InputError(f"position has {len(place)} elements, expected {wanted}")
        offset[: len(place)], offset[len(place) : 2 * len(place)] = place, speed
        return offset

    @property
    def measurement_model(self) -> WaveformMeasurement:
        """The model of the present waveform at unit SNR; that of a detection holds the SNR of its target."""
        return self._model(self.pulses.pulse(np.array(self.waveform)))

    def model_at(self, state: Any) -> WaveformMeasurement:
        """The model of the present waveform with the covariance at the SNR of a state."""
        states = law_states(state.state_vector, self.mapping, self.offset)
        return self._model(self.law.covariance(states, self.pulses.pulse(np.array(self.waveform)))[0])

    def snr(self, state: Any) -> float:
        """Eta of a state without the eclipsed part: the covariance is smaller by this factor than at unit SNR.

        In clutter, where errors have the realised SNR, it is the effective eta of detected echoes.
        """
        return float(self.measurement_model.noise_covar[0, 0] / self.model_at(state).noise_covar[0, 0])

    def _model(self, R: Array) -> WaveformMeasurement:
        return WaveformMeasurement(
            ndim_state=self.ndim_state, mapping=tuple(self.mapping), noise_covar=R, law=self.law, offset=self.offset
        )

    def measure(
        self, ground_truths: set[Any], noise: Any = True, random_state: Any = None, **kwargs: Any
    ) -> set[TrueDetection]:
        """A detection of each target that is detected.

        Args:
            ground_truths: true states, or paths at their last state.
            noise: True: errors and detections are drawn; the draws do not depend on the waveform. False: every target
                is detected without error. An array (quantity,) or (quantity, 1): the error; every target is detected.
            random_state: a NumPy generator in place of the sensor's own.
            **kwargs: passed on to the measurement model.
        """
        rng = random_state
        if noise is True and rng is None:
            rng, self._draws = np.random.default_rng([self._key, self._draws]), self._draws + 1
        truths = sorted(ground_truths, key=lambda truth: tuple(np.ravel(truth.state_vector)))  # a set has no order
        found = set()
        for truth in truths:
            model, error = self.model_at(truth), noise
            if noise is True:
                draw, normal = rng.random(), rng.standard_normal(model.ndim_meas)
                if draw >= self._detection(truth):
                    continue
                error = np.linalg.cholesky(model.noise_covar) @ normal
            z = np.ravel(model.function(truth, noise=False, **kwargs)) + (0.0 if error is False else np.ravel(error))
            detection = TrueDetection(
                StateVector(z), timestamp=truth.timestamp, measurement_model=model, groundtruth_path=truth
            )
            found.add(detection)
        return found

    def _detection(self, state: Any) -> float:
        """Probability of detection of a state."""
        states = law_states(state.state_vector, self.mapping, self.offset)
        return float(self.law.detection(states, self.pulses.pulse(np.array(self.waveform)))[0])


def radars_of(system: System, *, seed: int | None = None, **placing: Any) -> tuple[WaveformRadar, ...]:
    """The radars of a system, in its order.

    Args:
        system: of a ``KershawEvans`` environment, of ``AgileClutter``, or a ``Loop`` with ``Pulses``; an index for each
            radar.
        seed: of the first radar; the next ones count up.
        **placing: ``ndim_state`` and ``mapping`` of the radars; by default the state vectors are the system's.

    Raises:
        InputError: another system, actions that are no index, or pulses of one's own that are eclipsed.
    """
    law: Any
    kind: Any
    places: tuple[Any, ...] = (None,)
    if isinstance(system, KershawEvans) and isinstance(system.actions, Library):
        if system.eclipsing and system.library is not None:
            raise InputError("library is given with eclipsing, expected Gaussian chirps (nearest: eclipsing=False)")
        kind = EclipsedChirpRadar if system.eclipsing else LineOfSightRadar
        law = kind(system.reference_range, system.nearest_range)
        pulses, n = Pulses(system.actions, system.carrier_hz), len(system.motion.names)
    elif isinstance(system, Loop) and isinstance(system.waveforms, Pulses):
        law, pulses, n = system.sensor, system.waveforms, len(system.targets.motion.names)
        if isinstance(law, PlanarRadar):
            law, places = replace(law, place=(0.0, 0.0)), (law.place,)
    elif type(system) is AgileClutter and isinstance(system.actions, (PerSensorLibrary, JointLibrary)):
        if len(system.action_set.thresholds[0]) > 1:
            raise InputError(
                "system has several thresholds, expected one (nearest: false_alarms=(), alarm_density=None)"
            )
        ranges = (0.0, 0.0), system.reference_range, system.nearest_range
        kind = PrintedRadar if system.snr_law == "printed" else PlanarRadar
        law = kind(*ranges, system.false_alarm, system.fluctuation, SEARCHED)
        pulses, n = Pulses(Library(system.action_set.sensor_library), system.carrier_hz), 4
        places = system.sensors
    else:
        wanted = "KershawEvans, AgileClutter or a Loop with Pulses, whose actions are indices of a library"
        raise InputError(f"system is {type(system).__name__} with actions {system.actions!r:.60}, expected {wanted}")
    vectors = {"ndim_state": n, "mapping": tuple(range(n))} | placing
    return tuple(
        WaveformRadar(
            pulses=pulses,
            law=law,
            **vectors,
            seed=None if seed is None else seed + i,
            position=None if place is None else StateVector(place),
        )
        for i, place in enumerate(places)
    )
