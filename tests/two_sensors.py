"""Two sensors, two targets and all three forms of actions for several sensors, in plain NumPy."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.action_sets import JointLibrary, Parameter, ParameterBox, PerSensorLibrary
from wavegym.core.parameters import changed_default, parameter, system_parameters
from wavegym.core.system import ObservationField, State, System
from wavegym.waveforms import SPEED_OF_LIGHT, gaussian_chirp_library

SITES = np.array([0.0, 20e3])  # of the sensors, m
SENSORS = TARGETS = 2
DRIFT = 30.0  # standard deviation of a target's move in a step, m


class World(NamedTuple):
    start: Any  # (target,)
    moves: Any  # (H, target)
    noise: Any  # (H, sensor, target)
    prior: Any  # (target,)


class Truth(NamedTuple):
    position: Any  # (env, target)


class Belief(NamedTuple):
    step: Any  # (env,)
    mean: Any  # (env, target)
    variance: Any  # (env, target)


@system_parameters
class TwoSensors(System):
    """Two targets on a line drift between two ranging sensors, each of which chooses its pulse length.

    Description
        A pulse of length k measures a distance d with variance (c k / 2)^2 + (d / 1 km)^2 10^-4 / k: short pulses for
        near targets, long ones for far targets. The second target is present from step ``appears`` on.
    """

    horizon: int = parameter(6, "steps in an episode")
    dt: float = parameter(1.0, "time step", unit="s")
    durations: tuple[float, ...] = parameter((1e-7, 1e-6, 3e-7), "pulse lengths k", unit="s")
    few: int = parameter(2, "number of pulse lengths in the joint form")
    appears: int = parameter(2, "first step of the second target")
    action: str = parameter("library", '"library", "joint" or "box"', unit="")

    @cached_property
    def library(self):
        return gaussian_chirp_library(self.durations, [0.0])

    @cached_property
    def actions(self):
        if self.action == "joint":
            return JointLibrary(gaussian_chirp_library(self.durations[: self.few], [0.0]), SENSORS)
        if self.action == "box":
            low, high = min(self.durations), max(self.durations)
            return ParameterBox(tuple(Parameter(f"duration_{s + 1}", "s", low, high) for s in range(SENSORS)))
        return PerSensorLibrary(self.library, SENSORS)

    def candidates(self):
        if self.action == "box":
            return self.actions.encode(np.array(self.durations)[PerSensorLibrary(self.library, SENSORS).combinations()])
        return super().candidates()

    def pulses(self, actions):
        """Pulse lengths (..., sensor)."""
        if self.action == "box":
            return self.actions.decode(actions)
        return np.array(self.durations)[self.actions.indices[actions] if self.action == "joint" else actions]

    def draw_world(self, rng):
        shapes = ((self.horizon, TARGETS), (self.horizon, SENSORS, TARGETS), (TARGETS,))
        return World(rng.uniform(2e3, 18e3, TARGETS), *(rng.standard_normal(shape) for shape in shapes))

    def initial(self, world):
        count = len(world.start)
        belief = Belief(np.zeros(count, np.int64), world.start + 300 * world.prior, np.full((count, TARGETS), 9e4))
        return State(Truth(world.start.copy()), belief)

    def transition(self, state, action, world):
        rows, step = np.arange(len(action)), state.belief.step
        position = state.truth.position + DRIFT * world.moves[rows, step]
        R = variances(self.pulses(action), position)
        z = position[:, None] + np.sqrt(R) * world.noise[rows, step]
        mean, P = state.belief.mean, state.belief.variance + DRIFT * DRIFT
        for s in range(SENSORS):
            gain = P / (P + R[:, s])
            mean, P = mean + gain * (z[:, s] - mean), P - gain * P
        return State(Truth(position), Belief(step + 1, mean, P))

    def predict(self, belief, actions, outcome=None):
        pulses = self.pulses(actions)
        step, mean, P = belief
        if pulses.ndim == 3:
            step, mean, P = step[:, None], mean[:, None], P[:, None]
        P = 1.0 / (1.0 / (P + DRIFT * DRIFT) + (1.0 / variances(pulses, mean)).sum(axis=-2))
        return Belief(np.broadcast_to(step + 1, P.shape[:-1]), np.broadcast_to(mean, P.shape), P)

    def cost(self, belief):
        return belief.variance.sum(axis=-1)

    @cached_property
    def observation_fields(self):
        means = [ObservationField(f"mean_{t}", "m", 1e4, 1e4, "estimate") for t in range(TARGETS)]
        logs = [ObservationField(f"log_variance_{t}", "1", 8.0, 3.0, "uncertainty") for t in range(TARGETS)]
        return (*means, *logs, ObservationField("step", "1", 0.0, 10.0, "steps made"))

    def observe(self, belief):
        return np.concatenate([belief.mean, np.log(belief.variance), belief.step[:, None]], axis=1)

    def state_info(self, state):
        """``position_error`` (m), ``nees`` (expected: 1) and ``lost`` of each target that is ``present``."""
        present = state.belief.step[:, None] >= np.array([0, self.appears])
        error = np.where(present, np.abs(state.belief.mean - state.truth.position), 0.0)
        nees = error * error / state.belief.variance
        near = (nees < 1.0).sum(axis=1)
        return {"position_error": error, "nees": nees, "present": present, "lost": nees > 4.0, "near": near}


@shortcuts.constants.register(TwoSensors)
def constants(system: TwoSensors):
    """The same pulse from both sensors."""
    if system.action == "library":
        return np.repeat(np.arange(len(system.durations))[:, None], SENSORS, axis=1)
    if system.action == "joint":
        return np.flatnonzero(np.ptp(system.actions.indices, axis=1) == 0)
    return system.candidates()


def variances(pulses, positions):
    """(..., sensor, target) of pulses (..., sensor) at targets (..., target)."""
    k = pulses[..., :, None]
    km = np.abs(positions[..., None, :] - SITES[:, None]) / 1e3
    length = 0.5 * SPEED_OF_LIGHT * k
    return length * length + km * km * 1e-4 / k


@system_parameters
class Quick(TwoSensors):
    """Has a search of its own, which tabulates each sensor's information once and adds pairs."""

    def search(self, belief):
        if self.action != "library":
            raise NotImplementedError
        k = np.array(self.durations)
        count = len(k)
        both = np.broadcast_to(k[None, :, None], (len(belief.step), count, SENSORS))
        info = 1.0 / variances(both, belief.mean[:, None])  # (env, waveform, sensor, target)
        prior = 1.0 / (belief.variance + DRIFT * DRIFT)
        total = prior[:, None, None] + info[:, :, None, 0] + info[:, None, :, 1]
        best = (1.0 / total).sum(axis=-1).reshape(len(prior), -1).argmin(axis=1)
        return np.stack([best // count, best % count], axis=1)


shortcuts.best_action.register(Quick)(Quick.search)


@system_parameters
class Coupled(TwoSensors):
    """Only one of the sensors may send the second pulse at a time, and not in the first step."""

    action: str = changed_default(TwoSensors, "action", "joint")

    def mask(self, belief):
        used = (self.actions.indices == 1).sum(axis=1)
        return (used == 0) | ((belief.step > 0)[:, None] & (used < 2))


@system_parameters
class Strict(TwoSensors):
    """Has no joint form."""

    action: Literal["library", "box"] = parameter("library", "form of the actions", unit="")
