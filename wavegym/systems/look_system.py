"""The common base of systems with one sensor that looks at one target at a time, while windows hide targets."""

from __future__ import annotations

import math
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.arrays import Array, for_kernel
from wavegym.core.covariances import trace_cost
from wavegym.core.errors import check_ordered, check_positive
from wavegym.core.horizon_weights import LinearCost
from wavegym.core.parameters import Positive, parameter, system_parameters
from wavegym.core.system import State, System
from wavegym.systems.recorded_targets import (
    PlaysRecordings,
    drawn_windows,
    farthest_range_parameter,
    radar_parameter,
    smoothing_parameter,
    tracks_parameter,
)
from wavegym.systems.rf_eo.kernels import track_errors
from wavegym.systems.rf_eo.scenario import MOST, StateVariance, StateWeights, TurnRate
from wavegym.systems.visibility_windows import Window, given_windows, window_draws
from wavegym.targets import MotionModel
from wavegym.trackers.protocol import Estimate, Scan, Tracker, begin_track, given_tracker, track

NN = (0, 0, 0, 0)  # its length tells kernels the size of the state [x xdot y ydot]
LEAST_DENSITY = 1e-12  # m^2/s^3: an observation contains its logarithm


@system_parameters
class LookSystem(System, PlaysRecordings):
    """Parameters, targets, tracker and cost of ``CameraSlew`` and ``SectorSetup``.

    The state of a target is [x xdot y ydot] (m, m/s). Targets differ in their process noise density. A belief has the
    fields of an ``Estimate``, the densities ``q`` and the windows of visibility, ``visible``. A subclass adds the
    sensor.
    """

    horizon: int = parameter(60, "steps in an episode", ge=1, le=100_000)
    dt: float = parameter(1.0, "time step", unit="s", gt=0, le=1e6)
    targets: int = parameter(4, "number of targets", ge=1, le=MOST)
    q: tuple[Positive, Positive] = parameter(
        (0.1, 5.0),
        "bounds of the process noise density, drawn log-uniformly for each target",
        unit="m^2/s^3",
        truth=True,
    )
    turn_rate: TurnRate = parameter(0.0, "turn rate of the targets' velocities, to the left", unit="rad/s", truth=True)
    prior_variance: StateVariance = parameter(
        (2500.0, 25.0, 2500.0, 25.0), "diagonal of P0", unit="m^2, m^2/s^2", truth=True
    )
    shown: tuple[int, int] = parameter((6, 14), "minimum and maximum number of steps in which a target stays visible")
    hidden: tuple[int, int] = parameter((4, 10), "minimum and maximum number of steps in which it stays hidden")
    windows: tuple[Window, ...] = parameter(
        (), "(target, first step, last step) in which a target is hidden; () draws the windows", unit=""
    )
    weights: StateWeights = parameter((1.0, 1.0, 1.0, 1.0), "diagonal of Lambda", unit="1, s^2")
    tracker: Any = parameter(
        "kalman",
        '"kalman" (the filter that is described above), a Tracker of ``wavegym.trackers.protocol``, or '
        "``package.module:name`` of its factory",
        unit="",
    )
    tracks: Path | None = tracks_parameter("that replaces the drawn targets")
    radar: tuple[float, ...] | None = radar_parameter()
    farthest_range: float = farthest_range_parameter(10e3)
    smoothing: float | None = smoothing_parameter()

    nees_dimension = 4  # position and velocity

    def __post_init__(self) -> None:
        """Check several fields together."""
        check_ordered("q", *self.q)
        check_positive("sum of weights", sum(self.weights))
        window_draws(self.horizon, self.shown, self.hidden)
        given_windows(self.windows, self.targets, self.horizon)
        self._given_tracker  # noqa: B018  (an invalid tracker is reported here)
        self._recorded  # noqa: B018  (an invalid recording is reported here)

    @property
    def motion(self) -> MotionModel:
        """The motion model that the tracker assumes, at a density of 1; ``truth_model.motion`` is that of the world."""
        raise NotImplementedError

    @cached_property
    def _given_tracker(self) -> Tracker | None:
        """The given tracker; None for the compiled filter."""
        return given_tracker(self.tracker, ("kalman",))

    @cached_property
    def linear_cost(self) -> LinearCost:
        """F and Lambda: the targets' transition matrix, and the weights of the cost."""
        return LinearCost(self.motion.F, self.weights)

    @cached_property
    def _weights(self) -> Array:
        return np.array(self.weights)

    @property
    def _recorded_shape(self) -> tuple[int, int]:
        """Number of targets, and number of steps."""
        return self.targets, self.horizon

    def _densities(self, world: Any) -> Array:
        """Process noise density of each target, (env, target)."""
        return self.q[0] * np.exp(math.log(self.q[1] / self.q[0]) * world.density)

    def initial(self, world: Any) -> State:
        """The first true states of the targets, and the first estimates around them."""
        (count, T), real = world.density.shape, self.truth_model
        recorded, window = real._recorded, None
        if recorded:
            window = drawn_windows(recorded, world.process[:, 0, :, 0])
            true_states = recorded.states(window, np.zeros(count, np.int64))
        else:
            true_states = real._starts(world)
        mean = true_states + np.sqrt(real.prior_variance) * world.start
        first = Estimate(mean, np.tile(np.diag(self.prior_variance), (count, T, 1, 1)))
        truth, belief = self._first_state(world, true_states, window, first)
        if self._given_tracker:
            belief = self._with_estimate(belief, begin_track(self._given_tracker, first, self.motion.scaled(belief.q)))
        return State(truth, belief)

    def _starts(self, world: Any) -> Array:
        """First states of the targets, (env, target, 4)."""
        raise NotImplementedError

    def _first_state(self, world: Any, targets: Array, window: Array | None, first: Estimate) -> State:
        """The state at step 0 from true states, windows of a recording and first estimates."""
        raise NotImplementedError

    def move(self, truth: Any, step: Array, world: Any) -> Any:
        """The targets one step on: along their recording, or with white acceleration of their own density."""
        recorded = self.truth_model._recorded
        if recorded and truth.window is not None:
            return truth._replace(targets=recorded.states(truth.window, step + 1))
        return truth._replace(targets=self._moved(truth.targets, truth.q, step, world))

    def _moved(self, targets: Array, q: Array, step: Array, world: Any) -> Array:
        """States (env, target, 4) one step later by the world's motion model."""
        raise NotImplementedError

    def track(self, belief: Any, action: Array, measurements: Any) -> Any:
        """One step of the tracker and of the sensor."""
        after = self._filtered(belief, action, measurements)  # with a given tracker, only for the sensor's state
        if not self._given_tracker:
            return after
        before = Estimate(belief.mean, belief.covariance, belief.memory, belief.process_noise)
        scans = self._scans(belief, after, action, measurements)
        return self._with_estimate(after, track(self._given_tracker, before, self.motion.scaled(belief.q), *scans))

    def _filtered(self, belief: Any, action: Array, measurements: Any) -> Any:
        """One step of the compiled filter and of the sensor."""
        raise NotImplementedError

    def _scans(self, belief: Any, after: Any, action: Array, measurements: Any) -> list[Scan]:
        """The measurements as scans for a given tracker; ``after``: the belief after the step (the sensor's state)."""
        raise NotImplementedError

    def _with_estimate(self, belief: Any, estimate: Estimate) -> Any:
        """``belief`` with the estimate of a given tracker."""
        return belief._replace(**estimate._asdict())

    def _expected(self, belief: Any) -> Any:
        """The belief for schedulers, in which densities approximate the process noise of a given tracker."""
        if belief.process_noise is None:
            return belief
        Q = self.motion.Q
        density = (belief.process_noise * Q).sum(axis=(-2, -1)) / np.square(Q).sum()
        return belief._replace(q=np.maximum(density, LEAST_DENSITY))

    def predict(self, belief: Any, actions: Array, outcome: Array | None = None) -> Any:
        """The belief one step ahead: predicted means, and covariances after a look at the targets predicted in view.

        Args:
            belief: the belief.
            actions: (env,) or (env or 1, candidate).
            outcome: None for the mean covariance over all outcomes, or uniform draws
                (env[, candidate], *outcome_shape): an event happens if its draw is below its probability.
        """
        several = actions.ndim == 2
        chosen = actions if several else actions[:, None]
        count, candidates = len(belief.step), chosen.shape[1]
        draws = None if outcome is None else for_kernel(outcome, np.float64).reshape(count, -1, *self.outcome_shape)
        ahead, step = self._ahead(belief, chosen, draws), belief.step + 1
        if not several:
            return belief._replace(step=step, memory=None, **{name: array[:, 0] for name, array in ahead.items()})
        kept = {"step": step, "q": belief.q, "visible": belief.visible}
        if belief.process_noise is not None:
            kept["process_noise"] = belief.process_noise
        kept = {name: array[:, None].repeat(candidates, axis=1) for name, array in kept.items()}
        return belief._replace(memory=None, **kept, **ahead)

    def _ahead(self, belief: Any, actions: Array, draws: Array | None) -> dict[str, Array]:
        """The predicted fields, (env, candidate, ...), of actions (env or 1, candidate)."""
        raise NotImplementedError

    def cost(self, belief: Any) -> Array:
        """trace(Lambda P) summed over the targets."""
        return trace_cost(belief.covariance, self._weights)

    def _errors(self, state: State) -> dict[str, Array]:
        """``position_error`` (m), ``position_variance`` (m^2) and ``nees`` of each target."""
        truth, belief = state
        values = np.empty((3, *belief.mean.shape[:2]))
        track_errors(belief.mean, belief.covariance, truth.targets, values, NN)
        return dict(zip(("position_error", "position_variance", "nees"), values, strict=True))


@shortcuts.linear_cost.register(LookSystem)
def linear_cost(system: LookSystem) -> LinearCost:
    """F and Lambda. The motion models of the targets differ only in their process noise."""
    return system.linear_cost
