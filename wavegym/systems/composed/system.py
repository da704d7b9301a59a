"""A closed loop composed of five parts: targets, sensor, tracker, waveforms, objective."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from wavegym.core.action_sets import ActionSet, JointLibrary, Library
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int, check_positive
from wavegym.core.system import ObservationField, State, System
from wavegym.systems.composed.parts import Objective, Sensor, Targets, Waveforms
from wavegym.trackers.kalman import nees, predict, update_covariance
from wavegym.trackers.protocol import (
    Estimate,
    ExtendedKalman,
    MeasurementModel,
    Scan,
    Tracker,
    begin_track,
    make_tracker,
    track,
)

PARTS = {"targets": Targets, "sensor": Sensor, "waveforms": Waveforms, "objective": Objective}
LEAST_VARIANCE = 1e-12  # that observations tell apart from 0


class World(NamedTuple):
    """One episode's tape."""

    targets: Any  # the draws of the targets
    sensor: Any  # the draws of the sensor


class Truth(NamedTuple):
    """The part of the state that no scheduler sees."""

    targets: Array  # (env, target, n)


class Belief(NamedTuple):
    """The belief."""

    step: Array  # (env,) int
    mean: Array  # (env, target, n)
    covariance: Array  # (env, target, n, n)
    memory: Any = None  # of a tracker that has one; None otherwise, and in prediction
    process_noise: Array | None = None  # (env, target, n, n) of the next step as the tracker believes it; None: Q


class Measurements(NamedTuple):
    """What the sensor reports of each target."""

    z: Array  # (env, target, m)
    detected: Array  # (env, target) bool
    R: Array  # (env, target, m, m) as the tracker assumes it


def _about(description: str, unit: str = "", truth: bool = False) -> dict[str, Any]:
    """A field as ``describe`` shows it."""
    return {"description": description, "unit": unit, "truth": truth}


