"""The parameters of the RF/EO loop, their checks, and derived quantities: motion, settings, places, presence."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, NonNegativeInt, WrapValidator

from wavegym.core.arrays import Array
from wavegym.core.covariances import MOST_RATIO, check_covariance
from wavegym.core.errors import InputError, check_ordered, check_positive, check_within
from wavegym.core.parameters import NonNegative, Positive, parameter, system_parameters
from wavegym.core.system import System
from wavegym.sensors import range_and_rate
from wavegym.sensors.platform import KINDS, Penalty
from wavegym.systems.recorded_targets import (
    PlaysRecordings,
    farthest_range_parameter,
    radar_parameter,
    smoothing_parameter,
    targets_parameter,
    tracks_parameter,
)
from wavegym.systems.rf_eo.actions import PlatformActions
from wavegym.systems.rf_eo.look_kernels import Rules
from wavegym.systems.rf_eo.state import Belief
from wavegym.targets import MotionModel, constant_turn
from wavegym.trackers.protocol import Tracker, TrackerWithMemory, given_tracker
from wavegym.waveforms import SPEED_OF_LIGHT, PulseTiming

StateWeights = tuple[NonNegative, NonNegative, NonNegative, NonNegative]
SEQUENCES = (tuple, list, np.ndarray)
SIZE = 4  # elements of the state [x xdot y ydot]
MOST = 64  # targets, and platforms
TRACKERS = ("ekf",)
LONGEST = 1_000_000  # steps
FARTHEST = 1e9  # m, m/s: double precision still resolves differences at this size
FASTEST = 1e6  # rad/s
GREATEST = 1e12  # PRF and bandwidth in Hz, pixel angle in rad

Coordinate = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST, allow_inf_nan=False)]
Position = tuple[Coordinate, Coordinate]
TargetState = tuple[Coordinate, Coordinate, Coordinate, Coordinate]
Azimuth = Annotated[float, Field(ge=-math.pi, le=math.pi, allow_inf_nan=False)]
TurnRate = Annotated[float, Field(ge=-FASTEST, le=FASTEST, allow_inf_nan=False)]
Bound = Annotated[float, Field(gt=0, le=GREATEST, allow_inf_nan=False)]
Bounds = tuple[Bound, Bound]  # least and greatest
StateVariance = tuple[Positive, Positive, Positive, Positive]


def _diagonal_or_rows(given: Any, as_diagonal: Callable[[Any], Any]) -> Any:
    """Four numbers unchanged, or four rows as a tuple of tuples; InputError if the rows are not a weighting matrix."""
    if not (isinstance(given, SEQUENCES) and any(isinstance(row, SEQUENCES) for row in given)):
        return as_diagonal(given)
    sizes = [np.size(row) for row in given]
    if sizes != [SIZE] * SIZE:
        raise InputError(f"weights has rows of {sizes} elements, expected 4 numbers, or 4 rows of 4")
    return tuple(map(tuple, check_covariance("weights", np.array(given, np.float64)).tolist()))


Weights = Annotated[StateWeights, WrapValidator(_diagonal_or_rows)]


def weighting_matrix(weights: Weights) -> Array:
    """W, (4, 4). InputError if its trace is 0."""
    given = np.array(weights)
    matrix = np.diag(given) if given.ndim == 1 else given
    check_positive("sum of weights", float(np.trace(matrix)))
    return matrix


@system_parameters
class PlatformScenario(System, PlaysRecordings):
    """Parameters of ``RfEo``, their checks, and derived quantities: motion, settings, places, presence."""

    horizon: int = parameter(1000, "steps in an episode", ge=1, le=LONGEST)
    dt: float = parameter(1.0, "time step", unit="s", gt=0, le=1e6)
    q: float = parameter(0.01, "process noise density", unit="m^2/s^3", truth=True, ge=0, le=1e12)
    turn_rate: TurnRate = parameter(0.0, "turn rate of the targets' velocities, to the left", unit="rad/s", truth=True)
    carrier_hz: float = parameter(10e9, "carrier frequency fc", unit="Hz", gt=0, le=1e15)
    fft_length: int = parameter(128, "Nfft, pulses integrated", truth=True, ge=1, le=1_000_000)
    pixels: int = parameter(1000, "Npix, pixels across the image", truth=True, ge=1, le=1_000_000)
    platforms: tuple[Position, ...] = parameter(((-1e3, -1e3), (1e3, -1e3)), "positions (x, y)", unit="m")
    looks: tuple[Azimuth, ...] = parameter(
        (), "look direction of each platform, clockwise from +y; by default all look along +y", unit="rad"
    )
    slew_rate: float = parameter(
        0.0, "maximum turn rate of each look direction; 0: fixed", unit="rad/s", ge=0, le=FASTEST
    )
    turns: int = parameter(
        5, "with a slew rate: number of turns in the library, equally spaced; odd, so that one is 0", ge=1, le=10_001
    )
    starts: tuple[TargetState, ...] = parameter(
        ((-1e3, 0.0, 1e3, 0.0), (1e3, 0.0, 1e3, 0.0)), "first state [x xdot y ydot] of each target", unit="m, m/s"
    )
    births: tuple[NonNegativeInt, ...] = parameter((), "step at which each target comes; by default 0 for all")
    lifetime: int = parameter(LONGEST, "number of steps in which each target stays", ge=1, le=LONGEST)
    first_estimate: Literal["halfway", "drawn"] = parameter("halfway", "first estimates; see Starting state", unit="")
    prior_variance: StateVariance = parameter((1e6, 25.0, 1e6, 25.0), "diagonal of P0", unit="m^2, m^2/s^2", truth=True)
    prf: Bounds = parameter((1e3, 100e3), "minimum and maximum pulse repetition frequency", unit="Hz")
    bandwidth: Bounds = parameter((1e6, 20e6), "minimum and maximum bandwidth B", unit="Hz")
    pixel_angle: Bounds = parameter((1e-5, 2e-3 * math.pi), "minimum and maximum pixel angle alpha", unit="rad")
    points: tuple[int, int, int] = parameter((4, 1, 4), "number of PRFs, bandwidths and pixel angles in the library")
    penalty: Penalty = parameter("logistic", "growth of a predicted variance at the edge of the field of view", unit="")
    sharpness: tuple[Positive, Positive, Positive] | None = parameter(
        None,
        "nu of the penalty relative to the edge, for range, range-rate and azimuth; by default 100, or 1e8 for the "
        "log-barrier",
    )
    height: tuple[NonNegative, NonNegative, NonNegative] = parameter(
        (1e8, 1e6, 10.0), "gamma of the penalty, for range, range-rate and azimuth", unit="m^2, m^2/s^2, rad^2"
    )
    out_of_view: Literal["missing", "inflated"] = parameter(
        "missing",
        "quantities outside the field of view: not received, or (as in the paper) drawn with a penalised variance",
        unit="",
    )
    iterations: int = parameter(
        10, "maximum iterations of an update; 1: the paper's extended Kalman filter", ge=1, le=1_000_000
    )
    margin: float = parameter(
        0.0, "distance inside the field of view that a predicted quantity needs, in standard deviations", ge=0
    )
    threshold: float = parameter(
        0.5, "t, the minimum weighted information that the paper's scheduler requires of every target", ge=0
    )
    weights: Weights = parameter((1.0, 1.0, 1.0, 1.0), "diagonal of W, or all of W as four rows", unit="1, s^2")
    nearest_range: float = parameter(
        1.0, "a platform does not measure targets nearer than this", unit="m", truth=True, gt=0, le=FARTHEST
    )
    tracker: Any = parameter(
        "ekf",
        "``ekf``: the filter of the description; a Tracker of ``wavegym.trackers.protocol``, or "
        "``package.module:name`` of its factory",
        unit="",
    )
    folding: bool = parameter(
        False, "whether range and range-rate beyond the unambiguous interval are received folded, or not at all"
    )
    duty: float = parameter(
        0.1,
        "with folding: share of time in which the radar transmits; an echo that overlaps with it is lost",
        truth=True,
        ge=0,
        lt=0.5,
    )
    notch: float = parameter(
        10.0, "with folding: half width of the clutter notch around folded range-rate 0", unit="m/s", truth=True, ge=0
    )
    as_printed: bool = parameter(False, "use the paper's misprinted equations", unit="")
    action: Literal["box", "library", "joint"] = parameter(
        "box",
        "log PRF, B and alpha of every platform; an index for each platform; or one index for all platforms",
        unit="",
    )
    targets: Literal["random", "recorded"] = targets_parameter()
    tracks: Path | None = tracks_parameter()
    radar: tuple[float, ...] | None = radar_parameter()
    farthest_range: float = farthest_range_parameter(100e3)
    smoothing: float | None = smoothing_parameter()

    def __post_init__(self) -> None:
        """Check several fields together."""
        self._check_tracker()
        self._weights  # noqa: B018  (invalid weights are reported here)
        for name in ("platforms", "starts"):
            check_within(f"number of {name}", len(getattr(self, name)), 1, MOST)
        if self.looks and len(self.looks) != len(self.platforms):
            raise InputError(f"looks is {self.looks}, expected {len(self.platforms)} angles, one for each platform")
        for name in ("prf", "bandwidth", "pixel_angle"):
            low, high = getattr(self, name)
            check_ordered(name, low, high)
            if low == high:
                raise InputError(f"{name} is ({low:g}, {high:g}), expected low < high")
        self._check_births()
        if self.turns % 2 == 0:
            raise InputError(
                f"turns is {self.turns}, expected an odd number, so that 0 is one of them (nearest: {self.turns + 1})"
            )
        self._check_camera()
        self._check_radar()
        self._check_folding()
        self._recorded  # noqa: B018  (an invalid recording is reported here)
        self.action_set.levels  # noqa: B018  (invalid points are reported here)

    def _check_births(self) -> None:
        """InputError for births that do not fit the targets, come too late, or leave the scene empty."""
        if not self.births:
            return
        if self._recorded:
            raise InputError(f"births is {self.births}, expected () with recorded targets (nearest: ())")
        if len(self.births) != len(self.starts):
            raise InputError(f"births is {self.births}, expected {len(self.starts)} steps, one for each of starts")
        check_within("greatest of births", max(self.births), 0, self.horizon - 1)

    def _check_tracker(self) -> None:
        """InputError for an invalid tracker, or for one with a memory if targets come and go."""
        if isinstance(self._given_tracker, TrackerWithMemory) and self._come_and_go:
            wanted = "a tracker without begin(estimate, motion), because targets come and go"
            raise InputError(f"tracker {type(self._given_tracker).__name__} has a memory, expected {wanted}")

    def _check_camera(self) -> None:
        """InputError for an image wider than the full circle."""
        widest = 2.0 * math.pi / self.pixels
        if self.pixel_angle[1] > widest * (1.0 + 1e-9):
            wanted = f"at most 2 pi / pixels, the full circle (nearest: {widest:.6g})"
            raise InputError(f"high of pixel_angle is {self.pixel_angle[1]:g} rad, expected {wanted}")

    def _check_radar(self) -> None:
        """InputError for a range variance too small for double precision, or pulses that do not fit into a step."""
        finest = 0.5 * SPEED_OF_LIGHT / self.bandwidth[1]
        ratio = max(self.prior_variance) / (finest * finest / 12.0)
        if ratio > MOST_RATIO:
            least = max(self.prior_variance) * MOST_RATIO / ratio
            wanted = f"at most {MOST_RATIO:g} times the least range variance, (c / 2B)^2 / 12 (nearest: {least:.3g})"
            raise InputError(f"prior_variance is up to {max(self.prior_variance):g}, expected {wanted}")
        dwell = self.fft_length / self.prf[0]
        if dwell > self.dt:
            wanted = f"at most dt = {self.dt:g} s (nearest prf: {self.fft_length / self.dt:g} Hz)"
            given = f"dwell of {self.fft_length} pulses at {self.prf[0]:g} Hz is {dwell:g} s"
            raise InputError(f"{given}, expected {wanted}")

        self.timings  # noqa: B018  (a PRF without room for the pulse is reported here)

    def _check_folding(self) -> None:
        """InputError for folding with the paper's other forms, or a notch that hides all targets at the lowest PRF."""
        if not self.folding:
            return
        if self.out_of_view == "inflated":
            raise InputError("out_of_view is 'inflated', expected 'missing' with folding (nearest: 'missing')")
        if self.as_printed:
            raise InputError("as_printed is True, expected False with folding (nearest: False)")
        half = 0.25 * self.wavelength * self.prf[0]
        if not self.notch < half:
            least = 4.0 * self.notch / self.wavelength
            raise InputError(
                f"notch is {self.notch:g} m/s, expected less than half the unambiguous velocity of the lowest PRF, "
                f"{half:.4g} m/s at {self.prf[0]:g} Hz (nearest: {0.99 * half:.4g}, or a prf from {1.01 * least:.4g})"
            )

    @property
    def _recorded_shape(self) -> tuple[int, int]:
        """Number of targets, and number of steps."""
        return len(self.starts), self.horizon

    @property
    def wavelength(self) -> float:
        """lambda in m."""
        return SPEED_OF_LIGHT / self.carrier_hz

    @cached_property
    def motion(self) -> MotionModel:
        """The targets' motion model as the tracker assumes it; ``truth_model.motion`` is that of the world."""
        return constant_turn(self.dt, self.q, self.turn_rate)

    @cached_property
    def _given_tracker(self) -> Tracker | None:
        """The given tracker; None for the compiled filter."""
        return given_tracker(self.tracker, TRACKERS)

    @cached_property
    def action_set(self) -> PlatformActions:
        """The settings that the platforms may take."""
        ranges = (self.prf, self.bandwidth, self.pixel_angle)
        optics = (self.wavelength, self.fft_length, self.pixels, self.as_printed)
        greatest_turn = min(self.slew_rate * self.dt, math.pi)
        return PlatformActions(
            ranges, self.points, len(self.platforms), self.action, *optics, greatest_turn, self.turns
        )  # fmt: skip

    @property
    def places(self) -> Array:
        """(x, y) of every platform in m and its first look direction in rad, (platform, 3); always a new array."""
        looks = self.looks or (0.0,) * len(self.platforms)
        return np.column_stack([self.platforms, looks])

    def places_at(self, belief: Belief) -> Array:
        """(x, y) of every platform in m and its look direction in rad, (env, platform, 3)."""
        return np.concatenate([np.broadcast_to(self.platforms, (*belief.looks.shape, 2)), belief.looks[..., None]], -1)

    @cached_property
    def _stay(self) -> Array:
        """The steps after which each target comes and goes, (target, 2) int."""
        births = np.array(self.births or (0,) * len(self.starts), np.int64)
        return np.stack([births, births + self.lifetime], axis=1)

    @cached_property
    def _come_and_go(self) -> bool:
        """Whether any target is absent from the scene at some step."""
        return any(self.births) or self.lifetime < self.horizon

    def present(self, step: Array) -> Array:
        """Which targets are in the scene at each of the steps (...), (..., target) bool."""
        first, last = self._stay.T
        return (first < step[..., None]) & (step[..., None] <= last)

    @property
    def _seats(self) -> Array:
        """(x, y, 0) of every platform."""
        return np.column_stack([self.platforms, np.zeros(len(self.platforms))])

    @cached_property
    def _rules(self) -> Rules:
        """The scalars of the kernels."""
        law = (self.wavelength, self.fft_length, self.pixels, self.out_of_view == "inflated", self.iterations)
        folds = (self.folding, self.duty, self.notch)
        return Rules(KINDS[self.penalty], self.nearest_range, self.margin, self.as_printed, *law, *folds)

    @cached_property
    def _weights(self) -> Array:
        return weighting_matrix(self.weights)

    @property
    def timings(self) -> dict[str, PulseTiming]:
        """A train at each PRF of the library. With folding a pulse lasts ``duty`` / PRF, otherwise 1/B."""
        lasts = self.folding and self.duty > 0.0
        return {
            f"{prf:.4g} Hz": PulseTiming(
                duration=self.duty / prf if lasts else 1.0 / self.bandwidth[1],
                carrier_hz=self.carrier_hz,
                interval=1.0 / prf,
                count=self.fft_length,
            )
            for prf in self.action_set.levels[0]
        }

    @property
    def duration_means(self) -> str:
        """See ``TimedPulses``."""
        if self.folding and self.duty > 0.0:
            return "A pulse lasts the share `duty` of the interval."
        return "A pulse lasts 1/B of the greatest bandwidth, the shortest that has it."


def ranges_of_moving_targets(system: Any, world: Any, platforms: ArrayLike) -> Array:
    """Ranges (m) and range-rates (m/s) of targets [x xdot y ydot], (env, target, step, platform, 2)."""
    truth, found = system.initial(world).truth, []
    for k in range(system.horizon + 1):
        found.append(range_and_rate(truth.targets[:, :, None, [0, 2, 1, 3]], np.array(platforms)))
        if k < system.horizon:
            truth = system.move(truth, np.full(len(truth.targets), k), world)
    return np.stack(found, axis=2)
