"""The waveform scheduling loop of Kershaw & Evans (1994): one target, one line of sight, Gaussian chirps.

The paper leaves carrier, library and scenario open; the values here are proposals (docs/errata.md).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from wavegym.core.action_sets import Library, ParameterBox
from wavegym.core.arrays import Array, for_kernel
from wavegym.core.covariances import check_precision, trace_cost
from wavegym.core.errors import InputError, check_ordered, check_positive
from wavegym.core.parameters import Interval, NonNegative, Positive, changed_default, parameter, system_parameters
from wavegym.core.system import ObservationField, State, System
from wavegym.core.traits import RecordedTargets, TimedPulses
from wavegym.sensors import range_law_snr
from wavegym.systems.kershaw_evans import kernels
from wavegym.systems.kershaw_evans.actions import GaussianActions
from wavegym.systems.kershaw_evans.state import (
    Belief,
    Measurements,
    PathSource,
    RandomPath,
    RecordedRange,
    ScriptedRange,
    Truth,
    World,
    covariance_fields,
)
from wavegym.systems.recorded_targets import (
    farthest_range_parameter,
    radar_parameter,
    smoothing_parameter,
    tracks_parameter,
)
from wavegym.targets import (
    MotionModel,
    Segment,
    Windows,
    constant_acceleration,
    constant_velocity,
)
from wavegym.targets.recorded_paths import recorded_paths
from wavegym.trackers import predict_covariance, update_covariance
from wavegym.trackers.imm import ImmKalman
from wavegym.trackers.protocol import Estimate, MeasurementModel, Scan, Tracker, begin_track, given_tracker, track
from wavegym.waveforms import PulseTiming, check_time_on_target, pulse_timings
from wavegym.waveforms.timing import ENERGY

DURATIONS = tuple(float(k) for k in np.geomspace(10e-6, 300e-6, 8))
SWEEPS = (0.0, 0.1e6, -0.1e6, 0.3e6, -0.3e6, 1e6, -1e6, 5e6, -5e6, 15e6, -15e6)
MEASURED = 2  # range and range-rate
TRACKERS = "kalman", "imm"
# All systems share an action set: the covariances of its chirps take 10 ms. Do not write to its arrays.
_shared_actions = lru_cache(maxsize=64)(GaussianActions)


@system_parameters
class KershawEvans(System, RecordedTargets, TimedPulses):
    """A Kalman filter tracks one target on the line of sight; the radar chooses a Gaussian chirp at every step.

    Description
        The state is range and range-rate, x = [r, rdot] (m, m/s; ``model="ca"`` adds rddot). It moves as x_{k+1} = F
        x_k + w with white-noise acceleration of power spectral density q (m^2/s^3). A pulse of duration k and chirp
        rate g measures range and range-rate with covariance R = C(k, g) / eta. C is the inverse Fisher information at
        unit SNR, and eta = (r0 / r)^4 at the *true* range, because the receiver measures its SNR. The tracker assumes
        the system's r0, even if ``truth`` changes that of the world.

        Every pulse detects. Long pulses measure range-rate, short pulses range, and a chirp couples the two errors; det
        R is the same for all. One pulse is sent in each step. The receiver is off during transmission (``eclipsing``):
        an echo that arrives earlier loses its first part and the information in it. The targets are 165 to 205 km away,
        beyond the blind range of the longest pulse, so every pulse of the library can be used.

    Rewards
        -trace(Lambda P) with Lambda = diag(weights). P is in m^2 and m^2/s^2, so a weight on range-rate has the unit
        s^2 (default 1 and 1 s^2).

    Starting state
        Range, range-rate (and acceleration) are uniform in ``start_range``, ``start_speed``, ``start_acceleration``.
        The first estimate is drawn around the truth with covariance P0. ``start_covariance="steady"``: P0 is the fixed
        point of the Riccati recursion for the middle duration with the widest sweep at the middle of ``start_range``.
        With a wide P0 the first step would carry nearly the whole episode's cost. ``"random"``: P0 =
        diag(prior_variance) times 10^U(-1, 1), one draw per entry.

    Episode end
        Terminates after ``horizon`` steps. The remaining time is observed.

    References
        D. J. Kershaw and R. J. Evans, "Optimal waveform selection for tracking systems", IEEE Transactions on
        Information Theory 40(5), 1536-1550, 1994.
    """

    horizon: int = parameter(50, "steps in an episode", ge=1, le=100_000)
    dt: float = parameter(1.0, "time step", unit="s", gt=0)
    carrier_hz: float = parameter(10.4e9, "carrier frequency fc", unit="Hz", gt=0)
    eclipsing: bool = parameter(
        True,
        f"the receiver is off while the radar transmits {100 * ENERGY:g} % of a pulse's energy",
        unit="",
    )
    reference_range: float = parameter(310e3, "r0, the range at which eta = 1", unit="m", truth=True, gt=0)
    nearest_range: float = parameter(100.0, "below this range the SNR stays constant", unit="m", truth=True, gt=0)
    model: Literal["cv", "ca"] = parameter("cv", "constant velocity or constant acceleration", unit="")
    q: float = parameter(1.0, "process noise density (ca: m^2/s^5)", unit="m^2/s^3", truth=True, ge=0)
    weights: tuple[NonNegative, ...] = parameter((1.0, 1.0), "diagonal of Lambda", unit="1, s^2")
    durations: tuple[Positive, ...] = parameter(DURATIONS, "durations k of the library", unit="s", min_length=1)
    sweeps: tuple[float, ...] = parameter(
        SWEEPS,
        "sweeps of the library, negative = down; the chirp rate is g = pi |sweep| / (2 k)",
        unit="Hz",
        min_length=1,
    )
    action: Literal["library", "box"] = parameter(
        "library", "an index, or a point of a box: log duration, and the signed sweep that sets the chirp rate", unit=""
    )
    library: Library | None = parameter(
        None, "a Library of your own waveforms; replaces ``durations`` and ``sweeps``", unit=""
    )
    tracker: Any = parameter(
        None,
        "``kalman``; ``imm``: interacting multiple models, a Kalman filter for each of ``densities``; a Tracker of "
        "``wavegym.trackers.protocol``, or ``package.module:name`` of its factory. By default ``kalman`` with "
        "targets='random', which move as the filter assumes, and ``imm`` with targets='scripted' or 'recorded'",
        unit="",
    )
    densities: tuple[NonNegative, ...] = parameter(
        (0.01, 1.0, 100.0), "process noise densities with tracker='imm' (ca: m^2/s^5)", unit="m^2/s^3", min_length=1
    )
    start_range: Interval = parameter((175e3, 195e3), "bounds of the first range", unit="m", truth=True)
    start_speed: Interval = parameter((-200.0, 200.0), "bounds of the first range-rate", unit="m/s", truth=True)
    start_acceleration: Interval = parameter(
        (-5.0, 5.0), "bounds of the first acceleration (ca)", unit="m/s^2", truth=True
    )
    start_covariance: Literal["steady", "random"] = parameter("steady", "P0; see Starting state", unit="")
    prior_variance: tuple[Positive, ...] = parameter(
        (1e4, 1e4), "diagonal of P0 where start_covariance is random", unit="m^2, m^2/s^2", truth=True
    )
    targets: Literal["random", "scripted", "recorded"] = parameter(
        "random",
        "paths drawn from the motion model, ``script`` after a drawn start, or windows of ``tracks``",
        unit="",
        truth=True,
    )
    script: tuple[tuple[float, float], ...] = parameter(
        ((15.0, 0.0), (10.0, 10.0), (10.0, -10.0)), "segments: duration and acceleration", unit="s, m/s^2", truth=True
    )
    tracks: Path | None = tracks_parameter()
    radar: tuple[float, ...] | None = radar_parameter()
    farthest_range: float = farthest_range_parameter(210e3)
    smoothing: float | None = smoothing_parameter()

    nees_dimension = 2  # range and range-rate

    def __post_init__(self) -> None:
        """Check several fields together."""
        check_positive("lower bound of start_range", self.start_range[0], "m")
        n = 3 if self.model == "ca" else 2
        for name in ("weights", "prior_variance"):
            values = getattr(self, name)
            if len(values) != n:
                raise InputError(f"{name} is {values}, expected {n} numbers for model={self.model!r}")
        check_positive("sum of weights", sum(self.weights))
        for name in ("start_range", "start_speed", "start_acceleration"):
            check_ordered(name, *getattr(self, name))
        if self.library is not None and self.action == "box":
            raise InputError(
                "library is given with action='box', expected action='library': a box spans Gaussian chirps"
            )
        self._given_tracker  # noqa: B018  (an invalid tracker is reported here)
        self.action_set.covariances, self.actions  # noqa: B018  (an invalid pulse is reported here)
        check_time_on_target(self.timings, self.dt)
        self._check_precision()
        self._paths  # noqa: B018  (an invalid recording is reported here)

    def _check_precision(self) -> None:
        """InputError for pulses too fine for the filter; see ``check_precision``."""
        widest = np.diag(self.prior_variance) * (10.0 if self.start_covariance == "random" else 1.0)
        P = predict_covariance(widest, self.motion.F, self.motion.Q)[:MEASURED, :MEASURED]
        eta = range_law_snr(np.mean(self.start_range), self.reference_range, self.nearest_range)
        check_precision(P, self.action_set.covariances, eta, self.reference_range)

    @cached_property
    def motion(self) -> MotionModel:
        """The target's motion model, of the filter; ``truth_model.motion`` is the world's."""
        return self._motion_with(self.q)

    def _motion_with(self, q: float) -> MotionModel:
        return (constant_acceleration if self.model == "ca" else constant_velocity)(self.dt, q)

    @cached_property
    def _given_tracker(self) -> Tracker | None:
        """The tracker; None for the compiled Kalman filter."""
        tracker = self.tracker
        if tracker is None:
            tracker = "kalman" if self.targets == "random" else "imm"
        if tracker == "imm":
            return ImmKalman(tuple(self._motion_with(q) for q in self.densities))
        return given_tracker(tracker, TRACKERS)

    @cached_property
    def action_set(self) -> GaussianActions:
        """What may be transmitted."""
        chirps = (self.durations, self.sweeps, self.carrier_hz, self.action == "box", self.eclipsing)
        # A user's pulses may have no hash.
        return GaussianActions(*chirps, self.library) if self.library else _shared_actions(*chirps)

    @property
    def actions(self) -> Library | ParameterBox:
        """The library, or the box that it spans."""
        return self.action_set.actions

    @property
    def timings(self) -> dict[str, PulseTiming]:
        """One pulse in a step: nothing folds."""
        return pulse_timings(self.action_set.library, self.carrier_hz)

    def target_ranges(self, world: World) -> Array:
        """The paths, (env, H + 1, 2)."""
        return self.initial(world).truth.path[..., :MEASURED]

    def candidates(self) -> Array:
        """The pulses of the library: indices (A,), or their points of the box (A, 2)."""
        return self.action_set.candidates.copy()

    @cached_property
    def unit_covariance(self) -> Callable[[Array], Array]:
        """The function from actions to C, the measurement covariance at unit SNR, (..., 2, 2)."""
        return self.action_set.unit_covariance

    @cached_property
    def steady_covariance(self) -> Array:
        """Fixed point of the covariance recursion, (n, n), with the middle pulse at the middle of the start range."""
        middle = np.full(1, np.mean(self.start_range))
        C = self.action_set.received_covariance(self.candidates()[None], middle)[0, self.action_set.middle]
        R = C / range_law_snr(middle[0], self.reference_range, self.nearest_range)
        P = np.diag(self.prior_variance).astype(np.float64)
        for _ in range(500):
            before = P
            for _ in range(2):  # rounding may end in a cycle of two
                P = update_covariance(predict_covariance(P, self.motion.F, self.motion.Q), self._model[2][0], R)
            if np.array_equal(P, before):
                break
        return P

    @cached_property
    def _paths(self) -> PathSource:
        """The source of true paths that ``targets`` names."""
        if self.targets == "recorded":
            if self.tracks is None:
                raise InputError("targets='recorded' needs a recording, expected tracks='FILE.csv'")
            limits = (self.nearest_range, self.farthest_range)
            seen = (self.tracks, self.motion.names, self.dt, self.horizon, self.radar, self.smoothing, limits)
            return RecordedRange(recorded_paths(*seen))
        for name in ("tracks", "radar"):
            if getattr(self, name) is not None:
                given = f"{name} is {getattr(self, name)!s} with targets={self.targets!r}"
                raise InputError(f"{given}, expected it with targets='recorded' only")
        low, high = np.array([self.start_range, self.start_speed, self.start_acceleration])[: len(self.weights)].T
        if self.targets == "random":
            return RandomPath(self.motion, low, high - low)
        segments = tuple(Segment(seconds, acceleration=(a,)) for seconds, a in self.script)
        return ScriptedRange(low, high - low, segments, self.dt * np.arange(self.horizon + 1))

    @property
    def recorded_windows(self) -> Windows | None:
        """The windows of ``tracks`` that are played; None without a recording."""
        return self._paths.recorded.catalogue if isinstance(self._paths, RecordedRange) else None

    @cached_property
    def _model(self) -> tuple[Array, Array, Array]:
        """F, Q and the measurement matrix with the leading axis the kernels want."""
        n = len(self.weights)
        return self.motion.F[None].copy(), self.motion.Q[None].copy(), np.eye(MEASURED, n)[None]

    @cached_property
    def _snr_law(self) -> tuple[float, float]:
        """The range at which eta = 1, and the range below which the SNR grows no further."""
        return self.reference_range, self.nearest_range

    @cached_property
    def _law(self) -> tuple[Any, ...]:
        """Kernel arguments: range law, and n as a tuple."""
        return *self._snr_law, (0,) * len(self.weights)

    @cached_property
    def _assumed(self) -> tuple[Any, ...]:
        """Kernel arguments: the model, range law, and the two sizes as tuples."""
        return *self._model, *self._law, (0,) * MEASURED

    def _radar(self, belief: Belief) -> tuple[Any, ...]:
        """``_assumed``, with the tracker's process noise."""
        if belief.process_noise is None:
            return self._assumed
        F, _, *others = self._assumed
        Q = for_kernel(belief.process_noise)
        return F.repeat(len(Q), axis=0), Q, *others

    def draw_world(self, rng: np.random.Generator) -> World:
        """All draws of one episode."""
        n = len(self.weights)
        return World(rng.random((2, n)), rng.standard_normal((self.horizon + 1, n + MEASURED)))

    def initial(self, world: World) -> State:
        """The true path, and the first estimate drawn around its start."""
        n = len(self.weights)
        path = self.truth_model._paths(world.uniform[:, 0], world.normal[:, 1:, :n].copy())
        true_spread = np.linalg.cholesky(self.truth_model.first_covariance(world))
        mean = path[:, 0] + (true_spread * world.normal[:, :1, :n]).sum(axis=2)
        belief = Belief(np.zeros(len(path), dtype=np.int64), mean, self.first_covariance(world))
        if self._given_tracker:
            belief = _believed(belief.step, begin_track(self._given_tracker, _estimate(belief), self.motion))
        return State(Truth(path[:, 0].copy(), path), belief)

    def first_covariance(self, world: World) -> Array:
        """P0 of each world, (env, n, n)."""
        if self.start_covariance == "steady":
            return np.repeat(self.steady_covariance[None], len(world.uniform), axis=0)
        variance = np.asarray(self.prior_variance) * np.power(10.0, 2.0 * world.uniform[:, 1] - 1.0)
        return variance[:, :, None] * np.eye(len(self.weights))

    def move(self, truth: Truth, step: Array, world: World) -> Truth:
        """The target one step along its path."""
        return truth._replace(targets=truth.path[np.arange(len(step)), step + 1])

    def measure(self, truth: Truth, belief: Belief, action: Array, world: World) -> Measurements:
        """Range and range-rate with an error of covariance C / eta at the true range."""
        C, z = self._covariance_from(action, truth.targets[:, 0]), np.empty((len(belief.step), MEASURED))
        kernels.receive(truth.targets, belief.step, world.normal, C, *self.truth_model._snr_law, z)
        eta = range_law_snr(abs(truth.targets[:, 0]), *self._snr_law)
        return Measurements(z, C * (1.0 / eta)[:, None, None])

    def track(self, belief: Belief, action: Array, measurements: Measurements) -> Belief:
        """One step of the tracker."""
        if self._given_tracker:
            return self._tracked(self._given_tracker, belief, measurements)
        x, P = np.empty(belief.mean.shape), np.empty(belief.covariance.shape)
        sizes = (0,) * len(self.weights), (0,) * MEASURED
        kernels.track(belief.mean, belief.covariance, *measurements, *self._model, *sizes, x, P)
        return Belief(belief.step + 1, x, P)

    def _tracked(self, tracker: Tracker, belief: Belief, measurements: Measurements) -> Belief:
        """``track`` by the given tracker."""
        count = len(belief.step)
        z, R = (array[:, None] for array in measurements)
        is_detected, target = np.ones((count, 1), np.bool_), np.zeros((count, 1), np.int64)
        scan = Scan(z, is_detected, target, R, LINE_OF_SIGHT)
        return _believed(belief.step + 1, track(tracker, _estimate(belief), self.motion, scan))

    def predict(self, belief: Belief, actions: Array, outcome: None = None) -> Belief:
        """The belief after one pulse: predicted mean, updated covariance with eta at the predicted range.

        The tracker's process noise does not change.
        """
        several = actions.ndim == (2 if self.action == "library" else 3)
        C = self._predicted_covariance(belief, actions if several else actions[:, None])
        x, P = kernels.predict(belief.mean, belief.covariance, C, *self._radar(belief))
        step, Q = (belief.step + 1)[:, None].repeat(x.shape[1], axis=1), belief.process_noise
        if not several:
            return Belief(step[:, 0], x[:, 0], P[:, 0], process_noise=Q)
        return Belief(step, x, P, process_noise=None if Q is None else Q[:, None].repeat(x.shape[1], axis=1))

    def _covariance_from(self, action: Array, ranges: Array) -> Array:
        """C (env, 2, 2) of the pulses of actions (env,) or (env, 2) as received from ranges (env,)."""
        return self.action_set.received_covariance(action[:, None], ranges)[:, 0]

    def _predicted_covariance(self, belief: Belief, actions: Array) -> Array:
        """C (env or 1, candidate, 2, 2) of actions (env or 1, candidate) as received from the predicted range."""
        return self.action_set.received_covariance(actions, self._ranges_ahead(belief, 1)[:, 0])

    def _ranges_ahead(self, belief: Belief, steps: int) -> Array:
        """Ranges predicted 1 ... ``steps`` steps ahead, (env, steps)."""
        F, *_, n, _ = self._radar(belief)
        return kernels.ranges_ahead(belief.mean, F, steps, n)

    def cost(self, belief: Belief) -> Array:
        """trace(Lambda P)."""
        return trace_cost(belief.covariance[..., None, :, :], self._weights)

    @cached_property
    def _weights(self) -> Array:
        return np.array(self.weights)

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation: SNR, range-rate, log deviations, correlations, time left."""
        return (
            ObservationField("snr", "dB", 10.0, 6.0, "eta at the estimated range"),
            ObservationField("rdot", "m/s", 0.0, 150.0, "estimated range-rate, receding positive"),
            *covariance_fields(self.motion.names),
            ObservationField("time_left", "1", 0.5, 0.3, "fraction of the horizon still to come"),
        )

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``."""
        out = np.empty((len(belief.step), len(self.observation_fields)))
        kernels.observe(belief.mean, belief.covariance, belief.step, self.horizon, *self._law, out)
        return out

    def state_info(self, state: State) -> dict[str, Array]:
        """``position_error`` (m) and ``velocity_error`` (m/s), absolute; ``nees`` of both (expected: 2);
        ``position_variance`` (m^2).
        """
        out = np.empty((4, len(state.belief.step)))
        kernels.track_errors(state.belief.mean, state.belief.covariance, state.truth.targets, out)
        return {"position_error": out[0], "position_variance": out[1], "velocity_error": out[2], "nees": out[3]}


