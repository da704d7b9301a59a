"""Sira et al.'s closed loop. Carrier, library and gate are not published: proposals of ours (docs/errata.md)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from wavegym.core import trees
from wavegym.core.action_sets import JointLibrary, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_within
from wavegym.core.parameter_box import ParameterBox
from wavegym.core.system import ObservationField, State
from wavegym.sensors import gate_probability
from wavegym.systems.agile_clutter import kernels
from wavegym.systems.agile_clutter import prediction_kernels as prediction
from wavegym.systems.agile_clutter.actions import ChirpActions
from wavegym.systems.agile_clutter.search import NN, SensorAfterSensor
from wavegym.systems.agile_clutter.state import (
    Belief,
    Pulse,
    Truth,
    World,
    check_numbers,
    check_scenario,
    first_gate_volume,
    target_fields,
)
from wavegym.targets import MotionModel, constant_velocity, random_path
from wavegym.trackers import Particles
from wavegym.trackers.information_reduction import reduction_table

LOST_AFTER = 5  # returns outside its gates that a target may have before its track counts as lost (the paper's rule)


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class AgileClutter(SensorAfterSensor):
    """Two radars choose among generalised FM chirps while tracking targets that come and go, in clutter.

    Description
        Each target's state is [x y xdot ydot] (m, m/s), x_k = F x_{k-1} + w_k, white acceleration of density q (eqs. 1
        and 2). Sensor i measures range and range-rate of every target with covariance N = C / eta (section 3.2), where
        C is the inverse Fisher information of its chirp at unit SNR and eta = (r0 / r)^4. A target is detected with
        probability Pd = Pf^(1 / (1 + eta)); clutter is Poisson, uniform in the union of the validation gates, so a
        pulse with large errors also lets more clutter in. The world uses eta at the true range, tracker and schedulers
        at the predicted one. Sensor by sensor, an unscented filter with joint probabilistic data association updates
        all targets. ``tracker="particle"``: a Rao-Blackwellised particle filter instead, which samples joint
        associations from their exact posterior and so keeps a posterior of several modes, which JPDA merges into one.
        Long, wide chirps measure best; phase functions differ in how range and range-rate errors hang together.

    Rewards
        -trace(Lambda P) summed over the targets present, Lambda = diag(weights): m^2, with 1 s^2 on the velocities. It
        is what the tracker believes, and a lost track may be confident: JPDA loses one in fifteen (``lost``, ``nees``),
        particles one in a hundred; ``reward="error"`` looks at the truth.

    Starting state
        True targets start at ``starts``; the first estimate is drawn around the start with covariance P0 =
        diag(prior_variance). Target s is handed to the tracker at step ``births[s]`` and first measured a step later.

    Episode end
        Terminates after ``horizon`` steps, when the last target is gone; the time left is observed.

    Arguments
        q: process noise density (m^2/s^3). carrier_hz: fc. reference_range: r0 in metres, where eta = 1. nearest_range:
        the SNR grows no further below it. sensors: positions (x, y) in metres. starts: [x y xdot ydot] of each target.
        births: step at which each target becomes known. lifetime: steps that each target is tracked for.
        prior_variance: diagonal of P0. false_alarm: Pf. clutter_density: false returns per m (m/s). gate: radius in
        standard deviations. weights: diagonal of Lambda. laws: phase functions, "lfm", "pfm:KAPPA", "hfm:SHAPE",
        "efm:SHAPE". durations, sweeps: in s and Hz; every law with every one of them, up and down, is in the library.
        action: "library" (a waveform per sensor), "joint" (one index for all sensors; every law up and down, longest
        and widest) or "box" (law index, rounded down, where there are several; log duration and signed sweep, for
        every sensor). tracker: "jpda" or "particle". particles: how many.

    References
        S. P. Sira, A. Papandreou-Suppappola, D. Morrell and D. Cochran, "Waveform-agile sensing for tracking multiple
        targets in clutter".
    """

    horizon: int = 32
    dt: float = 0.25
    q: float = 1.0
    carrier_hz: float = 10.4e9
    reference_range: float = 50e3
    nearest_range: float = 100.0
    sensors: tuple[tuple[float, float], ...] = ((3e3, -16e3), (3e3, 20.4e3))
    starts: tuple[tuple[float, float, float, float], ...] = ((2e3, -1e3, -100.0, 800.0), (1e3, -1e3, 100.0, 800.0))
    births: tuple[int, ...] = (0, 7)
    lifetime: int = 25
    prior_variance: tuple[float, float, float, float] = (4e3, 4e3, 100.0, 100.0)
    false_alarm: float = 0.01
    clutter_density: float = 1e-4
    gate: float = 4.0
    weights: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    laws: tuple[str, ...] = ("lfm", "pfm:3", "hfm:0.5", "efm:0.5")
    durations: tuple[float, ...] = (10e-6, 30e-6, 100e-6)
    sweeps: tuple[float, ...] = (1e6, 4e6, 15e6)
    action: Literal["library", "joint", "box"] = "library"
    tracker: Literal["jpda", "particle"] = "jpda"
    particles: int = 1000

    def __post_init__(self) -> None:
        """Check what single types cannot say."""
        check_numbers(self)
        check_scenario(self.sensors, self.starts, self.births, self.lifetime, self.horizon)
        C, snr = self.action_set.sensor_covariances, (self.reference_range, self.nearest_range)
        volume = first_gate_volume(self.starts, self.prior_variance, self.sensors, C, snr, self.gate)
        check_within(
            "clutter_density", self.clutter_density, 0, float(f"{kernels.MOST_CLUTTER / volume:.3g}"), "per m (m/s)"
        )

    @cached_property
    def motion(self) -> MotionModel:
        """The targets' motion model, shared by the world and the tracker."""
        return constant_velocity(self.dt, self.q, ("x", "y"), order="derivative")

    @cached_property
    def action_set(self) -> ChirpActions:
        """What may be transmitted."""
        return ChirpActions(self.laws, self.durations, self.sweeps, self.carrier_hz, len(self.sensors), self.action)

    @property
    def actions(self) -> PerSensorLibrary | JointLibrary | ParameterBox:
        """What an action means."""
        return self.action_set.actions

    def candidates(self) -> Array:
        """Every combination of the sensors' waveforms."""
        return self.action_set.candidates

    def constants(self) -> Array:
        """One law, duration and sweep at all sensors, each sensor up or down."""
        return self.action_set.constants

    @cached_property
    def _targets(self) -> tuple[Array, int]:
        return np.array(self.births, np.int64), self.lifetime

    @cached_property
    def _model(self) -> tuple[Array, Array]:
        return self.motion.F[None].copy(), self.motion.Q[None].copy()

    @cached_property
    def _radar(self) -> tuple[Any, ...]:
        law = (self.reference_range, self.nearest_range, math.log(self.false_alarm))
        return (np.array(self.sensors), *law, self.clutter_density, self.gate, float(gate_probability(self.gate)))

    @cached_property
    def _weights(self) -> Array:
        return np.array(self.weights)

    def draw_world(self, rng: np.random.Generator) -> World:
        """All draws of one episode."""
        S, H, sensors = len(self.starts), self.horizon, len(self.sensors)
        return World(
            rng.standard_normal((S, 4)),
            rng.standard_normal((S, self.lifetime, 4)),
            rng.random((H, sensors, S)),
            rng.standard_normal((H, sensors, S, 2)),
            np.asarray(rng.integers(2**64, dtype=np.uint64)),
        )

    def initial(self, world: World) -> State:
        """The true paths, and the first estimates drawn around their starts."""
        count, S = world.start.shape[:2]
        path = random_path(self.motion, self.first_places(world), world.process)
        first = path[:, :, 0] + np.sqrt(self.prior_variance) * world.start
        mean = np.where(self._targets[0][:, None] == 0, first, self.starts)
        covariance = np.tile(np.diag(self.prior_variance), (count, S, 1, 1))
        particles = None
        if self.tracker == "particle":
            particles = Particles(*(np.repeat(a[:, None], self.particles, axis=1) for a in (mean, covariance)))
        truth = Truth(path[:, :, 0].copy(), path, first, np.zeros((count, S), np.int64), np.zeros((count, 4)))
        return State(truth, Belief(np.zeros(count, np.int64), mean, covariance, particles))

    def first_places(self, world: World) -> Array:
        """Where the targets are at birth, (target, 4) or (env, target, 4)."""
        return np.array(self.starts)

    def transition(self, state: State, action: Array, world: World) -> State:
        """One step: predict, transmit, detect, associate, update, sensor after sensor."""
        return self._advance(state, self.pulse(state.belief, action[:, None]), world)

    def _advance(self, state: State, pulse: Pulse, world: World) -> State:
        """``transition`` with any pulse: for systems that add a resource."""
        truth, (step, mean, covariance, particles) = state.truth, state.belief[:4]
        x, P, true_states = np.empty(mean.shape), np.empty(covariance.shape), np.empty(mean.shape)
        outside, scan = truth.outside.copy(), np.zeros(truth.scan.shape)
        X, V = particles or (np.empty((len(step), 0, *shape[1:])) for shape in (mean.shape, covariance.shape))
        X_out, V_out = np.empty(X.shape), np.empty(V.shape)
        kernels.transition(
            step, mean, covariance, X, V, truth.path, truth.first, world.detection, world.error, world.key,
            pulse.rows((len(step), 1)), self._targets, *self._model, self._radar, x, P, X_out, V_out, true_states,
            outside, scan, NN
        )  # fmt: skip
        if np.isnan(scan).any():
            where = f"environment {np.argmax(np.isnan(scan).any(axis=1))} at step {step[np.isnan(scan).any(axis=1)][0]}"
            wanted = f"at most {kernels.MOST_CLUTTER:g} (smaller clutter_density, dt or q)"
            raise InputError(f"clutter in a gate of {where} has no bound or one too large, expected {wanted}")
        fresh = Belief(step + 1, x, P, None if particles is None else Particles(X_out, V_out))
        return State(Truth(true_states, truth.path, truth.first, outside, scan), fresh)

    def predict(self, belief: Belief, actions: Array, outcome: Array | None = None) -> Belief:
        """The belief after one pulse of every sensor: predicted means, covariances of eqs. (13) and (14).

        ``outcome``: uniform draws (env, sensor, target) or (env, candidate, ...), a detection where below Pd: q2/Pd
        instead of q2 for a detection, no update for a miss. A tracker in clutter is not told which of them happened.
        """
        several = actions.ndim == (2 if self.action == "joint" else 3)
        pulse = self.pulse(belief, actions if several else actions[:, None])
        shape = (len(belief.step), max(a.shape[1] for a in pulse))
        if outcome is not None:
            full = shape + self._everywhere[1].shape[2:]
            outcome = np.broadcast_to(outcome if several else outcome[:, None], full).reshape(-1, *full[2:])
        many = trees.repeated(belief._replace(particles=None), shape[1]) if several else belief
        ahead = self._imagine(many, pulse.rows(shape), outcome)
        return trees.tree_map(lambda leaf: leaf.reshape(shape + leaf.shape[1:]), ahead) if several else ahead

    def _imagine(self, belief: Any, pulse: Sequence[Array], draws: Array | None) -> Belief:
        """``predict`` with any pulse and draws, all with one flat axis: for systems that add a resource."""
        draws = -self._everywhere[1][0] if draws is None else np.ascontiguousarray(draws)  # negative: none
        step, mean, covariance = map(np.ascontiguousarray, belief[:3])
        x, P = np.empty(mean.shape), np.empty(covariance.shape)
        prediction.predict(
            step, mean, covariance, tuple(pulse), draws, self._targets, *self._model, self._radar, reduction_table(),
            x, P, NN
        )  # fmt: skip
        return Belief(step + 1, x, P, None)

    def pulse(self, belief: Belief, actions: Array) -> Pulse:
        """What ``actions`` (env or 1, candidate, ...) transmit: here every sensor looks at all targets."""
        return Pulse(self.action_set.unit_covariance(actions), *self._everywhere)

    @cached_property
    def _everywhere(self) -> tuple[Array, Array]:
        """Strength 1 and chance 1 for all."""
        sensors, targets = len(self.sensors), len(self.starts)
        return np.ones((1, 1, sensors)), np.ones((1, 1, sensors, targets))

    @property
    def outcome_shape(self) -> tuple[int, int]:
        """A draw for every sensor and target: whether it is detected."""
        return len(self.sensors), len(self.starts)

    def cost(self, belief: Belief) -> Array:
        """trace(Lambda P) summed over the targets present."""
        P = belief.covariance
        cost = np.empty(belief.step.size)
        step, P = np.ascontiguousarray(belief.step).reshape(-1), P.reshape(-1, *P.shape[-3:])
        prediction.weighted_trace(step, P, self._targets, self._weights, cost)
        return cost.reshape(belief.step.shape)

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation: time left, and of every target what the next pulse meets, by itself and at each sensor."""
        return target_fields(len(self.starts), len(self.sensors))

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``."""
        out = np.empty((len(belief.step), len(self.observation_fields)))
        prediction.observe(*belief[:3], self.horizon, self._targets, *self._model, self._radar, out, NN)
        return out

    def state_info(self, state: State) -> dict[str, Array]:
        """Of each target, 0 unless ``present``: ``position_error`` (m), ``squared_error`` (m^2, weighted with Lambda)
        and ``nees`` (expected: 4); ``lost``: whether more than five returns have fallen outside its gates so far. Of
        the step: ``detections`` and ``clutter`` points inside gates; with ``tracker="particle"`` also ``ess`` and
        ``ancestors``, effective sample size and distinct ancestors as shares of the particles.
        """
        truth, belief = state
        present = np.empty(truth.outside.shape, np.bool_)
        squared, position, nees = np.empty((3, *present.shape))
        prediction.measure(*belief[:3], truth.targets, self._targets, self._weights, present, squared, position, nees)
        figures = {
            "present": present,
            "position_error": position,
            "squared_error": squared,
            "nees": nees,
            "lost": truth.outside > LOST_AFTER,
            "detections": truth.scan[:, 0].copy(),
            "clutter": truth.scan[:, 1].copy(),
        }
        if self.tracker == "particle":
            figures["ess"], figures["ancestors"] = (truth.scan[:, i] / self.particles for i in (2, 3))
        return figures
