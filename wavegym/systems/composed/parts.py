"""The parts of a composed loop: their protocols, and ready parts.

Shapes: env environments, candidate pulses that a scheduler compares, n states of a target, m measured quantities.
Functions of states take arrays with any leading axes. The tracker's protocol is ``wavegym.trackers.protocol.Tracker``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from wavegym.core.action_sets import ActionSet, Library
from wavegym.core.arrays import Array
from wavegym.core.covariances import trace_cost
from wavegym.core.errors import (
    InputError,
    check_choice,
    check_int,
    check_ordered,
    check_positive,
    check_probability,
)
from wavegym.sensors import (
    FLUCTUATIONS,
    assumed_echo,
    echo_law,
    range_and_rate,
    range_and_rate_jacobian,
    range_law_snr,
)
from wavegym.sensors.detection_kernels import EchoLaw
from wavegym.targets.motion import MotionModel
from wavegym.trackers.protocol import Estimate
from wavegym.waveforms import measurement_covariances


@runtime_checkable
class Targets(Protocol):
    """Where targets start and how they move.

    Attributes:
        count: number of targets.
        motion: the linear model by which trackers and schedulers predict.
    """

    count: int
    motion: MotionModel

    def draw(self, rng: np.random.Generator, steps: int) -> Any:
        """All random numbers of one episode of ``steps`` steps: a NamedTuple of arrays without an environment axis."""

    def start(self, draws: Any) -> tuple[Array, Estimate]:
        """True states at step 0, (env, target, n), and the first estimate."""

    def move(self, states: Array, draws: Any, step: Array) -> Array:
        """True states one step after ``step`` (env,), fresh (env, target, n)."""


@runtime_checkable
class Waveforms(Protocol):
    """The pulses that may be transmitted.

    Attributes:
        actions: the action set; an action is an index.
    """

    @property
    def actions(self) -> ActionSet:
        """The action set."""

    def pulse(self, actions: Array) -> Array:
        """The pulses of ``actions`` (...) as the sensor needs them: an array (..., ...), such as a covariance."""


@runtime_checkable
class Objective(Protocol):
    """The cost that the loop minimises."""

    def cost(self, estimate: Estimate) -> Array:
        """The cost of estimates, with their leading axes, from means (..., target, n) and covariances."""


class Quantity(NamedTuple):
    """A quantity that a sensor measures, and the scale on which agents see it."""

    name: str
    unit: str
    centre: float
    scale: float


class Errors(NamedTuple):
    """The draws of a sensor for one episode."""

    uniform: Array  # (H, target): detected where below the detection probability
    normal: Array  # (H, target, m): measurement errors


class Sensor(ABC):
    """A sensor that measures every detected target, without false returns.

    Your own sensor gives the measurement, its error covariance and the detection probability. This class draws the
    random numbers.
    """

    quantities: tuple[Quantity, ...]

    @abstractmethod
    def measure(self, states: Array) -> Array:
        """Measurements (..., m) of states (..., n), without error."""

    @abstractmethod
    def jacobian(self, states: Array) -> Array:
        """Derivatives of the measurements, (..., m, n)."""

    @abstractmethod
    def covariance(self, states: Array, pulse: Array) -> Array:
        """Covariance of the error, (..., m, m); leading axes of states (..., n) and pulse (..., *) broadcast."""

    def detection(self, states: Array, pulse: Array) -> Array:
        """Probability of detection, (...); by default 1."""
        return np.ones(states.shape[:-1])

    def draw(self, rng: np.random.Generator, steps: int, targets: int) -> Errors:
        """All random numbers of one episode."""
        return Errors(rng.random((steps, targets)), rng.standard_normal((steps, targets, len(self.quantities))))


@dataclass(frozen=True)
class LinearTargets:
    """Targets that start uniformly in a box and follow a linear motion model.

    Args:
        motion: the model, of n states.
        low, high: bounds of the first state of each target, (target, n).
        prior_variance: diagonal of P0, (n,); the first estimate is drawn around the truth.

    Raises:
        InputError: bounds in the wrong order or of the wrong length, or a variance that is not > 0.
    """

    motion: MotionModel
    low: tuple[tuple[float, ...], ...]
    high: tuple[tuple[float, ...], ...]
    prior_variance: tuple[float, ...]

    def __post_init__(self) -> None:
        n = len(self.motion.names)
        for name, rows in (("low", self.low), ("high", self.high), ("prior_variance", (self.prior_variance,))):
            if len(rows) == 0 or any(len(row) != n for row in rows):
                raise InputError(f"{name} is {rows}, expected {n} numbers for each target: {self.motion.names}")
        if len(self.low) != len(self.high):
            raise InputError(f"low and high are of {len(self.low)} and {len(self.high)} targets, expected one number")
        for lows, highs in zip(self.low, self.high, strict=True):
            for name, low, high in zip(self.motion.names, lows, highs, strict=True):
                check_ordered(f"bounds of the first {name}", low, high)
        for variance in self.prior_variance:
            check_positive("prior_variance", variance)

    class Draws(NamedTuple):
        """One episode's tape."""

        place: Array  # (target, n) uniform: first states
        error: Array  # (target, n) normal: errors of the first estimates
        process: Array  # (H, target, n) normal: manoeuvres

    @property
    def count(self) -> int:
        """Number of targets."""
        return len(self.low)

    def draw(self, rng: np.random.Generator, steps: int) -> Draws:
        """See ``Targets``."""
        shape = self.count, len(self.motion.names)
        return self.Draws(rng.random(shape), rng.standard_normal(shape), rng.standard_normal((steps, *shape)))

    def start(self, draws: Draws) -> tuple[Array, Estimate]:
        """See ``Targets``."""
        low, variance = np.array(self.low), np.array(self.prior_variance)
        states = low + (np.array(self.high) - low) * draws.place
        covariance = np.broadcast_to(np.diag(variance), (*states.shape, len(variance))).copy()
        return states, Estimate(states + np.sqrt(variance) * draws.error, covariance)

    def move(self, states: Array, draws: Draws, step: Array) -> Array:
        """See ``Targets``."""
        process = draws.process[np.arange(len(step)), step]
        return _times(self.motion.F, states) + _times(self.motion.noise_factor, process)


