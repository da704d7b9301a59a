"""RF/EO platforms whose camera has to turn. A turn costs steps without azimuths."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from wavegym.core.action_sets import Library
from wavegym.core.arrays import Array, for_kernel
from wavegym.core.errors import check_ordered
from wavegym.core.parameters import Positive, changed_default, parameter, system_parameters
from wavegym.core.system import ObservationField, State
from wavegym.core.traits import TimedPulses
from wavegym.sensors.platform import KINDS, platform_measurement
from wavegym.systems.camera_slew import kernels
from wavegym.systems.camera_slew.kernels import Mount
from wavegym.systems.camera_slew.state import (
    Belief,
    Measurements,
    Truth,
    World,
    camera_fields,
    platform_belief,
)
from wavegym.systems.look_system import NN, LookSystem
from wavegym.systems.rf_eo.look_kernels import Rules
from wavegym.systems.rf_eo.scenario import (
    FARTHEST,
    FASTEST,
    GREATEST,
    Azimuth,
    Position,
    StateVariance,
    ranges_of_moving_targets,
)
from wavegym.systems.rf_eo.system import RfEo, platform_model
from wavegym.systems.visibility_windows import SOON, coming, visibility, window_draws
from wavegym.targets import MotionModel
from wavegym.trackers.polar_kernels import to_polar
from wavegym.trackers.protocol import Estimate, MeasurementModel, Scan
from wavegym.waveforms import PulseTiming

LONGEST = 10_000  # steps: the system keeps a transition matrix for each number of steps
CHANGING = Belief._fields[1:7]  # the fields that a step changes: two forms of the estimate, and the camera

Distance = Annotated[float, Field(gt=0, le=FARTHEST, allow_inf_nan=False)]


@system_parameters
class CameraSlew(LookSystem, TimedPulses):
    """A radar measures no azimuth; a camera sees one direction, needs time to turn, and is sometimes blocked.

    Description
        Targets and radar are those of wavegym/RfEo-v0. The radar stares: at every step it measures range and range-rate
        of every target, but no azimuth. The camera on the first platform measures the azimuths of the targets in its
        image.

        An action names the target to look at. The camera turns towards its predicted azimuth at up to ``slew`` rad/s.
        After a turn of more than half the field of view, the camera sees nothing until it has arrived and settled for
        ``settle`` steps. During smaller turns, which follow a target, it continues to see. The camera finds a target in
        the image with probability ``detection`` (haze, foliage, glare). In windows known in advance, clouds, smoke or
        tree lines block its line of sight to a target; the radar sees through them. The process noise density of each
        target is also known. There is one waveform: r |rdot| stays below c lambda / 8, so a single pulse repetition
        frequency measures both range and range-rate without ambiguity.

        Without the camera, the uncertainty of a target grows in cross-range, and its posterior bends along a circle
        about the radar. The tracker is a Kalman filter in polar coordinates about the first platform [r, rdot, azimuth,
        cross velocity], in which the measurements of this platform are linear. Sigma points carry the estimate through
        the motion. If a look does not find a target, the azimuths in the image become less likely. The belief holds the
        polar Gaussian and its exact Cartesian mean and covariance. A ``tracker`` of your own receives ranges,
        range-rates and directions. It does not learn from a look without a detection, because a scan contains only
        detections.

    Rewards
        -trace(Lambda P) summed over the targets, in m^2. Lambda is diag(weights). The weights of velocities are in s^2.

    Starting state
        Targets are uniform in azimuth (``sector``) and range (``ranges``) around the first platform. Their velocities
        in x and y are normal with standard deviation ``speed``. Process noise densities are log-uniform in ``q``. The
        estimates are drawn around the truth with covariance P0 = diag(prior_variance). The camera looks along +y and
        has settled.

    Episode end
        Terminates after ``horizon`` steps. The remaining time is observed.

    References
        S. M. O'Rourke and A. L. Swindlehurst, "Adaptive RF/EO sensing with field-of-view constraints": the platforms
        and their measurements. This suite adds the turning camera.
    """

    horizon: int = parameter(60, "steps in an episode", ge=1, le=LONGEST)
    q: tuple[Positive, Positive] = changed_default(LookSystem, "q", (0.02, 2.0))
    prior_variance: StateVariance = changed_default(LookSystem, "prior_variance", (100.0, 1.0, 100.0, 1.0))
    sector: tuple[Azimuth, Azimuth] = parameter(
        (-1.5, 1.5), "minimum and maximum azimuth of the targets' starts, clockwise from +y", unit="rad", truth=True
    )
    ranges: tuple[Distance, Distance] = parameter(
        (2e3, 5e3), "minimum and maximum range of the targets' starts", unit="m", truth=True
    )
    speed: float = parameter(
        5.0, "standard deviation of each velocity component at the start", unit="m/s", truth=True, ge=0
    )
    platforms: tuple[Position, ...] = parameter(
        ((0.0, 0.0),),
        "positions (x, y), each with a radar; the first carries the camera",
        unit="m",
    )
    half_field: float = parameter(
        0.15,
        "half the camera's field of view",
        unit="rad",
        gt=0,
        le=0.5 * math.pi,
    )
    slew: float = parameter(math.radians(30.0), "maximum turn rate of the camera", unit="rad/s", gt=0, le=FASTEST)
    settle: int = parameter(3, "steps to settle, focus and search the image after a large turn", ge=0, le=1000)
    detection: float = parameter(0.7, "probability that a target in the image is found", truth=True, ge=0, le=1)
    pixels: int = parameter(1000, "pixels across the image", truth=True, ge=1, le=1_000_000)
    carrier_hz: float = parameter(10e9, "carrier frequency fc", unit="Hz", gt=0, le=1e15)
    prf: float = parameter(10e3, "pulse repetition frequency", unit="Hz", gt=0, le=0.5 * GREATEST)
    bandwidth: float = parameter(2e6, "bandwidth B", unit="Hz", truth=True, gt=0, le=GREATEST)
    fft_length: int = parameter(128, "Nfft, pulses integrated", truth=True, ge=1, le=1_000_000)
    iterations: int = parameter(10, "maximum iterations of an update; a single platform needs none", ge=1, le=1_000_000)
    nearest_range: float = parameter(
        1.0, "a platform does not measure targets nearer than this", unit="m", truth=True, gt=0, le=FARTHEST
    )

    def __post_init__(self) -> None:
        """Check several fields together."""
        super().__post_init__()
        for name in ("sector", "ranges"):
            check_ordered(name, *getattr(self, name))
        self.loop  # noqa: B018  (invalid platforms are reported here)

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        """One draw for each target: whether the camera finds it."""
        return (self.targets,)

    @property
    def lost_beyond(self) -> float:
        """Half the width of the image in the middle of ``ranges``, m: farther off, a look at the estimate misses."""
        return self.half_field * 0.5 * sum(self.ranges)

    @cached_property
    def loop(self) -> RfEo:
        """The RF/EO system of these platforms, with one setting and a noise density of 1.

        It supplies the motion model, the geometry and a part of the observation.
        """
        angle = 2.0 * self.half_field / self.pixels
        return RfEo(
            horizon=self.horizon, dt=self.dt, q=1.0, turn_rate=self.turn_rate, carrier_hz=self.carrier_hz,
            fft_length=self.fft_length, pixels=self.pixels, platforms=self.platforms,
            starts=((0.0, 0.0, self.ranges[1], 0.0),) * self.targets, prior_variance=self.prior_variance,
            prf=(self.prf, 1.001 * self.prf), bandwidth=(0.5 * self.bandwidth, self.bandwidth),
            pixel_angle=(angle, 2.0 * angle), penalty="hard",
            iterations=self.iterations, weights=self.weights, nearest_range=self.nearest_range,
        )  # fmt: skip

    @property
    def motion(self) -> MotionModel:
        """The motion model that the tracker assumes, at a density of 1; ``truth_model.motion`` is that of the world."""
        return self.loop.motion

    @cached_property
    def actions(self) -> Library:
        """The target to look at."""
        return Library(tuple(f"look at target {t + 1}" for t in range(self.targets)))

    @cached_property
    def _mount(self) -> Mount:
        return Mount(self.half_field, self.slew * self.dt, self.settle, self.detection)

    @cached_property
    def _rules(self) -> Rules:
        """The scalars of the RF/EO kernels, without penalties."""
        law = (self.loop.wavelength, self.fft_length, self.pixels, False, self.iterations)
        return Rules(KINDS["hard"], self.nearest_range, 0.0, False, *law)

    @cached_property
    def _scene(self) -> tuple[Any, ...]:
        """Kernel arguments: model, platforms, scalars, camera, and field of view."""
        F, Q = self.motion.F[None].copy(), self.motion.Q[None].copy()
        return F, Q, self.loop.places, self._rules, self._mount, self._view

    @cached_property
    def _view(self) -> tuple[Array, Array, Array]:
        """Variance, low and high of every platform's quantities, (platform, 3). Azimuths are out of view."""
        one = self.loop.action_set.view(np.array([self.prf, self.bandwidth, 2.0 * self.half_field / self.pixels]))
        variance, low, high = (np.tile(part, (len(self.platforms), 1)) for part in one)
        low[:, kernels.AZIMUTH] = np.inf
        return variance, low, high

    @cached_property
    def _powers(self) -> tuple[Array, Array]:
        """Transition and noise of 1, 2, ..., ``horizon`` steps, (H, 4, 4) each."""
        F, Q = self.motion.F, self.motion.Q
        transitions, noises = [F], [Q]
        for _ in range(self.horizon - 1):
            transitions.append(F @ transitions[-1])
            noises.append(F @ noises[-1] @ F.T + Q)
        return np.stack(transitions), np.stack(noises)

    @cached_property
    def _earlier_noise(self) -> Array:
        """F^-1 Q F'^-1: the noise of one step, referred to the state before it."""
        back = np.linalg.inv(self.motion.F)
        return back @ self.motion.Q @ back.T

    @property
    def timings(self) -> dict[str, PulseTiming]:
        """The radars' train. A pulse lasts 1/B."""
        train = PulseTiming(
            duration=1.0 / self.bandwidth, carrier_hz=self.carrier_hz, interval=1.0 / self.prf, count=self.fft_length
        )
        return {f"{self.prf:.4g} Hz": train}

    @property
    def duration_means(self) -> str:
        """See ``TimedPulses``."""
        return self.loop.duration_means

    def target_ranges(self, world: World) -> Array:
        """Range and range-rate of every target at every platform, (env, target, step, platform, 2)."""
        return ranges_of_moving_targets(self, world, self.platforms)

    def draw_world(self, rng: np.random.Generator) -> World:
        """All draws of one episode."""
        T, J, H = self.targets, len(self.platforms), self.horizon
        place = rng.random((T, 2))
        normal = (rng.standard_normal(shape) for shape in ((T, 2), (T, 4), (H, T, 4), (H, J, T, 3)))
        velocity, start, process, error = normal
        density, window = rng.random(T), rng.random((T, window_draws(H, self.shown, self.hidden)))
        return World(place, velocity, start, process, error, density, window, rng.random((H, T)))

    def _starts(self, world: World) -> Array:
        """First states of the targets, (env, target, 4)."""
        azimuth = self.sector[0] + (self.sector[1] - self.sector[0]) * world.place[..., 0]
        r = self.ranges[0] + (self.ranges[1] - self.ranges[0]) * world.place[..., 1]
        x, y = self.platforms[0]
        vx, vy = self.speed * world.velocity[..., 0], self.speed * world.velocity[..., 1]
        return np.stack([x + r * np.sin(azimuth), vx, y + r * np.cos(azimuth), vy], axis=-1)

    def _first_state(self, world: World, targets: Array, window: Array | None, first: Estimate) -> State:
        """The state at step 0: the camera looks along +y, has settled and has found no target yet."""
        step, none = np.zeros(len(targets), np.int64), np.zeros(targets.shape[:2], np.int64)
        densities = self.truth_model._densities(world), self._densities(world)
        mean, covariance = first[:2]
        p, S = to_polar(mean, covariance, self.loop.places[0])
        visible = visibility(self, world.window, self.targets)
        return State(
            Truth(targets, none, none.copy(), none.astype(np.bool_), densities[0], window),
            Belief(step, mean, covariance, p, S, np.zeros(len(step)), step.copy(), densities[1], visible),
        )

    @cached_property
    def _true_motion(self) -> tuple[Array, Array]:
        """Kernel arguments: transition matrix (1, 4, 4) and noise factor (4, 4) of the world, at a density of 1."""
        motion = self.truth_model.motion
        return motion.F[None].copy(), motion.noise_factor

    @cached_property
    def _world(self) -> tuple[Any, ...]:
        """Kernel arguments: the world's scalars, camera, and field of view."""
        model = self.truth_model
        return model._rules, model._mount, model._view

    def _empty(self, shape: tuple[int, ...]) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Arrays for means, covariances, polar means and covariances (*shape, target, ...), and the camera's state."""
        mean, covariance = (*shape, self.targets, 4), (*shape, self.targets, 4, 4)
        cartesian, polar = ((np.empty(mean), np.empty(covariance)) for _ in range(2))
        return *cartesian, *polar, np.empty(shape), np.empty(shape, np.int64)

    def _moved(self, targets: Array, q: Array, step: Array, world: World) -> Array:
        moved = np.empty(targets.shape)
        kernels.move(step, targets, q, world.process, *self._true_motion, moved, NN)
        return moved

    def measure(self, truth: Truth, belief: Belief, action: Array, world: World) -> Measurements:
        """The measurements of radars and camera, after the camera has turned towards the target ``action``."""
        z = np.empty((*truth.unseen.shape, 3 * len(self.platforms)))
        variance = np.empty(z.shape)
        F, _, *scene = self._scene
        kernels.sense(
            belief.step, belief.mean, belief.pointing, belief.settling, belief.visible, truth.targets, world.error,
            world.found, action, self._world, F, *scene, z, variance, NN
        )  # fmt: skip
        return Measurements(z, variance)

    def _filtered(self, belief: Belief, action: Array, measurements: Measurements) -> Belief:
        """One step of the polar filter; the camera turns."""
        fresh = self._empty(belief.step.shape)
        *scene, _ = self._scene
        kernels.track(*belief[:9], action, *measurements, *scene, *fresh, NN)
        return Belief(belief.step + 1, *fresh, *belief[7:])

    def _scans(self, belief: Belief, after: Belief, action: Array, measurements: Measurements) -> list[Scan]:
        """Range and range-rate of every platform, and the direction of the targets that the camera found.

        The direction is a unit vector, because an azimuth jumps by 2 pi.
        """
        (z, variance), places = measurements, self.loop.places
        present = np.isfinite(variance)
        R = np.where(present, variance, 1.0)[..., None, None]
        target = np.broadcast_to(np.arange(self.targets), present.shape[:2])
        scans = [
            Scan(z[..., a, None], present[..., a], target, R[:, :, a], platform_model(places[a // 3], [a % 3]))
            for a in range(z.shape[2])
            if a % 3 != kernels.AZIMUTH
        ]
        azimuth = after.pointing[:, None] + z[..., kernels.AZIMUTH]
        seen = np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
        found, R = present[..., kernels.AZIMUTH], R[:, :, kernels.AZIMUTH] * np.eye(2)
        return [*scans, Scan(seen, found, target, R, _direction(places[0]))]

    def _with_estimate(self, belief: Belief, estimate: Estimate) -> Belief:
        polar = to_polar(estimate.mean, estimate.covariance, self.loop.places[0])
        return belief._replace(**estimate._asdict(), polar_mean=polar[0], polar_covariance=polar[1])

    def annotate(self, truth: Truth, measurements: Measurements) -> Truth:
        """The truth with the number of quantities received, and whether the camera found each target."""
        received = np.isfinite(measurements.variance)
        seen = received[..., kernels.AZIMUTH].copy()
        unseen = np.where(seen, 0, truth.unseen + 1)
        return Truth(truth.targets, received.sum(axis=2), unseen, seen, truth.q, truth.window)

    def _ahead(self, belief: Belief, actions: Array, draws: Array | None) -> dict[str, Array]:
        """The predicted fields. With draws, the camera finds a target in view if its draw is below ``detection``."""
        fresh = self._empty((len(belief.step), actions.shape[1]))
        given = np.empty((1, 1, self.targets)) if draws is None else draws
        kernels.predict(
            *self._expected(belief)[:9], for_kernel(actions), given, draws is not None, *self._scene, *fresh, NN
        )  # fmt: skip
        return dict(zip(CHANGING, fresh, strict=True))

    def _turns(self, belief: Belief) -> tuple[Array, Array]:
        """``delay``, and the azimuth of each target one step ahead relative to the camera's pointing (rad)."""
        delay, off = np.empty(belief.mean.shape[:2], np.int64), np.empty(belief.mean.shape[:2])
        F, _, places, _, mount, _ = self._scene
        kernels.delay(
            belief.step, belief.mean, belief.pointing, belief.settling, belief.visible, F, places, mount,
            delay, off, NN
        )  # fmt: skip
        return delay, off

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation: that of the RF/EO system, time left, the camera, and the target of each look."""
        return (*self.loop.observation_fields, *camera_fields(self.targets))

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``."""
        belief = self._expected(belief)
        delay, off = self._turns(belief)
        now, changes, _ = coming(belief.visible, belief.step, SOON)
        platforms = self.loop.observe(platform_belief(belief, self._earlier_noise, len(self.platforms)))
        out, first = np.empty((len(off), len(self.observation_fields))), platforms.shape[1]
        out[:, :first], out[:, first], out[:, first + 1] = platforms, 1.0 - belief.step / self.horizon, belief.settling
        for i, values in enumerate((off, delay, delay == 0, now, changes, np.log10(belief.q)), first + 2):
            out[:, i::6] = values
        return out

    def state_info(self, state: State) -> dict[str, Array]:
        """Figures of each target and of the camera.

        For each target: ``position_error`` (m), ``position_variance`` (m^2), ``nees`` (expected: 4), ``received``
        (number of quantities measured in this step) and ``found`` (by the camera in this step). For the camera:
        ``pointing`` (rad) and ``settling`` (remaining steps).
        """
        truth, belief = state
        return {
            **self._errors(state),
            "received": truth.received.copy(),
            "found": truth.seen.copy(),
            "pointing": belief.pointing.copy(),
            "settling": belief.settling.copy(),
        }


def _direction(platform: Array) -> MeasurementModel:
    """The unit vector from a platform to the target."""

    def jacobian(states: Array) -> Array:
        r, _, azimuth = np.moveaxis(platform_measurement(states, platform), -1, 0)
        across = np.stack([np.cos(azimuth), -np.sin(azimuth)], axis=-1)
        H = np.zeros((*states.shape[:-1], 2, 4))
        H[..., ::2] = across[..., :, None] * across[..., None, :] / r[..., None, None]
        return H

    def measure(states: Array) -> Array:
        azimuth = platform_measurement(states, platform)[..., 2]
        return np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)

    return MeasurementModel(measure, jacobian)
