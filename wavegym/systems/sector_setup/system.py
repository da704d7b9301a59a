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
from wavegym.sensors.multipath_kernels import SightTable
from wavegym.sensors.multistatic import multistatic_range_and_rate, range_and_rate, range_and_rate_jacobian
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

PLANE = [0, 2, 1, 3]  # [x xdot y ydot] as [x y xdot ydot], and back
Coordinate = Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False)]  # m
Point = tuple[Coordinate, Coordinate]


@system_parameters
class SectorSetup(LookSystem):
    """One illuminator serves several targets; changing the target costs steps without sensing.

    Description
        The state of each target is [x xdot y ydot] (m, m/s). It moves as x_{k+1} = F x_k + w_k with white acceleration;
        its density q differs between targets. Each step illuminates one target with one waveform. An action with a new
        target starts a set-up: no pulse is sent for ``dead_steps`` steps. Another change of target starts a new set-up.
        A set-up never lowers the cost of the next step. It can lower the cost summed over a window of visibility.

        Each receiver measures the bistatic range (half the path length) and its rate. eta = 2E/N0 is proportional to
        1 / (Rt^2 Rr^2), and error variances to 1 / eta. Receivers detect independently with probability
        Pd = Pf^(1 / (1 + eta / 2)). The world uses eta at the true position, tracker and schedulers at the predicted
        position. A waveform is defined only by its error variances, so it has no timing. The receivers have their own
        antennas and listen while the illuminator transmits.

        Targets drive behind buildings on a map, so they are hidden at times known in advance. Targets are far apart, so
        the association is known and there are no false returns. An extended Kalman filter uses the detections. If the
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
    waveforms: tuple[tuple[Positive, Positive], ...] = parameter(
        ((12.0, 20.0), (60.0, 1.0)),
        "standard deviations of range and range-rate of each waveform at the reference SNR",
        unit="m, m/s",
        min_length=1,
        max_length=64,
    )
    reference_snr: float = parameter(20.0, "eta at the reference range, a ratio", truth=True, gt=0)
    reference_range: float = parameter(5.65e3, "Rt = Rr at which eta is reference_snr", unit="m", truth=True, gt=0)
    nearest_range: float = parameter(500.0, "the SNR uses at least this Rt and Rr", unit="m", truth=True, gt=0)
    false_alarm: float = parameter(1e-3, "false alarm probability Pf", truth=True, gt=0, lt=1)
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
        for axis, bounds in zip("xy", self.region, strict=True):
            check_ordered(f"{axis} of region", *bounds)
        check_ordered("speed", *self.speed)
        if len(set(self.waveforms)) < len(self.waveforms):
            raise InputError(f"waveforms is {self.waveforms}, expected each waveform once")

    @cached_property
    def motion(self) -> MotionModel:
        """The motion model at a process noise density of 1; the density of each target multiplies Q."""
        return constant_turn(self.dt, 1.0, self.turn_rate)

    @cached_property
    def actions(self) -> Library:
        """Every target with every waveform; the waveform varies fastest."""
        waves = [f"{r:g} m, {v:g} m/s" for r, v in self.waveforms]
        return Library(tuple(f"target {t}, {wave}" for t in range(1, self.targets + 1) for wave in waves))

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        """One draw for each receiver, because a step illuminates one target."""
        return (len(self.receivers),)

    @cached_property
    def _radar(self) -> kernels.Radar:
        """Constants of the kernels as the tracker assumes them; ``truth_model._radar`` has the world's."""
        accuracy = self.reference_snr * np.square(np.array(self.waveforms))
        sites, strength = np.array([self.illuminator, *self.receivers]), self.reference_snr * self.reference_range**4
        return kernels.Radar(
            sites, accuracy, strength, self.nearest_range, math.log(self.false_alarm), self.dt, self.turn_rate,
            self.dead_steps, self.iterations, *self._hiding
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
            rng.random((H, receivers, T)),
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
            belief.step, belief.pointed, belief.dead, truth.targets, truth.visible, *self._split(action),
            world.detection, world.error, self.truth_model._radar, *report, NN
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
        """One scan of each receiver, of the illuminated target, with the predicted SNR."""
        (target, waveform), radar = self._split(action), self._radar
        ahead = (belief.mean[np.arange(len(target)), target, None] * self.motion.F).sum(axis=-1)
        legs = range_and_rate(ahead[:, None, PLANE], radar.sites)[..., 0]
        squared = np.square(np.maximum(legs, radar.nearest))
        variance = radar.accuracy[waveform, None] * (squared[:, :1] * squared[:, 1:] / radar.strength)[..., None]
        R, (z, detected, _) = variance[..., None] * np.eye(2), measurements
        return [
            Scan(z[:, j, None], detected[:, j, None], target[:, None], R[:, j, None], _bistatic(radar.sites[0], site))
            for j, site in enumerate(radar.sites[1:])
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
