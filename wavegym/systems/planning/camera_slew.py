"""RF/EO platforms whose camera has to turn: looking elsewhere costs steps without sight."""

from __future__ import annotations

import math
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from wavegym.errors import whole
from wavegym.sensors.penalties import KINDS
from wavegym.systems.choices import Menu
from wavegym.systems.contract import Element, State, System
from wavegym.systems.costs import trace_cost
from wavegym.systems.horizon import horizon_weights
from wavegym.systems.planning import camera_slew_kernels as kernels
from wavegym.systems.planning.camera_slew_kernels import Mount
from wavegym.systems.planning.camera_slew_state import Hidden, Public, World, camera_elements, check_camera
from wavegym.systems.rf_eo import NN, RfEo
from wavegym.systems.rf_eo_kernels import Rules, measure
from wavegym.systems.rf_eo_state import Pair, Quad
from wavegym.systems.rf_eo_state import Public as Belief
from wavegym.targets import MotionModel

Array = NDArray[Any]

LOST_AFTER = 60  # steps in which the camera has not found a target


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class CameraSlew(System):
    """Two radars see all targets coarsely; one camera sees one direction finely, and has to turn.

    Description
        The targets, radars and tracker are those of wavegym/RfEo-v0. Both platforms' radars stare: at every step they
        measure range and range-rate of every target that is in their field of view, but no azimuth. The camera
        on the first platform measures azimuths, of what is in its image. An action names the target to look at: the
        camera turns towards its predicted azimuth at ``slew`` rad/s at most. A turn of more than half the field of
        view blinds it until it has arrived and then settled for ``settle`` steps; smaller ones, to follow a target, do
        not. Of what is in the image each target is found with the probability ``detection`` (cloud, foliage, glare).
        There is one waveform: r |rdot| stays below c lambda / 8, so one pulse repetition frequency sees both range and
        range-rate without ambiguity, and no other would be chosen.

    Rewards
        -trace(W P) summed over the targets, W = diag(weights): m^2, with 1 s^2 on the velocities.

    Starting state
        Targets uniform in azimuth and range over the region in front of the first platform, with velocities drawn with
        the standard deviation ``speed`` in x and in y. The estimates are drawn around the truth with covariance P0 =
        diag(prior_variance). The camera looks along +y, settled.

    Episode end
        Terminated after ``horizon`` steps; the time left is observed.

    Arguments
        q: process noise density (m^2/s^3). targets: how many. sector: least and greatest azimuth of their starts (rad,
        clockwise from +y). ranges: least and greatest range of their starts (m). speed: standard deviation of each
        velocity component (m/s). prior_variance: diagonal of P0. platforms: positions (x, y) in metres; the first
        carries the camera. half_field: half the camera's field of view (rad). slew: the fastest it turns (rad/s).
        settle: steps to settle after a turn. detection: probability that a target in the image is found. pixels:
        across the image. carrier_hz: fc. prf: pulse repetition frequency (Hz). bandwidth: B (Hz). fft_length: Nfft,
        pulses integrated. iterations: at most so many per update; 1 is the plain extended filter. weights: diagonal of
        W. nearest_range: a platform nearer to a target than this gets nothing of it.

    References
        S. M. O'Rourke and A. L. Swindlehurst, "Adaptive RF/EO sensing with field-of-view constraints": the platforms
        and what they measure. The turning camera is ours.
    """

    horizon: int = 300
    dt: float = 1.0
    q: float = 0.05
    targets: int = 4
    sector: Pair = (-1.5, 1.5)
    ranges: Pair = (2e3, 5e3)
    speed: float = 5.0
    prior_variance: Quad = (100.0, 4.0, 100.0, 4.0)
    platforms: tuple[Pair, ...] = ((-1e3, 0.0), (1e3, 0.0))
    half_field: float = 0.05
    slew: float = math.radians(10.0)
    settle: int = 1
    detection: float = 0.8
    pixels: int = 1000
    carrier_hz: float = 10e9
    prf: float = 10e3
    bandwidth: float = 20e6
    fft_length: int = 128
    iterations: int = 10
    weights: Quad = (1.0, 1.0, 1.0, 1.0)
    nearest_range: float = 1.0

    def __post_init__(self) -> None:
        """Check what single types cannot say."""
        check_camera(self)
        self.loop  # noqa: B018  (what makes no platforms is reported here)

    @property
    def chances(self) -> tuple[int, ...]:
        """One draw a target: whether the camera finds it."""
        return (self.targets,)

    @cached_property
    def loop(self) -> RfEo:
        """The platforms as the parent has them, at one setting: the model, the geometry and what is observed of it."""
        angle = 2.0 * self.half_field / self.pixels
        return RfEo(
            horizon=self.horizon, dt=self.dt, q=self.q, carrier_hz=self.carrier_hz, fft_length=self.fft_length,
            pixels=self.pixels, platforms=self.platforms, starts=((0.0, 0.0, self.ranges[1], 0.0),) * self.targets,
            prior_variance=self.prior_variance, prf=(self.prf, 2.0 * self.prf),
            bandwidth=(0.5 * self.bandwidth, self.bandwidth), pixel_angle=(angle, 2.0 * angle), penalty="hard",
            iterations=self.iterations, weights=self.weights, nearest_range=self.nearest_range,
        )  # fmt: skip

    @property
    def motion(self) -> MotionModel:
        """The targets' motion model, shared by the world and the tracker."""
        return self.loop.motion

    @property
    def transition(self) -> Array:
        """F, (4, 4)."""
        return self.motion.F

    @cached_property
    def actions(self) -> Menu:
        """The target that the camera is to look at."""
        return Menu(tuple(f"look at target {t + 1}" for t in range(self.targets)))

    @cached_property
    def _mount(self) -> Mount:
        return Mount(self.half_field, self.slew * self.dt, self.settle, self.detection)

    @cached_property
    def _scene(self) -> tuple[Any, ...]:
        """Kernel arguments: model, platforms, and the parent's scalars; nothing is penalised."""
        law = (self.loop.wavelength, self.fft_length, self.pixels, False, self.iterations)
        rules = Rules(KINDS["hard"], self.nearest_range, 0.0, False, *law)
        return self.motion.F[None].copy(), self.motion.Q[None].copy(), self.loop.places, rules

    @cached_property
    def _view(self) -> tuple[Array, Array, Array]:
        """Variance, low and high of every platform's quantities, (platform, 3): no azimuth is in view by itself."""
        one = self.loop.menu.view(np.array([self.prf, self.bandwidth, 2.0 * self.half_field / self.pixels]))
        variance, low, high = (np.tile(part, (len(self.platforms), 1)) for part in one)
        low[:, kernels.AZIMUTH] = np.inf
        return variance, low, high

    @cached_property
    def _powers(self) -> tuple[Array, Array]:
        """Transition and noise of 1, 2, ... steps, (horizon, 4, 4) each."""
        F, Q = self.motion.F, self.motion.Q
        powers, noises = [F], [Q]
        for _ in range(self.horizon - 1):
            powers.append(F @ powers[-1])
            noises.append(F @ noises[-1] @ F.T + Q)
        return np.stack(powers), np.stack(noises)

    def draw_world(self, rng: np.random.Generator) -> World:
        """All draws of one episode."""
        T, J, H = self.targets, len(self.platforms), self.horizon
        place = rng.random((T, 2))
        velocity, start, process, error = (
            rng.standard_normal(shape) for shape in ((T, 2), (T, 4), (H, T, 4), (H, J, T, 3))
        )
        return World(place, velocity, start, process, error, rng.random((H, T)))

    def begin(self, world: World) -> State:
        """Targets where the tape has them in the region, and the first estimates."""
        count, T = world.start.shape[:2]
        azimuth = self.sector[0] + (self.sector[1] - self.sector[0]) * world.place[..., 0]
        r = self.ranges[0] + (self.ranges[1] - self.ranges[0]) * world.place[..., 1]
        x, y = self.platforms[0]
        vx, vy = self.speed * world.velocity[..., 0], self.speed * world.velocity[..., 1]
        truth = np.stack([x + r * np.sin(azimuth), vx, y + r * np.cos(azimuth), vy], axis=-1)
        mean = truth + np.sqrt(self.prior_variance) * world.start
        covariance = np.tile(np.diag(self.prior_variance), (count, T, 1, 1))
        nothing = np.zeros((count, T), np.int64)
        step = np.zeros(count, np.int64)
        hidden = Hidden(truth, nothing, nothing.copy(), np.zeros((count, T), np.bool_))
        return State(hidden, Public(step, mean, covariance, np.zeros(count), step.copy()))

    def advance(self, state: State, action: Array, world: World) -> State:
        """One step: move, turn the camera, measure what is in view, track."""
        hidden, (step, mean, covariance, pointing, settling) = state
        count, T = hidden.unseen.shape
        x, P, moved = np.empty(mean.shape), np.empty(covariance.shape), np.empty(mean.shape)
        after, left, seen = np.empty(count), np.empty(count, np.int64), np.empty((count, T), np.bool_)
        received, unseen = np.empty((count, T), np.int64), np.empty((count, T), np.int64)
        F, Q, places, rules = self._scene
        kernels.advance(
            step, mean, covariance, pointing, settling, hidden.truth, hidden.unseen, world.process, world.error,
            world.found, action, F, Q, self.motion.noise_factor, places, rules, self._mount, *self._view,
            x, P, after, left, moved, received, unseen, seen, NN
        )  # fmt: skip
        return State(Hidden(moved, received, unseen, seen), Public(step + 1, x, P, after, left))

    def imagine(self, public: Public, actions: Array, outcome: Array | None = None) -> Public:
        """The belief one step ahead: predicted means, and covariances after what is in view where it is predicted.

        Args:
            public: the belief.
            actions: (env,) or (env or 1, candidate).
            outcome: None for the mean of the covariance over detections, or uniform draws (env[, candidate], target): a
                target in the image is found where its draw is below ``detection``.
        """
        several = actions.ndim == 2
        actions = actions if several else actions[:, None]
        count, T = public.mean.shape[:2]
        shape = (count, actions.shape[1])
        draws = np.empty((1, 1, T)) if outcome is None else outcome.reshape(count, -1, T)
        x, P = np.empty((*shape, T, 4)), np.empty((*shape, T, 4, 4))
        after, left = np.empty(shape), np.empty(shape, np.int64)
        F, Q, places, rules = self._scene
        kernels.imagine(
            public.mean, public.covariance, public.pointing, public.settling, actions, draws, outcome is not None, F,
            Q, places, rules, self._mount, *self._view, x, P, after, left, NN
        )  # fmt: skip
        step = np.broadcast_to(public.step[:, None] + 1, shape)
        told = Public(step, x, P, after, left)
        return told if several else Public(*(part[:, 0] for part in told))

    def _turns(self, public: Public) -> tuple[Array, Array]:
        """``delay``, and the azimuth of each target one step ahead, from where the camera points (rad)."""
        delay, off = np.empty(public.mean.shape[:2], np.int64), np.empty(public.mean.shape[:2])
        F, _, places, _ = self._scene
        kernels.delay(public.mean, public.pointing, public.settling, F, places, self._mount, delay, off, NN)
        return delay, off

    def delay(self, public: Public) -> Array:
        """Steps without sight before the camera sees each target, turning to it from now on, (env, candidate) int."""
        return self._turns(public)[0]

    def gain(self, public: Public, wait: Array | int, ahead: int) -> Array:
        """By how much a look at each target after ``wait`` steps lowers the summed cost of the ``ahead`` from it on.

        Of all targets that will be in the image then, each with the probability of being found. What the radars measure
        before the look counts as if they measured it all with the look: without, whatever is far away would seem worth
        more than it is. What they measure after it is left out of account.

        Args:
            public: the belief.
            wait: steps before the look, (env, candidate) or a number.
            ahead: steps, the look's own included; fewer at the episode's end.

        Returns:
            (env, candidate), 0 where the look would come after the end.
        """
        out = np.empty(public.mean.shape[:2])
        waits = np.ascontiguousarray(np.broadcast_to(np.asarray(wait, np.int64), out.shape))
        _, _, places, rules = self._scene
        kernels.gain(
            public.step, self.horizon, public.mean, public.covariance, waits, *self._powers, _worth(self, ahead),
            places, rules, self._mount, *self._view, out, NN
        )  # fmt: skip
        return out

    def cost(self, public: Public) -> Array:
        """trace(W P) summed over the targets."""
        return trace_cost(public.covariance, np.array(self.weights))

    @cached_property
    def elements(self) -> tuple[Element, ...]:
        """The observation: the parent's, time left, the camera, and of every target what it takes to look at it."""
        return (*self.loop.elements, *camera_elements(self.targets))

    def observe(self, public: Public) -> Array:
        """See ``elements``."""
        delay, off = self._turns(public)
        camera = np.stack([off, delay, delay == 0], axis=-1).reshape(len(delay), -1)
        parents = self.loop.observe(Belief(public.step, public.mean, public.covariance))
        left = 1.0 - public.step / self.horizon
        return np.concatenate([parents, left[:, None], public.settling[:, None], camera], axis=1)

    def metrics(self, state: State) -> dict[str, Array]:
        """Of each target ``position_error`` (m), ``nees`` (expected: 4), ``received`` (quantities measured in this
        step), ``found`` (the camera found it in this step) and ``lost``: not found for more than sixty steps; and
        ``pointing`` (rad) and ``settling`` (steps) of the camera.
        """
        hidden, public = state
        position, nees = np.empty(hidden.unseen.shape), np.empty(hidden.unseen.shape)
        measure(public.mean, public.covariance, hidden.truth, position, nees, NN)
        return {
            "position_error": position,
            "nees": nees,
            "received": hidden.received.copy(),
            "found": hidden.seen.copy(),
            "lost": hidden.unseen > LOST_AFTER,
            "pointing": public.pointing.copy(),
            "settling": public.settling.copy(),
        }


@lru_cache(maxsize=64)
def _worth(system: CameraSlew, ahead: int) -> Array:
    """Weights M of 1, 2, ... steps, (ahead, 4, 4)."""
    every = range(1, whole("ahead", ahead, 1) + 1)
    return np.stack([horizon_weights(system.transition, system.weights, steps) for steps in every])
