"""O'Rourke and Swindlehurst's RF/EO platforms. PRF, bandwidth and much else is not published: see docs/errata.md."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from wavegym.core.action_sets import JointLibrary, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.costs import trace_cost
from wavegym.core.errors import InputError
from wavegym.core.parameter_box import ParameterBox
from wavegym.core.system import ObservationField, State, System
from wavegym.sensors.penalties import KINDS, SHARPNESS, Penalty
from wavegym.systems.rf_eo import kernels
from wavegym.systems.rf_eo import prediction_kernels as prediction
from wavegym.systems.rf_eo.actions import PlatformActions
from wavegym.systems.rf_eo.information_kernels import most_information
from wavegym.systems.rf_eo.kernels import Rules
from wavegym.systems.rf_eo.plan_kernels import plan
from wavegym.systems.rf_eo.search_kernels import best_settings
from wavegym.systems.rf_eo.state import Belief, Pair, Quad, Triple, Truth, World, check_scenario, platform_elements
from wavegym.targets import MotionModel, constant_velocity
from wavegym.waveforms import SPEED_OF_LIGHT

NN = (0, 0, 0, 0)  # the state [x xdot y ydot], as kernels take its size
LOST_AFTER = 10  # steps without any measurement
PROPOSED = ((60e3, 10e6, 1e-3), (40e3, 5e6, 1e-3))  # the non-adaptive settings


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class RfEo(System):
    """Platforms with a radar and a camera choose pulse repetition frequency, bandwidth and zoom.

    Description
        Each target's state is [x xdot y ydot] (m, m/s), x_{k+1} = A x_k + w_k, white acceleration of density q (eq. 2).
        Platform j measures range, range-rate and azimuth of every target (eqs. 4 to 6) with the variances
        (c / 2B)^2 / 12, (lambda PRF / (2 Nfft))^2 / 12 and alpha^2 / 12, as far as they are in its field of view:
        r <= c / (2 PRF), |rdot| <= lambda PRF / 4, |azimuth| <= Npix alpha / 2. So a high PRF sees fast targets, a low
        one distant targets, and a wide image is a coarse one. An extended Kalman filter in information form (eqs. 8 to
        11) updates each target with what was in view, iterated where the prior is so wide that the linearised
        measurement would mislead. Schedulers predict the covariance with a variance that grows at the edge of the
        field of view (eqs. 12 and 13).

    Rewards
        -trace(W P) summed over the targets, W = diag(weights): m^2, with 1 s^2 on the velocities.

    Starting state
        True targets start at ``starts``; ``first_estimate="halfway"``: the estimates at half the true coordinates, with
        zero velocity (the paper's "about midway"); ``"drawn"``: around the truth with covariance P0. P0 =
        diag(prior_variance).

    Episode end
        Truncated after ``horizon`` steps: tracking goes on, no resource runs out.

    Arguments
        q: process noise density (m^2/s^3). carrier_hz: fc. fft_length: Nfft, pulses integrated. pixels: Npix.
        platforms: positions (x, y) in metres. looks: look direction of each in rad clockwise from +y; none: all 0.
        starts: [x xdot y ydot] of each target. prior_variance: diagonal of P0. prf, bandwidth, pixel_angle: least and
        greatest PRF (Hz), B (Hz) and alpha (rad). points: values of each in the library. penalty: "logistic", "hard",
        "deadzone" or "log-barrier". sharpness: nu relative to the edge, for range, range-rate and azimuth; by default
        100, of the log-barrier 1e8. height: gamma of each (m^2, m^2/s^2, rad^2). out_of_view: "missing", or "inflated":
        drawn with the variance and penalty at the truth, the paper's. iterations: at most so many per update; 1 is the
        plain extended filter, the paper's. margin: how far a prediction keeps a quantity inside the field of view, in
        standard deviations. threshold: t, the least weighted information of any target that the paper's
        scheduler asks for. weights: diagonal of W. nearest_range: a platform nearer to a target than this gets nothing
        of it. as_printed: the paper's misprinted equations. action: "box" (log PRF, B and alpha of every platform),
        "library" (an index per platform) or "joint" (one index for all platforms).

    References
        S. M. O'Rourke and A. L. Swindlehurst, "Adaptive RF/EO sensing with field-of-view constraints".
    """

    terminates = False

    horizon: int = 1000
    dt: float = 1.0
    q: float = 0.01
    carrier_hz: float = 10e9
    fft_length: int = 128
    pixels: int = 1000
    platforms: tuple[Pair, ...] = ((-1e3, -1e3), (1e3, -1e3))
    looks: tuple[float, ...] = ()
    starts: tuple[Quad, ...] = ((-1e3, 0.0, 1e3, 0.0), (1e3, 0.0, 1e3, 0.0))
    first_estimate: Literal["halfway", "drawn"] = "halfway"
    prior_variance: Quad = (1e6, 25.0, 1e6, 25.0)
    prf: Pair = (1e3, 100e3)
    bandwidth: Pair = (1e6, 20e6)
    pixel_angle: Pair = (1e-5, 2e-3 * math.pi)
    points: tuple[int, int, int] = (4, 1, 4)
    penalty: Penalty = "logistic"
    sharpness: Triple | None = None
    height: Triple = (1e8, 1e6, 10.0)
    out_of_view: Literal["missing", "inflated"] = "missing"
    iterations: int = 10
    margin: float = 0.0
    threshold: float = 0.5
    weights: Quad = (1.0, 1.0, 1.0, 1.0)
    nearest_range: float = 1.0
    as_printed: bool = False
    action: Literal["box", "library", "joint"] = "box"

    def __post_init__(self) -> None:
        """Check what single types cannot say."""
        check_scenario(self)
        self.action_set.levels  # noqa: B018  (points that make no library are reported here)

    @property
    def wavelength(self) -> float:
        """lambda in m."""
        return SPEED_OF_LIGHT / self.carrier_hz

    @cached_property
    def motion(self) -> MotionModel:
        """The targets' motion model, shared by the world and the tracker."""
        return constant_velocity(self.dt, self.q, ("x", "y"), order="axis")

    @cached_property
    def action_set(self) -> PlatformActions:
        """What the platforms may be set to."""
        ranges = (self.prf, self.bandwidth, self.pixel_angle)
        optics = (self.wavelength, self.fft_length, self.pixels, self.as_printed)
        return PlatformActions(ranges, self.points, len(self.platforms), self.action, *optics)

    @property
    def actions(self) -> PerSensorLibrary | JointLibrary | ParameterBox:
        """What an action means."""
        return self.action_set.actions

    def candidates(self) -> Array:
        """Every combination of the library's settings; in a box of very many, the same setting at all platforms."""
        return self.action_set.candidates

    def named_constants(self) -> dict[str, Array]:
        """``proposed``: the non-adaptive settings, in a box that holds them."""
        if self.action != "box" or len(self.platforms) != len(PROPOSED):
            return {}
        settings = np.array(PROPOSED)
        inside = all(
            low <= v <= high for row in PROPOSED for v, (low, high) in zip(row, self.action_set.ranges, strict=True)
        )
        return {"proposed": self.action_set.encode(settings)} if inside else {}

    @property
    def places(self) -> Array:
        """(x, y) of every platform in m and its look direction in rad, (platform, 3), a fresh array."""
        looks = self.looks or (0.0,) * len(self.platforms)
        return np.column_stack([self.platforms, looks])

    @cached_property
    def _scene(self) -> tuple[Any, ...]:
        """Kernel arguments: model, platforms with their look directions, penalties, and the scalars."""
        fence = np.array([self.sharpness or (SHARPNESS[self.penalty],) * 3, self.height])
        law = (self.wavelength, self.fft_length, self.pixels, self.out_of_view == "inflated", self.iterations)
        rules = Rules(KINDS[self.penalty], self.nearest_range, self.margin, self.as_printed, *law)
        return self.motion.F[None].copy(), self.motion.Q[None].copy(), self.places, fence, rules

    @cached_property
    def _weights(self) -> Array:
        return np.array(self.weights)

    def draw_world(self, rng: np.random.Generator) -> World:
        """All draws of one episode."""
        S, P, H = len(self.starts), len(self.platforms), self.horizon
        draws = (rng.standard_normal(shape) for shape in ((S, 4), (H, S, 4), (H, P, S, 3)))
        return World(*draws)

    def initial(self, world: World) -> State:
        """Targets at their starts, and the first estimates."""
        count, S = world.start.shape[:2]
        true_states = np.tile(np.array(self.starts), (count, 1, 1))
        if self.first_estimate == "drawn":
            mean = true_states + np.sqrt(self.prior_variance) * world.start
        else:
            mean = true_states * np.array([0.5, 0.0, 0.5, 0.0])
        covariance = np.tile(np.diag(self.prior_variance), (count, S, 1, 1))
        nothing = np.zeros((count, S), np.int64)
        truth = Truth(true_states, nothing, nothing.copy(), np.zeros(count))
        return State(truth, Belief(np.zeros(count, np.int64), mean, covariance))

    def transition(self, state: State, action: Array, world: World) -> State:
        """One step: move, set the platforms, measure what is in view, track."""
        (true_states, _, unseen, _), (step, mean, covariance) = state
        x, P, moved = np.empty(mean.shape), np.empty(covariance.shape), np.empty(mean.shape)
        received, without, share = np.empty(unseen.shape, np.int64), np.empty(unseen.shape, np.int64), np.empty(len(x))
        F, Q, *scene = self._scene
        kernels.transition(
            step, mean, covariance, true_states, unseen, world.process, world.error, self.action_set.settings(action),
            F, Q, self.motion.noise_factor, *scene, x, P, moved, received, without, share, NN
        )  # fmt: skip
        return State(Truth(moved, received, without, share), Belief(step + 1, x, P))

    def predict(self, belief: Belief, actions: Array, outcome: None = None) -> Belief:
        """The belief one step ahead: predicted means, covariances of eq. (11) with the penalised variances."""
        several, settings = self._settings(actions)
        shape = (len(belief.step), settings.shape[1], len(self.starts))
        x, P = np.empty((*shape, 4)), np.empty((*shape, 4, 4))
        prediction.predict(belief.mean, belief.covariance, settings, *self._scene, x, P, NN)
        step = np.broadcast_to(belief.step[:, None] + 1, shape[:2])
        return Belief(step, x, P) if several else Belief(step[:, 0], x[:, 0], P[:, 0])

    def information(self, belief: Belief, actions: Array) -> Array:
        """The paper's gain tr(P C' R~^-1 C) of every target one step ahead, (env[, candidate], target)."""
        several, settings = self._settings(actions)
        gain = np.empty((len(belief.step), settings.shape[1], len(self.starts)))
        prediction.information(belief.mean, belief.covariance, settings, *self._scene, gain, NN)
        return gain if several else gain[:, 0]

    def _settings(self, actions: Array) -> tuple[bool, Array]:
        """Whether actions are (env, candidate, ...) rather than (env, ...), and their settings as of the former."""
        several = actions.ndim == (2 if self.action == "joint" else 3)
        return several, self.action_set.settings(actions if several else actions[:, None])

    def best_action(self, belief: Belief) -> Array:
        """The one-step scheduler's choice, platform after platform until none changes; in a box on a finer grid."""
        chosen = np.empty((len(belief.step), len(self.platforms), 2), np.int64)
        best_settings(
            belief.mean,
            belief.covariance,
            self.action_set.axes,
            self.action_set.sizes,
            self._weights,
            *self._scene,
            chosen,
            NN,
        )
        return self.action_set.choose(chosen[..., 0], chosen[..., 1])

    def most_information(self, belief: Belief, threshold: float | None = None) -> tuple[Array, Array]:
        """The paper's choice on the same grid: the greatest information of which every target has the threshold t.

        Args:
            belief: the belief.
            threshold: t; None for the system's own.

        Returns:
            Actions (env, ...), and whether t was reached, (env,) bool; where not, the worst-off target gets most.
        """
        feasible = np.empty(len(belief.step), np.bool_)
        chosen = np.empty((len(feasible), len(self.platforms), 2), np.int64)
        least = self.threshold if threshold is None else threshold
        if not least >= 0.0:
            raise InputError(f"threshold is {least}, expected a number >= 0")
        most_information(
            belief.mean,
            belief.covariance,
            self.action_set.axes,
            self.action_set.sizes,
            least,
            *self._scene,
            chosen,
            feasible,
            NN,
        )
        return self.action_set.choose(chosen[..., 0], chosen[..., 1]), feasible

    def plan(self, belief: Belief, depth: int) -> tuple[Array, Array]:
        """A good sequence of ``depth`` choices: the one-step scheduler's, improved one point of the grid at a time.

        Returns:
            The first actions (env, ...), and the predicted cost of the whole sequence (env,).
        """
        cost = np.empty(len(belief.step))
        chosen = np.empty((len(cost), depth, len(self.platforms), 2), np.int64)
        plan(
            belief.mean, belief.covariance, belief.step, self.horizon, self.action_set.axes, self.action_set.sizes,
            self._weights, *self._scene, chosen, cost, NN
        )  # fmt: skip
        return self.action_set.choose(chosen[:, 0, :, 0], chosen[:, 0, :, 1]), cost

    def cost(self, belief: Belief) -> Array:
        """trace(W P) summed over the targets."""
        return trace_cost(belief.covariance, self._weights)

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation: of every target how well it is known, and what each platform will meet of it."""
        return platform_elements(len(self.starts), len(self.platforms))

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``."""
        out = np.empty((len(belief.step), len(self.observation_fields)))
        F, Q, places, _, rules = self._scene
        kernels.observe(belief.mean, belief.covariance, F, Q, places, rules, out, NN)
        logs: Array = np.log(out, out=out)  # in one go for all: several times faster than one by one
        logs *= self._decades
        return logs

    @cached_property
    def _decades(self) -> Array:
        """From natural logarithms to the elements: a spread is the root of its variance."""
        return np.array([0.5 if "sigma" in e.name else 1.0 for e in self.observation_fields]) / np.log(10.0)

    def state_info(self, state: State) -> dict[str, Array]:
        """Of each target ``position_error`` (m), ``nees`` (expected: 4), ``received`` (quantities measured in this
        step) and ``lost``: nothing received for more than ten steps. Of the settings that were chosen
        ``information``, the least weighted information of any target as predicted, and whether it is
        ``below_threshold``; before the first choice 0 and False.
        """
        truth, belief = state
        position, nees = np.empty(truth.unseen.shape), np.empty(truth.unseen.shape)
        kernels.measure(belief.mean, belief.covariance, truth.targets, position, nees, NN)
        return {
            "position_error": position,
            "nees": nees,
            "received": truth.received.copy(),
            "lost": truth.unseen > LOST_AFTER,
            "information": truth.share.copy(),
            "below_threshold": (truth.share < self.threshold) & (belief.step > 0),
        }