def _measured(states: Array) -> Array:
    """Range and range-rate are the first two elements of a state."""
    return np.array(states[..., :MEASURED])


def _jacobian(states: Array) -> Array:
    return np.broadcast_to(np.eye(MEASURED, states.shape[-1]), (*states.shape[:-1], MEASURED, states.shape[-1]))


LINE_OF_SIGHT = MeasurementModel(_measured, _jacobian)


def _estimate(belief: Belief) -> Estimate:
    """The belief as a tracker takes it, with an axis for the target."""
    Q = belief.process_noise
    return Estimate(belief.mean[:, None], belief.covariance[:, None], belief.memory, None if Q is None else Q[:, None])


def _believed(step: Array, estimate: Estimate) -> Belief:
    """The belief of one target."""
    mean, covariance, memory, Q = estimate
    return Belief(step, mean[:, 0], covariance[:, 0], memory, None if Q is None else Q[:, 0])


@system_parameters
class KershawEvansPosition(KershawEvans):
    """Kershaw & Evans's loop with a manoeuvring target; only the position error counts.

    Description
        As wavegym/KershawEvans-v0 with a position-only cost, q = 100 m^2/s^3 and sweeps up to 1 MHz. A long pulse
        measures range-rate, which gains nothing now and much one step later. The best schedule therefore costs about 14
        % less than the one-step scheduler. The gain of foresight depends on q: nothing at q = 1, 5 % at q = 10. All
        recorded targets manoeuvre less than q = 100.

    Rewards
        -trace(Lambda P) with Lambda = diag(1, 0): minus the variance of range in m^2.

    Starting state
        Range (``start_range``) is uniform from 170 to 195 km and range-rate (``start_speed``) from 0 to 300 m/s
        outbound. With ``model="ca"`` ``start_acceleration`` is uniform too. The first estimate is drawn around the
        truth with covariance diag(1e4 m^2, 1e4 m^2/s^2) (``prior_variance``), each entry times 10^U(-1, 1)
        (``start_covariance="random"``).
    """

    q: float = changed_default(KershawEvans, "q", 100.0)
    weights: tuple[NonNegative, ...] = changed_default(KershawEvans, "weights", (1.0, 0.0))
    sweeps: tuple[float, ...] = changed_default(KershawEvans, "sweeps", SWEEPS[:7])
    reference_range: float = changed_default(KershawEvans, "reference_range", 455e3)
    start_range: Interval = changed_default(KershawEvans, "start_range", (170e3, 195e3))
    start_speed: Interval = changed_default(KershawEvans, "start_speed", (0.0, 300.0))
    start_covariance: Literal["steady", "random"] = changed_default(KershawEvans, "start_covariance", "random")
