"""One illuminator for several targets: turning to another one takes time in which nothing is seen."""

from __future__ import annotations

import math
from functools import cached_property
from typing import ClassVar

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from wavegym.core.action_sets import Library
from wavegym.core.arrays import Array
from wavegym.core.costs import trace_cost
from wavegym.core.system import ObservationField, State, System
from wavegym.systems.rf_eo.kernels import measure
from wavegym.systems.sector_setup import kernels
from wavegym.systems.sector_setup import prediction_kernels as prediction
from wavegym.systems.sector_setup.state import (
    SOON,
    Belief,
    Pair,
    Quad,
    Truth,
    World,
    check_sector_setup,
    sector_elements,
)
from wavegym.systems.visibility_windows import Window, visibility, window_draws
from wavegym.targets import MotionModel, constant_velocity

NN = (0, 0, 0, 0)  # the state [x xdot y ydot], as kernels take its size


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class SectorSetup(System):
    """One illuminator serves several targets; setting it up for another one costs steps without any sensing.

    Description
        Each target's state is [x xdot y ydot] (m, m/s), x_{k+1} = F x_k + w_k, white acceleration of its own density q.
        A step illuminates one target with one of the waveforms. Choosing another target than the one that is set up
        starts its set-up: ``dead_steps`` steps in which no pulse is sent, begun anew whenever the choice changes.
        Receivers measure the bistatic range (half the path) and its rate, eta = 2E/N0 falling with Rt^2 Rr^2, errors
        with variances in proportion to 1 / eta, and detect with probability Pd = Pf^(1 / (1 + eta / 2)), each by
        itself. The world uses eta at the true place, tracker and schedulers at the predicted one. Targets come into
        sight and go out of it at times known from the beginning, as they drive behind buildings that are on the map.
        Targets are far apart: whose echo it is is taken as known, and there are no false ones. An extended Kalman
        filter takes what was detected. One step ahead a set-up never pays; over a window of visibility it does.

    Rewards
        -trace(Lambda P) summed over the targets, Lambda = diag(weights): m^2, with 1 s^2 on the velocities.

    Starting state
        True targets start anywhere in the region with any heading; the first estimate is drawn around the truth with
        covariance P0 = diag(prior_variance). The illuminator is set up for none.

    Episode end
        Terminates after ``horizon`` steps; the time left is observed.

    Arguments
        targets: how many. dead_steps: steps without sensing that a set-up takes. illuminator: position (x, y) in
        metres. receivers: positions. region: bounds of the starts' x and of their y, m. speed: bounds of the initial
        speed, m/s. q: bounds of the process noise density, drawn log-uniformly (m^2/s^3). prior_variance: diagonal of
        P0. waveforms: standard deviations of range (m) and range-rate (m/s) of each at the reference SNR.
        reference_snr: eta at the reference range, a ratio. reference_range: Rt = Rr in metres at which eta has that
        value. nearest_range: the SNR grows no further where Rt or Rr is below it. false_alarm: Pf. shown, hidden:
        least and greatest number of steps in sight and out of it, by turns. windows: (target, first, last), steps in
        which a target is hidden, in place of drawn ones. weights: diagonal of Lambda.

    References
        S. P. Sira, A. Papandreou-Suppappola, D. Morrell and D. Cochran, "Waveform-agile sensing for tracking multiple
        targets in clutter" (SNR and detection). The delayed cost is this suite's own.
    """

    horizon: int = 60
    dt: float = 1.0
    targets: int = 4
    dead_steps: int = 3
    illuminator: Pair = (0.0, 0.0)
    receivers: tuple[Pair, ...] = ((-4e3, 3e3), (4e3, 3e3))
    region: tuple[Pair, Pair] = ((-2e3, 2e3), (2.5e3, 5e3))
    speed: Pair = (5.0, 20.0)
    q: Pair = (0.1, 5.0)
    prior_variance: Quad = (2500.0, 25.0, 2500.0, 25.0)
    waveforms: tuple[Pair, ...] = ((12.0, 20.0), (60.0, 1.0))
    reference_snr: float = 20.0
    reference_range: float = 5.65e3
    nearest_range: float = 500.0
    false_alarm: float = 1e-3
    shown: tuple[int, int] = (6, 14)
    hidden: tuple[int, int] = (4, 10)
    windows: tuple[Window, ...] = ()
    weights: Quad = (1.0, 1.0, 1.0, 1.0)
    lost_beyond: ClassVar[float] = 300.0  # m: half the width of a lit sector of .15 rad at the region's middle

    def __post_init__(self) -> None:
        """Check what single types cannot say."""
        check_sector_setup(self)

    @cached_property
    def motion(self) -> MotionModel:
        """The targets' motion model at a process noise density of 1; a target's own multiplies Q."""
        return constant_velocity(self.dt, 1.0, ("x", "y"), order="axis")

    @cached_property
    def actions(self) -> Library:
        """Every target with every waveform; the waveform varies fastest."""
        waves = [f"{r:g} m, {v:g} m/s" for r, v in self.waveforms]
        return Library(tuple(f"target {t}, {wave}" for t in range(1, self.targets + 1) for wave in waves))

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        """One draw a receiver: a single target is illuminated."""
        return (len(self.receivers),)

    @cached_property
    def _radar(self) -> tuple[Array, kernels.Radar]:
        """Variances of the waveforms at unit SNR, and what else does not change."""
        accuracy = self.reference_snr * np.square(np.array(self.waveforms))
        sites, strength = np.array([self.illuminator, *self.receivers]), self.reference_snr * self.reference_range**4
        law = (strength, self.nearest_range, math.log(self.false_alarm))
        return accuracy, kernels.Radar(sites, *law, self.dt, self.dead_steps)

    @cached_property
    def _weights(self) -> Array:
        return np.array(self.weights)

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

    def initial(self, world: World) -> State:
        """Targets somewhere in the region, the first estimates around them, and the windows of visibility."""
        count, T = world.density.shape
        true_states = self._starts(world)
        mean = true_states + np.sqrt(self.prior_variance) * world.start
        covariance = np.tile(np.diag(self.prior_variance), (count, T, 1, 1))
        q = self.q[0] * np.exp(math.log(self.q[1] / self.q[0]) * world.density)
        zero = np.zeros(count, np.int64)
        belief = Belief(zero, mean, covariance, np.full(count, -1), zero.copy(), q, self._in_sight(world, true_states))
        return State(Truth(true_states, zero.copy(), np.zeros(count, np.bool_)), belief)

    def _starts(self, world: World) -> Array:
        """States of the targets at first, (env, target, 4): anywhere in the region, with any heading."""
        low, high = np.array([*self.region, self.speed, (-math.pi, math.pi)]).T
        x, y, speed, heading = np.moveaxis(low + (high - low) * world.place, -1, 0)
        return np.stack([x, speed * np.sin(heading), y, speed * np.cos(heading)], axis=-1)

    def _in_sight(self, world: World, true_states: Array) -> Array:
        """When targets that start at ``truth`` can be seen, bool (env, H, target)."""
        return visibility(self, world.window, true_states.shape[1])

    def _split(self, actions: Array) -> tuple[Array, Array]:
        """Target and waveform of each action."""
        return np.divmod(np.asarray(actions, np.int64), len(self.waveforms))

    def transition(self, state: State, action: Array, world: World) -> State:
        """One step: move, set up or look, track."""
        belief = state.belief
        x, P, true_states = np.empty(belief.mean.shape), np.empty(belief.covariance.shape), np.empty(belief.mean.shape)
        pointed, dead, detections = np.empty((3, len(x)), np.int64)
        silent = np.empty(len(x), np.bool_)
        kernels.transition(
            *belief, state.truth.targets, *self._split(action), world.process, world.detection, world.error,
            self.motion.noise_factor, *self._radar, x, P, pointed, dead, true_states, detections, silent, NN
        )  # fmt: skip
        fresh = belief._replace(step=belief.step + 1, mean=x, covariance=P, pointed=pointed, dead=dead)
        return State(Truth(true_states, detections, silent), fresh)

    def predict(self, belief: Belief, actions: Array, outcome: Array | None = None) -> Belief:
        """The belief one step ahead: predicted means, and covariances after a look with the predicted SNR.

        Expected: the mean over every combination of receivers that may detect the target. ``outcome``: uniform draws,
        (env, receiver) or (env, candidate, receiver); a receiver detects where its draw is below the predicted Pd.
        """
        several = np.ndim(actions) == 2
        chosen = actions if several else np.asarray(actions)[:, None]
        lead = (len(belief.step), chosen.shape[1])
        draws = np.empty((lead[0], 1, 0)) if outcome is None else np.asarray(outcome, np.float64)
        x, P = (np.empty((*lead, *a.shape[1:])) for a in (belief.mean, belief.covariance))
        pointed, dead = np.empty((2, *lead), np.int64)
        prediction.predict(
            *belief, *self._split(chosen), draws if draws.ndim == 3 else draws[:, None], *self._radar,
            x, P, pointed, dead, NN
        )  # fmt: skip
        step = belief.step + 1
        if not several:
            return Belief(step, x[:, 0], P[:, 0], pointed[:, 0], dead[:, 0], belief.q, belief.visible)
        step, q, visible = (np.repeat(a[:, None], lead[1], axis=1) for a in (step, belief.q, belief.visible))
        return Belief(step, x, P, pointed, dead, q, visible)

    @cached_property
    def _aims(self) -> tuple[Array, Array]:
        """Target and waveform of each candidate."""
        return self._split(self.candidates())

    @property
    def target_of_action(self) -> Array:
        """The illuminated target of each candidate, (candidate, 1)."""
        return self._aims[0][:, None]

    def delay(self, belief: Belief) -> Array:
        """Steps without sensing before each candidate's pulse is sent, (env, candidate)."""
        target = self._aims[0]
        return np.where(target == belief.pointed[:, None], belief.dead[:, None], self.dead_steps)

    def gain(self, belief: Belief, wait: Array | int, ahead: int) -> Array:
        """By how much each candidate's pulse lowers the summed cost of the ``ahead`` steps from the look on.

        Args:
            belief: the belief.
            wait: steps before the look in which nothing is measured, int or (env or 1, candidate or 1).
            ahead: steps counted, the look's own included; those beyond the horizon count nothing.

        Returns:
            Expected over detections, (env, candidate); 0 where the target is hidden then or the episode over.
        """
        out = np.empty((len(belief.step), len(self.actions)))
        later = np.atleast_2d(np.asarray(wait, np.int64))
        step, mean, covariance, _, _, q, visible = belief
        target, waveform = self._aims
        M, rows = self.weights_ahead(ahead), (0,) * (2 * len(self.receivers))
        prediction.gain(step, mean, covariance, q, visible, target, waveform, later, M, *self._radar, out, NN, rows)
        return out

    def cost(self, belief: Belief) -> Array:
        """trace(Lambda P) summed over the targets."""
        return trace_cost(belief.covariance, self._weights)

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation: time left, the set-up, and of every target when it can be seen and what a look meets."""
        return sector_elements(self.targets, len(self.receivers), self.dead_steps)

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``."""
        out = np.empty((len(belief.step), len(self.observation_fields)))
        prediction.observe(*belief, self._radar[1], SOON, out, NN)
        logs = np.log10(out, out=out, where=self._logarithms > 0.0)
        return np.multiply(logs, self._logarithms, out=out, where=self._logarithms > 0.0)

    @cached_property
    def _logarithms(self) -> Array:
        """What the logarithm of an element is multiplied by; 0 where none is taken. A spread's is of its variance."""
        factors = {"log10_sigma": 0.5, "log10_q": 1.0, "snr": 10.0}
        return np.array(
            [next((f for n, f in factors.items() if e.name.startswith(n)), 0.0) for e in self.observation_fields]
        )

    def state_info(self, state: State) -> dict[str, Array]:
        """Of each target ``position_error`` (m), ``nees`` (expected: 4) and ``lost``: its estimate is so far off that
        the sector lit for it would miss it. Of the step: ``detections``, and whether it was ``dead``.
        """
        truth, belief = state
        position, nees = np.empty(belief.mean.shape[:2]), np.empty(belief.mean.shape[:2])
        measure(belief.mean, belief.covariance, truth.targets, position, nees, NN)
        return {
            "position_error": position,
            "nees": nees,
            "lost": position > self.lost_beyond,
            "detections": truth.detections.copy(),
            "dead": truth.silent.copy(),
        }