@dataclass(frozen=True, kw_only=True)
class Loop(System):
    """Targets, a sensor, a tracker, waveforms and an objective: five parts that anybody may write.

    Description
        At every step the targets move, the sensor measures the targets that it detects with the chosen pulse, and the
        tracker updates its estimates. The association of returns to targets is known. Schedulers predict with an
        extended Kalman update, whatever the tracker. Their process noise is that of the targets' motion model, or the
        tracker's own estimate of it. ``truth={"targets": ..., "sensor": ...}`` puts other parts into the world than the
        tracker assumes; they use the same draws.

    Rewards
        Minus the objective's cost.

    Starting state
        That of the targets.

    Episode end
        Terminates after ``horizon`` steps. The remaining time is observed.
    """

    targets: Targets = field(metadata=_about("where targets start and how they move: a Targets", truth=True))
    sensor: Sensor = field(metadata=_about("what is measured, and how well: a Sensor", truth=True))
    waveforms: Waveforms = field(metadata=_about("what may be transmitted: a Waveforms"))
    objective: Objective = field(metadata=_about("what is to be small: an Objective"))
    tracker: Tracker | str = field(
        default=ExtendedKalman(),
        metadata=_about('a Tracker of wavegym.trackers.protocol, or "package.module:name" of its factory'),
    )
    horizon: int = field(default=50, metadata=_about("steps in an episode", "1"))
    dt: float = field(default=1.0, metadata=_about("time between steps, for display", "s"))

    def __post_init__(self) -> None:
        check_int("horizon", self.horizon, 1)
        check_positive("dt", self.dt, "s")
        self._tracker  # noqa: B018  (an invalid tracker is reported here)
        for name, kind in PARTS.items():
            part = getattr(self, name)
            if isinstance(part, type) or not isinstance(part, kind):
                raise InputError(f"{name} is {part!r}, expected an object of {kind.__module__}.{kind.__name__}")
        if not isinstance(self.waveforms.actions, (Library, JointLibrary)):
            raise InputError(f"actions of waveforms are {self.waveforms.actions!r}, expected a Library or JointLibrary")

    @cached_property
    def _tracker(self) -> Tracker:
        return make_tracker(self.tracker)

    @property
    def actions(self) -> ActionSet:
        """What may be transmitted."""
        return self.waveforms.actions

    def draw_world(self, rng: np.random.Generator) -> World:
        """All draws of one episode: the targets', then the sensor's."""
        world = self.truth_model
        return World(world.targets.draw(rng, self.horizon), world.sensor.draw(rng, self.horizon, self.targets.count))

    def initial(self, world: World) -> State:
        """The targets' starts and first estimates."""
        states, estimate = self.truth_model.targets.start(world.targets)
        first = begin_track(self._tracker, estimate, self.targets.motion)
        return State(Truth(states), Belief(np.zeros(len(states), np.int64), *first))

    def move(self, truth: Truth, step: Array, world: World) -> Truth:
        """The targets one step on."""
        return Truth(self.truth_model.targets.move(truth.targets, world.targets, step))

    def measure(self, truth: Truth, belief: Belief, action: Array, world: World) -> Measurements:
        """A measurement of each target with the world's error, and the error's covariance as the tracker assumes it.

        The assumed covariance is that at the true state, because the receiver measures its SNR.
        """
        sensor, pulse = self.truth_model.sensor, self.waveforms.pulse(action)[:, None]
        rows = np.arange(len(belief.step)), belief.step
        detected = world.sensor.uniform[rows] < sensor.detection(truth.targets, pulse)
        factor = np.linalg.cholesky(sensor.covariance(truth.targets, pulse))
        error = (factor * world.sensor.normal[rows][..., None, :]).sum(axis=-1)
        assumed = self.sensor.covariance(truth.targets, pulse)
        return Measurements(sensor.measure(truth.targets) + error, detected, assumed)

    def track(self, belief: Belief, action: Array, measurements: Measurements) -> Belief:
        """One step of the tracker."""
        z, detected, R = measurements
        target = np.broadcast_to(np.arange(self.targets.count), detected.shape)
        model = MeasurementModel(self.sensor.measure, self.sensor.jacobian)
        scan = Scan(z, detected, target, R, model)
        return Belief(belief.step + 1, *track(self._tracker, Estimate(*belief[1:]), self.targets.motion, scan))

    @property
    def nees_dimension(self) -> int:
        """The number of states of a target."""
        return len(self.targets.motion.names)

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        """A draw for each target: whether it is detected."""
        return (self.targets.count,)

    def predict(self, belief: Belief, actions: Array, outcome: Array | None = None) -> Belief:
        """Predicted means, and covariances after an extended Kalman update with the predicted probability of detection.

        ``outcome``: uniform draws (env, target) or (env, candidate, target); a draw below that probability is a
        detection. The tracker's process noise does not change.
        """
        several = actions.ndim == 2
        pulse = self.waveforms.pulse(actions if several else actions[:, None])[:, :, None]  # (env, candidate, 1, ...)
        mean, P = self._ahead(belief)
        x, P = mean[:, None], P[:, None]
        detected = self.sensor.detection(x, pulse)
        if outcome is not None:
            detected = (outcome if several else outcome[:, None]) < detected
        updated = update_covariance(P, self.sensor.jacobian(x), self.sensor.covariance(x, pulse))
        after = P + np.asarray(detected, np.float64)[..., None, None] * (updated - P)
        shape = len(belief.step), pulse.shape[1]
        step, x, after = (
            np.broadcast_to(leaf, shape + leaf.shape[2:]).copy() for leaf in (belief.step[:, None] + 1, x, after)
        )
        Q = belief.process_noise
        if not several:
            return Belief(step[:, 0], x[:, 0], after[:, 0], process_noise=Q)
        return Belief(step, x, after, process_noise=None if Q is None else Q[:, None].repeat(shape[1], axis=1))

    def _ahead(self, belief: Belief) -> tuple[Array, Array]:
        """Means and covariances one step later, before any measurement."""
        motion, Q = self.targets.motion, belief.process_noise
        return predict(belief.mean, belief.covariance, motion.F, motion.Q if Q is None else Q)

    def cost(self, belief: Belief) -> Array:
        """The objective's."""
        return self.objective.cost(Estimate(belief.mean, belief.covariance))

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The time left; for each target the deviations of its state, and its next predicted measurement."""
        listed = [ObservationField("time_left", "1", 0.5, 0.3, "fraction of the horizon still to come")]
        for t in range(1, self.targets.count + 1):
            of = f"of target {t}, one step ahead"
            listed += [
                ObservationField(f"log10_sigma_{name}_{t}", "1", 1.0, 1.0, f"standard deviation of {name} {of}")
                for name in self.targets.motion.names
            ]
            listed += [
                ObservationField(f"{q.name}_{t}", q.unit, q.centre, q.scale, f"predicted measurement {of}")
                for q in self.sensor.quantities
            ]
        return tuple(listed)

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``."""
        mean, P = self._ahead(belief)
        deviations = 0.5 * np.log10(np.maximum(np.diagonal(P, axis1=-2, axis2=-1), LEAST_VARIANCE))
        own = np.concatenate([deviations, self.sensor.measure(mean)], axis=-1).reshape(len(mean), -1)
        return np.concatenate([1.0 - belief.step[:, None] / self.horizon, own], axis=1)

    def state_info(self, state: State) -> dict[str, Array]:
        """For each target ``nees`` (expected: the number of states) and, where the state names them, ``position_error``
        (m) and ``position_variance`` (m^2): of x and y, or of r.
        """
        (states,), (_, mean, covariance, *_) = state
        names, error = self.targets.motion.names, mean - states
        found = {"nees": nees(error, covariance)}
        place = [names.index(name) for name in ("r", "x", "y") if name in names]
        if place:
            found["position_error"] = np.sqrt(np.square(error[..., place]).sum(axis=-1))
            found["position_variance"] = np.diagonal(covariance, axis1=-2, axis2=-1)[..., place].sum(axis=-1)
        return found