def _times(matrix: Array, vectors: Array) -> Array:
    """``matrix`` (n, n) times each of ``vectors`` (..., n), summed term by term so that a batch equals its elements."""
    return np.stack([sum(a * vectors[..., k] for k, a in enumerate(row)) for row in matrix], axis=-1)


@dataclass(frozen=True)
class Pulses:
    """A library of waveforms; the sensor receives the measurement covariance at unit SNR.

    Args:
        library: waveforms (``wavegym.waveforms.Waveform``).
        carrier_hz: carrier frequency fc, Hz.
    """

    library: Library
    carrier_hz: float

    def __post_init__(self) -> None:
        _ = self.covariances

    @property
    def actions(self) -> Library:
        """The library."""
        return self.library

    @cached_property
    def covariances(self) -> Array:
        """C of each waveform, (waveform, 2, 2), of range (m) and range-rate (m/s)."""
        return measurement_covariances(self.library, self.carrier_hz)

    def pulse(self, actions: Array) -> Array:
        """C of the pulses, (..., 2, 2)."""
        return self.covariances.take(actions, axis=0)


RANGE, RANGE_RATE = Quantity("range", "m", 25e3, 10e3), Quantity("range_rate", "m/s", 0.0, 150.0)


@dataclass(frozen=True)
class LineOfSightRadar(Sensor):
    """A radar that measures range and range-rate of targets on its line of sight, the first two states.

    Args:
        reference_range: range at which eta = 1, m; eta = (reference_range / r)^4.
        nearest_range: below it the SNR stays constant, m.
    """

    reference_range: float = 50e3
    nearest_range: float = 100.0
    quantities = (RANGE, RANGE_RATE)

    def measure(self, states: Array) -> Array:
        """Range and range-rate."""
        return np.array(states[..., :2])

    def jacobian(self, states: Array) -> Array:
        """[I 0]."""
        return np.broadcast_to(np.eye(2, states.shape[-1]), (*states.shape[:-1], 2, states.shape[-1]))

    def covariance(self, states: Array, pulse: Array) -> Array:
        """C / eta."""
        eta = range_law_snr(abs(states[..., 0]), self.reference_range, self.nearest_range)
        return pulse * (1.0 / eta)[..., None, None]


@dataclass(frozen=True)
class PlanarRadar(Sensor):
    """A radar at a place in the plane that measures range and range-rate of states [x y xdot ydot].

    The errors have the mean covariance of detected echoes, which fluctuate.

    Args:
        place: (x, y), m.
        reference_range, nearest_range: as in ``LineOfSightRadar``.
        false_alarm: Pf of a known cell. None: every pulse detects, at the mean SNR.
        fluctuation, searched: of echoes, see ``wavegym.sensors.detection_probability``.

    Raises:
        InputError: an invalid value; ``fluctuation`` or ``searched`` without ``false_alarm``, as they have no effect.
    """

    place: tuple[float, float] = (0.0, 0.0)
    reference_range: float = 50e3
    nearest_range: float = 100.0
    false_alarm: float | None = None
    fluctuation: str = "swerling1"
    searched: int = 0
    quantities = (RANGE, RANGE_RATE)

    def __post_init__(self) -> None:
        check_choice("fluctuation", self.fluctuation, FLUCTUATIONS)
        check_int("searched", self.searched, 0)
        if self.false_alarm is not None:
            check_probability("false_alarm", self.false_alarm)
        elif (self.fluctuation, self.searched) != (PlanarRadar.fluctuation, PlanarRadar.searched):
            raise InputError(
                f"fluctuation is {self.fluctuation!r} and searched is {self.searched} without a threshold,"
                " expected a false_alarm"
            )

    def measure(self, states: Array) -> Array:
        """Range and range-rate."""
        return range_and_rate(states, self.place)

    def jacobian(self, states: Array) -> Array:
        """Of range and range-rate."""
        return range_and_rate_jacobian(states, self.place)

    def snr(self, states: Array) -> Array:
        """Mean eta, (...)."""
        return range_law_snr(self.measure(states)[..., 0], self.reference_range, self.nearest_range)

    def covariance(self, states: Array, pulse: Array) -> Array:
        """C over the effective eta of a detected echo."""
        eta = self.snr(states)
        if self.false_alarm is None:
            return pulse * (1.0 / eta)[..., None, None]
        return pulse * (1.0 / assumed_echo(eta, self._law).effective)[..., None, None]

    @cached_property
    def _law(self) -> EchoLaw:
        return echo_law((float(self.false_alarm or 0.0),), self.fluctuation, self.searched)

    def detection(self, states: Array, pulse: Array) -> Array:
        """Pd."""
        if self.false_alarm is None:
            return super().detection(states, pulse)
        return assumed_echo(self.snr(states), self._law).detection


@dataclass(frozen=True)
class WeightedTrace:
    """trace(Lambda P) summed over the targets.

    Args:
        weights: the diagonal of Lambda, (n,).
    """

    weights: tuple[float, ...]

    def cost(self, estimate: Estimate) -> Array:
        """See ``Objective``."""
        return trace_cost(estimate.covariance, np.array(self.weights, np.float64))
