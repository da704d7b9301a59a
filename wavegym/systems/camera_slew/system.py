"""RF/EO platforms whose camera has to turn: looking elsewhere costs steps without sight."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from wavegym.core.action_sets import Library
from wavegym.core.arrays import Array
from wavegym.core.costs import trace_cost
from wavegym.core.system import ObservationField, State, System
from wavegym.sensors.penalties import KINDS
from wavegym.systems.camera_slew import kernels
from wavegym.systems.camera_slew import state as parts
from wavegym.systems.camera_slew.kernels import Mount
from wavegym.systems.camera_slew.state import Belief, Truth, World
from wavegym.systems.rf_eo.kernels import Rules
from wavegym.systems.rf_eo.state import Pair, Quad
from wavegym.systems.rf_eo.system import NN, RfEo
from wavegym.systems.visibility_windows import Window, visibility, window_draws
from wavegym.targets import MotionModel


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class CameraSlew(System):
    """A radar sees all targets but no azimuth; a camera sees one direction, has to turn, and is blocked at times.

    Description
        Targets and tracker are those of wavegym/RfEo-v0. The radar stares: at every step it measures range and
        range-rate of every target, but no azimuth. The camera on the first platform measures azimuths, of what is in
        its image. An action names the target to look at: the camera turns towards its predicted azimuth at ``slew``
        rad/s at most. A turn of more than half the field of view blinds it until it has arrived and then settled for
        ``settle`` steps; smaller ones, to follow a target, do not. A target in the image is found with the probability
        ``detection`` (haze, foliage, glare). At times known from the beginning cover blocks the line of sight to it:
        clouds, smoke and tree lines, which the radar sees through; their places and drift are on the map and forecast.
        How much each target manoeuvres is known too. One waveform: r |rdot| stays below c lambda / 8, so one pulse
        repetition frequency sees both range and range-rate without ambiguity, and no other would be chosen.

    Rewards
        -trace(W P) summed over the targets, W = diag(weights): m^2, with 1 s^2 on the velocities.

    Starting state
        Targets uniform in azimuth and range over the region in front of the first platform, with velocities drawn with
        the standard deviation ``speed`` in x and in y. The estimates are drawn around the truth with covariance P0 =
        diag(prior_variance). The camera looks along +y, settled.

    Episode end
        Terminated after ``horizon`` steps; the time left is observed.

    Arguments
        q: bounds of the process noise density, drawn log-uniformly (m^2/s^3): from a straight road to manoeuvres, so
        targets differ in how soon they need a look. targets: how many. sector: least and greatest azimuth of their
        starts (rad, clockwise from +y). ranges: least and greatest range of their starts (m). speed: standard deviation
        of each velocity component (m/s). prior_variance: diagonal of P0. platforms: positions (x, y) in metres, each
        with a radar; the first carries the camera. One radar leaves the cross-range to the camera alone. half_field:
        half the camera's field of view (rad), wide enough for a track not looked at for a while. slew: the fastest it
        turns (rad/s), as pan-tilt heads do. settle: steps to settle, focus and search the image after a turn.
        detection: probability that a target in the image is found. shown, hidden: least and greatest number of steps in
        the camera's sight and out of it, by turns. windows: (target, first, last), steps in which it is out of sight,
        in place of drawn ones. pixels: across the image. carrier_hz: fc. prf: pulse repetition frequency (Hz).
        bandwidth: B (Hz), narrow as a surveillance radar's. fft_length: Nfft, pulses integrated. iterations: at most so
        many per update; 1 is the plain extended filter. weights: diagonal of W. nearest_range: a platform nearer to a
        target than this gets nothing of it.

    References
        S. M. O'Rourke and A. L. Swindlehurst, "Adaptive RF/EO sensing with field-of-view constraints": the platforms
        and what they measure. The turning camera is ours.
    """

    horizon: int = 60
    dt: float = 1.0
    q: Pair = (0.02, 2.0)
    targets: int = 4
    sector: Pair = (-1.5, 1.5)
    ranges: Pair = (2e3, 5e3)
    speed: float = 5.0
    prior_variance: Quad = (100.0, 1.0, 100.0, 1.0)
    platforms: tuple[Pair, ...] = ((0.0, 0.0),)
    half_field: float = 0.15
    slew: float = math.radians(30.0)
    settle: int = 3
    detection: float = 0.7
    shown: tuple[int, int] = (6, 14)
    hidden: tuple[int, int] = (4, 10)
    windows: tuple[Window, ...] = ()
    pixels: int = 1000
    carrier_hz: float = 10e9
    prf: float = 10e3
    bandwidth: float = 2e6
    fft_length: int = 128
    iterations: int = 10
    weights: Quad = (1.0, 1.0, 1.0, 1.0)
    nearest_range: float = 1.0

    def __post_init__(self) -> None:
        """Check what single types cannot say."""
        parts.check_camera(self)
        self.loop  # noqa: B018  (what makes no platforms is reported here)

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        """One draw a target: whether the camera finds it."""
        return (self.targets,)

    @cached_property
    def loop(self) -> RfEo:
        """The platforms as the parent has them, at one setting: the model, the geometry and what is observed of it."""
        return parts.platforms(self)

    @property
    def motion(self) -> MotionModel:
        """The targets' motion model, shared by the world and the tracker."""
        return self.loop.motion

    @cached_property
    def actions(self) -> Library:
        """The target that the camera is to look at."""
        return Library(tuple(f"look at target {t + 1}" for t in range(self.targets)))

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
        one = self.loop.action_set.view(np.array([self.prf, self.bandwidth, 2.0 * self.half_field / self.pixels]))
        variance, low, high = (np.tile(part, (len(self.platforms), 1)) for part in one)
        low[:, kernels.AZIMUTH] = np.inf
        return variance, low, high

    @cached_property
    def _powers(self) -> tuple[Array, Array]:
        return parts.powers(self.motion, self.horizon)

    @cached_property
    def _weights(self) -> Array:
        return np.array(self.weights)

    @cached_property
    def _undone(self) -> Array:
        """F^-1 Q F'^-1: the noise of a step as if it had come a step before."""
        back = np.linalg.inv(self.motion.F)
        return back @ self.motion.Q @ back.T

    def draw_world(self, rng: np.random.Generator) -> World:
        """All draws of one episode."""
        T, J, H = self.targets, len(self.platforms), self.horizon
        place = rng.random((T, 2))
        normal = (rng.standard_normal(shape) for shape in ((T, 2), (T, 4), (H, T, 4), (H, J, T, 3)))
        velocity, start, process, error = normal
        density, window = rng.random(T), rng.random((T, window_draws(H, self.shown, self.hidden)))
        return World(place, velocity, start, process, error, density, window, rng.random((H, T)))

    def initial(self, world: World) -> State:
        """Targets where the tape has them in the region, and the first estimates."""
        count, T = world.start.shape[:2]
        true_states = parts.starts(self, world)
        mean = true_states + np.sqrt(self.prior_variance) * world.start
        covariance = np.tile(np.diag(self.prior_variance), (count, T, 1, 1))
        nothing = np.zeros((count, T), np.int64)
        step = np.zeros(count, np.int64)
        q = self.q[0] * np.exp(math.log(self.q[1] / self.q[0]) * world.density)
        truth = Truth(true_states, nothing, nothing.copy(), np.zeros((count, T), np.bool_))
        visible = visibility(self, world.window, T)
        return State(truth, Belief(step, mean, covariance, np.zeros(count), step.copy(), q, visible))

    def transition(self, state: State, action: Array, world: World) -> State:
        """One step: move, turn the camera, measure what is in view, track."""
        truth, belief = state
        mean, covariance = belief.mean, belief.covariance
        count, T = truth.unseen.shape
        x, P, moved = np.empty(mean.shape), np.empty(covariance.shape), np.empty(mean.shape)
        after, left, seen = np.empty(count), np.empty(count, np.int64), np.empty((count, T), np.bool_)
        received, unseen = np.empty((count, T), np.int64), np.empty((count, T), np.int64)
        F, Q, places, rules = self._scene
        kernels.transition(
            *belief, truth.targets, truth.unseen, world.process, world.error, world.found, action, F, Q,
            self.motion.noise_factor, places, rules, self._mount, *self._view,
            x, P, after, left, moved, received, unseen, seen, NN
        )  # fmt: skip
        fresh = belief._replace(step=belief.step + 1, mean=x, covariance=P, pointing=after, settling=left)
        return State(Truth(moved, received, unseen, seen), fresh)

    def predict(self, belief: Belief, actions: Array, outcome: Array | None = None) -> Belief:
        """The belief one step ahead: predicted means, and covariances after what is in view where it is predicted.

        Args:
            belief: the belief.
            actions: (env,) or (env or 1, candidate).
            outcome: None for the mean of the covariance over detections, or uniform draws (env[, candidate], target): a
                target in the image is found where its draw is below ``detection``.
        """
        several = actions.ndim == 2
        actions = actions if several else actions[:, None]
        count, T = belief.mean.shape[:2]
        shape = (count, actions.shape[1])
        draws = np.empty((1, 1, T)) if outcome is None else outcome.reshape(count, -1, T)
        x, P = np.empty((*shape, T, 4)), np.empty((*shape, T, 4, 4))
        after, left = np.empty(shape), np.empty(shape, np.int64)
        F, Q, places, rules = self._scene
        kernels.predict(
            *belief, actions, draws, outcome is not None, F, Q, places, rules, self._mount, *self._view,
            x, P, after, left, NN
        )  # fmt: skip
        if not several:
            return Belief(belief.step + 1, x[:, 0], P[:, 0], after[:, 0], left[:, 0], belief.q, belief.visible)
        step, q, visible = (
            np.broadcast_to(a[:, None], (*shape, *a.shape[1:])) for a in (belief.step + 1, belief.q, belief.visible)
        )
        return Belief(step, x, P, after, left, q, visible)

    def _turns(self, belief: Belief) -> tuple[Array, Array]:
        """``delay``, and the azimuth of each target one step ahead, from where the camera points (rad)."""
        delay, off = np.empty(belief.mean.shape[:2], np.int64), np.empty(belief.mean.shape[:2])
        F, _, places, _ = self._scene
        kernels.delay(
            belief.step, belief.mean, belief.pointing, belief.settling, belief.visible, F, places, self._mount,
            delay, off, NN
        )  # fmt: skip
        return delay, off

    def delay(self, belief: Belief) -> Array:
        """Steps without sight before the camera sees each target, turning to it from now on, (env, candidate) int.

        Until it has turned and settled, and until the target comes out of cover.
        """
        return self._turns(belief)[0]

    @property
    def target_of_action(self) -> Array:
        """The target that each candidate turns the camera to, (candidate, 1)."""
        return self.candidates()[:, None]

    def gain(self, belief: Belief, wait: Array | int, ahead: int) -> Array:
        """By how much a look at each target after ``wait`` steps lowers the summed cost of the ``ahead`` from it on.

        Of all targets that will be in the image then, each with the probability of being found. What the radars measure
        before the look counts as if they measured it all with the look: without, whatever is far away would seem worth
        more than it is. What they measure after it is left out of account.

        Args:
            belief: the belief.
            wait: steps before the look, (env, candidate) or a number.
            ahead: steps, the look's own included; fewer at the episode's end.

        Returns:
            (env, candidate), 0 where the look would come after the end.
        """
        out = np.empty(belief.mean.shape[:2])
        waits = np.ascontiguousarray(np.broadcast_to(np.asarray(wait, np.int64), out.shape))
        _, _, places, rules = self._scene
        kernels.gain(
            belief.step, belief.mean, belief.covariance, belief.q, belief.visible, waits, *self._powers,
            self.weights_ahead(ahead), places, rules, self._mount, *self._view, out, NN
        )  # fmt: skip
        return out

    def cost(self, belief: Belief) -> Array:
        """trace(W P) summed over the targets."""
        return trace_cost(belief.covariance, self._weights)

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation: the parent's, time left, the camera, and of every target what it takes to look at it."""
        return (*self.loop.observation_fields, *parts.camera_fields(self.targets))

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``."""
        delay, off = self._turns(belief)
        now, changes = parts.coming(belief)
        own = np.stack([off, delay, delay == 0, now, changes, np.log10(belief.q)], axis=-1).reshape(len(delay), -1)
        parents = self.loop.observe(parts.parents_belief(belief, self._undone))
        left = 1.0 - belief.step / self.horizon
        return np.concatenate([parents, left[:, None], belief.settling[:, None], own], axis=1)

    def state_info(self, state: State) -> dict[str, Array]:
        """Of each target ``position_error`` (m), ``nees`` (expected: 4), ``received`` (quantities measured in this
        step), ``found`` (the camera found it in this step) and ``lost``: not found for more than thirty steps; and
        ``pointing`` (rad) and ``settling`` (steps) of the camera.
        """
        return parts.key_figures(state)
