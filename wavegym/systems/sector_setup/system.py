"""One illuminator for several targets: changing the target takes time without measurements."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from wavegym.core.action_sets import Library
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_ordered, check_within
from wavegym.core.parameters import NonNegative, Positive, parameter, system_parameters
from wavegym.core.system import ObservationField, State
from wavegym.core.traits import TimedPulses
from wavegym.sensors.detection import Fluctuation, echo_law
from wavegym.sensors.multipath_kernels import SightTable
from wavegym.sensors.multistatic import multistatic_range_and_rate, range_and_rate_jacobian
from wavegym.sensors.trains import KNEE, MEAN_RATE, check_threshold
from wavegym.systems.look_system import NN, LookSystem
from wavegym.systems.sector_setup import kernels
from wavegym.systems.sector_setup import prediction_kernels as prediction
from wavegym.systems.sector_setup.state import (
    Belief,
    Measurements,
    Truth,
    World,
    sector_fields,
)
from wavegym.systems.visibility_windows import SOON, Window, visibility, window_draws
from wavegym.targets import MotionModel, constant_turn
from wavegym.trackers.protocol import Estimate, MeasurementModel, Scan
from wavegym.waveforms import (
    GaussianChirp,
    PulseTiming,
    PulseTrain,
    check_range_folds,
    check_time_on_target,
    check_velocity_folds,
    chirp_rate_for_sweep,
    measurement_covariances,
    pulse_timings,
)

PLANE = [0, 2, 1, 3]  # [x xdot y ydot] as [x y xdot ydot], and back
Coordinate = Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False)]  # m
Point = tuple[Coordinate, Coordinate]
Train = tuple[Annotated[int, Field(ge=1, le=100_000)], Positive, Positive, NonNegative]
SEARCHED = 2  # delay and Doppler


@system_parameters
class SectorSetup(LookSystem, TimedPulses):
    """One illuminator serves several targets; changing the target costs steps without sensing.

    Description
        The state of each target is [x xdot y ydot] (m, m/s). It moves as x_{k+1} = F x_k + w_k with white acceleration;
        its density q differs between targets. Each step illuminates one target with one coherent train of pulses. An
        action with a new target starts a set-up: no pulse is sent for ``dead_steps`` steps. Another change of target
        starts a new set-up. A set-up never lowers the cost of the next step. It can lower the cost summed over a window
        of visibility.

        Each receiver measures the bistatic range (half the path length) and its rate. The mean eta = 2E/N0 of a train
        is proportional to its energy and to 1 / (Rt^2 Rr^2). The echo fluctuates (``fluctuation``) independently at the
        receivers. Its realised SNR decides the detection and is the SNR of the errors. The covariance of range and
        range-rate at unit SNR is that of the train (``wavegym.waveforms``). Tracker and schedulers take eta at the
        predicted position, Pd at the mean eta, and the mean covariance of a detected echo.

        A target that accelerates loses energy over a train, and the train measures the mean range-rate over its
        duration (``wavegym.sensors.trains``). With the default trains the loss is below 0.1 dB. Peak power is the same
        for all trains. The two default trains have the same energy. The first measures ranges better, the second
        range-rates. A train with the bandwidth of the first and the duration of the second would measure both; the
        suite omits it to keep the choice.

        Range and range-rate fold at the interval of the pulses. The prediction resolves the fold. Targets are far
        apart, so the association is known and there are no false returns. At the
        default Pf, noise has about 0.0005 peaks a look in gates of four standard deviations (0.001 in the city). The
        receivers have their own antennas and listen while the illuminator transmits.

        Targets drive behind buildings on a map, so they are hidden at times known in advance. An extended Kalman filter
        uses the detections. If the
        measurements are curved over the spread of the prediction, posterior linearisation iterates the update. A
        ``tracker`` of your own receives one scan of each receiver.

    Rewards
        -trace(Lambda P) summed over the targets, in m^2. Lambda is diag(weights). The weights of velocities are in s^2.

    Starting state
        True targets start uniformly in the region with any heading. The first estimate is drawn around the truth with
        covariance P0 = diag(prior_variance). The illuminator is set up for no target.

    Episode end
        Terminates after ``horizon`` steps. The remaining time is observed.

    References
        S. P. Sira, A. Papandreou-Suppappola, D. Morrell and D. Cochran, "Waveform-agile sensing for tracking multiple
        targets in clutter" (SNR and detection). A. F. Garcia-Fernandez et al., "Posterior linearization filter:
        principles and implementation using sigma points", 2015 (the iteration). This suite adds the set-up time.
    """

    dead_steps: int = parameter(3, "steps without sensing that a set-up takes", ge=0, le=100_000)
    illuminator: Point = parameter((0.0, 0.0), "position (x, y) of the illuminator", unit="m")
    receivers: tuple[Point, ...] = parameter(
        ((-4e3, 3e3), (4e3, 3e3)), "positions (x, y) of the receivers", unit="m", min_length=1, max_length=6
    )
    region: tuple[Point, Point] = parameter(
        ((-2e3, 2e3), (2.5e3, 5e3)), "bounds of the first x, and of the first y", unit="m", truth=True
    )
    speed: tuple[NonNegative, float] = parameter((5.0, 20.0), "bounds of the first speed", unit="m/s", truth=True)
    carrier_hz: float = parameter(3e9, "carrier frequency fc", unit="Hz", gt=0)
    waveforms: tuple[Train, ...] = parameter(
        ((2, 250e-6, 15e-6, 1.25e6), (24, 250e-6, 1.25e-6, 0.0)),
        "trains of up-chirps: number of pulses, interval, duration k of a Gaussian pulse, frequency swept in 2 k",
        unit="1, s, s, Hz",
        min_length=1,
        max_length=64,
    )
    reference_snr: float = parameter(
        20.0, "mean eta at the reference range of the train with the most energy, a ratio", truth=True, gt=0
    )
    fluctuation: Fluctuation = parameter(
        "swerling1", "law of the echo's fluctuation from look to look", unit="", truth=True
    )
    reference_range: float = parameter(5.65e3, "Rt = Rr at which eta is reference_snr", unit="m", truth=True, gt=0)
    nearest_range: float = parameter(500.0, "the SNR uses at least this Rt and Rr", unit="m", truth=True, gt=0)
    false_alarm: float = parameter(1e-5, "false alarm probability Pf of a resolution cell", truth=True, gt=0, lt=1)
    windows: tuple[Window, ...] = parameter(
        (),
        "(target, first step, last step) in which a target is hidden; () draws the windows",
        unit="",
        truth=True,
    )
    iterations: int = parameter(
        10, "maximum iterations of an update; 1: the extended Kalman filter", ge=1, le=1_000_000
    )
    lost_beyond: ClassVar[float] = 300.0  # m: half the width of a sector of 0.15 rad in the middle of region

    def __post_init__(self) -> None:
        """Check several fields together."""
        super().__post_init__()
        check_within("nearest_range", self.nearest_range, 0, self.reference_range, "m")
        check_threshold(self.false_alarm)
        for axis, bounds in zip("xy", self.region, strict=True):
            check_ordered(f"{axis} of region", *bounds)
        check_ordered("speed", *self.speed)
        if len(set(self.waveforms)) < len(self.waveforms):
            raise InputError(f"waveforms is {self.waveforms}, expected each waveform once")
        check_time_on_target(self.timings, self.dt)
        check_range_folds(self.timings, self._farthest())
        check_velocity_folds(self.timings, self.speed[1])

    def _farthest(self) -> float:
        """Half the greatest path over a corner of the region, m; targets may drive further."""
        x, y = self.region
        corners = np.array([[a, b, 0.0, 0.0] for a in x for b in y])
        return float(max(self._half_paths(corners)[..., 0].max(), 0.0))

    def _half_paths(self, states: Array) -> Array:
        """Half the path to each receiver, m, and its rate, m/s, of states [x y xdot ydot]: (..., receiver, 2)."""
        where = np.array(self.illuminator)
        each = [multistatic_range_and_rate(states, where, np.array(receiver)) for receiver in self.receivers]
        return np.stack(each, axis=-2)

    @cached_property
    def motion(self) -> MotionModel:
        """The motion model at a process noise density of 1; the density of each target multiplies Q."""
        return constant_turn(self.dt, 1.0, self.turn_rate)

    @cached_property
    def actions(self) -> Library:
        """Every target with every waveform; the waveform varies fastest."""
        trains = self.library.labels
        return Library(tuple(f"target {t}, {train}" for t in range(1, self.targets + 1) for train in trains))

    @cached_property
    def library(self) -> Library:
        """The trains of ``waveforms``."""
        trains = []
        for count, interval, duration, sweep in self.waveforms:
            pulse = GaussianChirp(duration=duration, chirp_rate=float(chirp_rate_for_sweep(sweep, duration)))
            trains.append(PulseTrain(pulse, count=count, interval=interval))
        return Library(tuple(trains))

    bistatic = True

    @cached_property
    def timings(self) -> dict[str, PulseTiming]:
        """See ``TimedPulses``."""
        return pulse_timings(self.library, self.carrier_hz)

    def target_ranges(self, world: World) -> Array:
        """Half the path to each receiver, and its rate, of every target and step, (env, H, target, receiver, 2)."""
        real = self.truth_model
        if real._recorded:
            truth, states = self.initial(world).truth, []
            for k in range(self.horizon):
                truth = self.move(truth, np.full(len(truth.targets), k), world)
                states.append(truth.targets)
            return self._half_paths(np.stack(states, axis=1)[..., PLANE])
        return self._half_paths(real._driven(world, real._starts(world))[..., PLANE])

    def _driven(self, world: World, true_states: Array) -> Array:
        """True states at the end of each step, (env, H, target, 4).

        No action moves a target, so its whole path is fixed when the world is drawn.
        """
        states = np.empty((len(true_states), self.horizon, *true_states.shape[1:]))
        here, q, step = true_states, self._densities(world), np.zeros(len(true_states), np.int64)
        for k in range(self.horizon):
            states[:, k] = here = self._moved(here, q, step + k, world)
        return states

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        """One draw for each receiver, because a step illuminates one target."""
        return (len(self.receivers),)

    @cached_property
    def _radar(self) -> kernels.Radar:
        """Constants of the kernels as the tracker assumes them; ``truth_model._radar`` has the world's."""
        C = measurement_covariances(self.library, self.carrier_hz)
        coupling = C[:, 0, 1] / C[:, 0, 0]
        accuracy = np.stack([C[:, 0, 0], C[:, 1, 1] - coupling * C[:, 0, 1]], axis=1)
        count, _, duration, _ = np.array(self.waveforms).T
        energy = count * duration / (count * duration).max()
        seconds = np.array([timing.time_on_target(0.0) for timing in self.timings.values()])
        wave = next(iter(self.timings.values())).wavelength
        sites, strength = np.array([self.illuminator, *self.receivers]), self.reference_snr * self.reference_range**4
        return kernels.Radar(
            sites, accuracy, coupling, energy, np.square(4.0 * math.pi / wave) * seconds**3 / KNEE, MEAN_RATE * seconds,
            echo_law((self.false_alarm,), self.fluctuation, SEARCHED), strength, self.nearest_range, self.dt,
            self.turn_rate, self.dead_steps, self.iterations, *self._hiding
        )  # fmt: skip

    @cached_property
    def _hiding(self) -> tuple[SightTable, Array, Array]:
        """Sight table, places and few places of the kernels; the table is empty if the times are known."""
        return SightTable(0.0, 0.0, 1.0, np.empty((0, 1), np.bool_)), np.empty((0, 2)), np.empty((0, 2))

    def draw_world(self, rng: np.random.Generator) -> World:
        """All draws of one episode."""
        T, H, receivers = self.targets, self.horizon, len(self.receivers)
        return World(
            rng.random((T, 4)),
            rng.random(T),
            rng.random((T, window_draws(H, self.shown, self.hidden))),
            rng.standard_normal((T, 4)),
            rng.standard_normal((H, T, 4)),
            np.asarray(rng.integers(2**64, dtype=np.uint64)),
            rng.standard_normal((H, receivers, T, 2)),
        )

    def _first_state(self, world: World, targets: Array, window: Array | None, first: Estimate) -> State:
        """The state at step 0: the illuminator is set up for no target and has sent no pulse."""
        zero, real = np.zeros(len(targets), np.int64), self.truth_model
        visible = real._visible(world, targets)
        known = self._known(world, targets, visible)
        return State(
            Truth(targets, real._densities(world), visible, zero.copy(), zero.astype(np.bool_), window),
            Belief(zero, *first[:2], zero - 1, zero.copy(), self._densities(world), known, zero.copy()),
        )

    def _starts(self, world: World) -> Array:
        """First states of the targets, (env, target, 4): uniform in the region, with any heading."""
        low, high = np.array([*self.region, self.speed, (-math.pi, math.pi)]).T
        x, y, speed, heading = np.moveaxis(low + (high - low) * world.place, -1, 0)
        return np.stack([x, speed * np.sin(heading), y, speed * np.cos(heading)], axis=-1)

    def _visible(self, world: World, true_states: Array) -> Array:
        """Whether targets that start at ``true_states`` are visible in each step, bool (env, H, target)."""
        return visibility(self, world.window, true_states.shape[1])

    def _known(self, world: World, true_states: Array, visible: Array) -> Array:
        """Visibility as the belief holds it, bool (env, H, target); ``visible``: the true visibility."""
        return visible if self.truth_model is self else self._visible(world, true_states)

    def _split(self, actions: Array) -> tuple[Array, Array]:
        """Target and waveform of each action."""
        return np.divmod(np.asarray(actions, np.int64), len(self.waveforms))

    def _moved(self, targets: Array, q: Array, step: Array, world: World) -> Array:
        after = np.empty(targets.shape)
        kernels.move(step, targets, q, world.process, self.motion.noise_factor, self.truth_model._radar, after, NN)
        return after

    def measure(self, truth: Truth, belief: Belief, action: Array, world: World) -> Measurements:
        """Each receiver's measurement of the illuminated target, with SNR, Pd and errors at its true position."""
        report = self._report(belief)
        kernels.measure(
            belief.step, belief.pointed, belief.dead, *truth[:3], *self._split(action), world.key, world.error,
            self.truth_model._radar, *report, NN
        )  # fmt: skip
        return self._measurements(*report)

    def _filtered(self, belief: Belief, action: Array, measurements: Measurements) -> Belief:
        """A set-up step or a look, and one step of the extended Kalman filter with the predicted SNR."""
        z, detected, _ = measurements
        fresh = self._fresh(belief)
        kernels.track(
            *belief[1:6], belief.looked, *self._split(action), z.reshape(len(z), -1), detected, self._radar, *fresh, NN
        )  # fmt: skip
        return self._following(belief, *fresh)

    def _scans(self, belief: Belief, after: Belief, action: Array, measurements: Measurements) -> list[Scan]:
        """One scan of each receiver, of the illuminated target, with the effective SNR at the prediction."""
        (target, waveform), (z, detected, _), sites = self._split(action), measurements, self._radar.sites
        rows = np.arange(len(target))
        ahead = (belief.mean[rows, target, None] * self.motion.F).sum(axis=-1)
        R = np.empty((*detected.shape, 2, 2))
        kernels.assume(ahead[:, None], waveform, belief.q[rows, target], self._radar, R, NN)
        return [
            Scan(z[:, j, None], detected[:, j, None], target[:, None], R[:, j, None], _bistatic(sites[0], site))
            for j, site in enumerate(sites[1:])
        ]

    def annotate(self, truth: Truth, measurements: Measurements) -> Truth:
        """The truth with the number of detections, and whether no pulse was sent."""
        return truth._replace(detections=measurements.detected.sum(axis=1), silent=measurements.silent)

    def _report(self, belief: Belief) -> tuple[Array, Array, Array]:
        """Empty measurements (env, quantity), detections (env, receiver) and silence (env,)."""
        count, receivers = len(belief.step), len(self.receivers)
        return np.empty((count, 2 * receivers)), np.empty((count, receivers), np.bool_), np.empty(count, np.bool_)

    def _measurements(self, z: Array, detected: Array, silent: Array) -> Measurements:
        return Measurements(z.reshape(*detected.shape, 2), detected, silent)

    def _fresh(self, belief: Belief) -> tuple[Array, ...]:
        """Empty means, covariances, targets set up, dead steps and results of looks."""
        changing = (belief.mean, belief.covariance, belief.pointed, belief.dead, belief.looked)
        return tuple(np.empty_like(a) for a in changing)

    def _following(self, belief: Belief, mean: Array, covariance: Array, *settings: Array) -> Belief:
        """The belief one step later."""
        changed = dict(zip(("pointed", "dead", "looked"), settings, strict=True))
        return belief._replace(step=belief.step + 1, mean=mean, covariance=covariance, **changed)

    def _ahead(self, belief: Belief, actions: Array, draws: Array | None) -> dict[str, Array]:
        """The predicted fields, with the predicted SNR; with draws, a receiver detects if its draw is below Pd."""
        shape = len(belief.step), actions.shape[1]
        x, P = (np.empty((*shape, *a.shape[1:])) for a in (belief.mean, belief.covariance))
        pointed, dead, looked = np.empty((3, *shape), np.int64)
        prediction.predict(
            *self._expected(belief)[:8], *self._split(actions), np.empty((shape[0], 1, 0)) if draws is None else draws,
            self._radar, x, P, pointed, dead, looked, NN
        )  # fmt: skip
        return {"mean": x, "covariance": P, "pointed": pointed, "dead": dead, "looked": looked}

    @cached_property
    def _target_and_waveform(self) -> tuple[Array, Array]:
        """Target and waveform of each candidate."""
        return self._split(self.candidates())

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation: time left, set-up, and for each target its visibility, uncertainty and SNR."""
        return sector_fields(self.targets, len(self.receivers), self.dead_steps)

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``."""
        out = np.empty((len(belief.step), len(self.observation_fields)))
        prediction.observe(*self._expected(belief)[:8], self._radar, SOON, out, NN)
        logs = np.log10(out, out=out, where=self._logarithms > 0.0)
        return np.multiply(logs, self._logarithms, out=out, where=self._logarithms > 0.0)

    @cached_property
    def _logarithms(self) -> Array:
        """Factor of the logarithm of each field; 0: no logarithm; 0.5: a deviation, computed as a variance."""
        factors = {"log10_sigma": 0.5, "log10_q": 1.0, "snr": 10.0}
        return np.array(
            [next((f for n, f in factors.items() if e.name.startswith(n)), 0.0) for e in self.observation_fields]
        )

    def state_info(self, state: State) -> dict[str, Array]:
        """Figures of each target and of the step.

        For each target: ``position_error`` (m), ``position_variance`` (m^2) and ``nees`` (expected: 4). For the step:
        ``detections`` (number of receivers that detected the target) and ``dead`` (no pulse was sent).
        """
        truth = state.truth
        return {**self._errors(state), "detections": truth.detections.copy(), "dead": truth.silent.copy()}


def _bistatic(transmitter: Array, receiver: Array) -> MeasurementModel:
    """Half the path from the transmitter over the target to the receiver, and its rate."""

    def jacobian(states: Array) -> Array:
        there, back = (range_and_rate_jacobian(states[..., PLANE], site) for site in (transmitter, receiver))
        return 0.5 * (there + back)[..., PLANE]

    return MeasurementModel(lambda x: multistatic_range_and_rate(x[..., PLANE], transmitter, receiver), jacobian)
