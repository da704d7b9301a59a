"""RF/EO against filterpy's and Stone Soup's extended Kalman filters, and the time of its decisions.

Both peers do the same step for two targets and two platforms. They decode the action to variances and field of view,
move the truth, and measure the targets in view. One filter per target predicts and updates with six numbers. The same
functions for both then compute observation, cost, position errors, NEES and predicted information. The peers have no
resets, clipping or Gymnasium shells. Their measurement functions are plain Python arithmetic, which for a few numbers
takes 0.6 of NumPy's time.
"""

from __future__ import annotations

import datetime
import math
import statistics
from collections.abc import Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from stonesoup.models.base import GaussianModel
from stonesoup.models.measurement.base import MeasurementModel
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.array import StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater

from research.benchmarks import planners
from research.benchmarks.timing import Ratio, compare, cpu_us
from wavegym.core import shortcuts
from wavegym.core.arrays import Array
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.envs import WaveformEnv, WaveformVectorEnv
from wavegym.schedulers import Lookahead
from wavegym.systems.rf_eo.system import RfEo
from wavegym.waveforms import SPEED_OF_LIGHT

BATCH = 256
SYSTEM = RfEo()
WIDE = np.array([0.0, 0.0, 1.0] * 2)  # PRF 10 kHz, bandwidth 4.5 MHz, full circle: all targets are always in view
F, Q, L = SYSTEM.motion.F, SYSTEM.motion.Q, SYSTEM.motion.noise_factor
R = np.diag(SYSTEM.action_set.view(SYSTEM.action_set.settings(WIDE)).variance.reshape(-1))
P0 = np.diag(SYSTEM.prior_variance)
CELL = 1.0 / math.sqrt(12.0)
NOW, SECOND = datetime.datetime(2024, 1, 1), datetime.timedelta(seconds=SYSTEM.dt)


def measure(state: Sequence[float]) -> list[float]:
    """Range, range-rate and azimuth of one target from each platform; all platforms look along +y."""
    x, vx, y, vy = state
    z: list[float] = []
    for px, py in SYSTEM.platforms:
        dx, dy = x - px, y - py
        r = math.hypot(dx, dy)
        z += (r, (dx * vx + dy * vy) / r, math.atan2(dx, dy))
    return z


def jacobian(state: Sequence[float]) -> Array:
    """Derivatives of ``measure``, (6, 4)."""
    x, vx, y, vy = state
    rows = []
    for px, py in SYSTEM.platforms:
        dx, dy = x - px, y - py
        r = math.hypot(dx, dy)
        ux, uy = dx / r, dy / r
        rate = ux * vx + uy * vy
        rows.append((ux, 0.0, uy, 0.0))
        rows.append(((vx - rate * ux) / r, ux, (vy - rate * uy) / r, uy))
        rows.append((uy / r, 0.0, -ux / r, 0.0))
    return np.array(rows)


def residual(z: Array, predicted: Array) -> Array:
    """z - predicted, azimuths wrapped."""
    y = z - predicted
    y[2], y[5] = math.remainder(y[2], math.tau), math.remainder(y[5], math.tau)
    return y


class Tracker(Protocol):
    """One filter per target."""

    def step(self, measurements: Sequence[Array]) -> float:
        """Predict and update with the six numbers of each target; return the sum of the traces."""

    @property
    def beliefs(self) -> list[tuple[Array, Array]]:
        """Mean and covariance of each target."""


class Filterpy:
    """``ExtendedKalmanFilter`` objects."""

    def __init__(self, starts: Sequence[Sequence[float]] = SYSTEM.starts, prior: Array = P0) -> None:
        self.filters = []
        for start in starts:
            tracker = ExtendedKalmanFilter(4, 6)
            tracker.x, tracker.P, tracker.F, tracker.Q, tracker.R = np.array(start), prior, F, Q, R
            self.filters.append(tracker)

    def step(self, measurements: Sequence[Array]) -> float:
        total = 0.0
        for tracker, z in zip(self.filters, measurements, strict=True):
            tracker.predict()
            tracker.update(z, self.slopes, self.values, residual=residual)
            total += tracker.P.trace()
        return total

    @staticmethod
    def values(x: Array) -> Array:
        return np.array(measure(x.tolist()))

    @staticmethod
    def slopes(x: Array) -> Array:
        return jacobian(x.tolist())

    @property
    def beliefs(self) -> list[tuple[Array, Array]]:
        return [(tracker.x, tracker.P) for tracker in self.filters]


class Platforms(MeasurementModel, GaussianModel):
    """Measurements of both platforms; Stone Soup's range-rate model has no analytic Jacobian and is 4 times slower."""

    @property
    def ndim_meas(self) -> int:
        return 6

    def covar(self, **kwargs: Any) -> Array:
        return R

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> StateVector:
        return StateVector(measure(np.asarray(state.state_vector)[:, 0].tolist()))

    def jacobian(self, state: Any, **kwargs: Any) -> Array:
        return jacobian(np.asarray(state.state_vector)[:, 0].tolist())


class WrappingUpdater(ExtendedKalmanUpdater):
    """Wraps azimuth residuals of plain numbers; faster than Stone Soup's ``Bearing`` objects."""

    def _posterior_mean(self, predicted: Any, gain: Array, measurement: Any, measured: Any) -> StateVector:
        y = residual(np.asarray(measurement.state_vector)[:, 0], np.asarray(measured.state_vector)[:, 0])
        return StateVector(np.asarray(predicted.state_vector)[:, 0] + np.asarray(gain) @ y)


class StoneSoup:
    """A predictor, an updater and a state for each target. Predictions are cached: each step makes new states."""

    def __init__(self, starts: Sequence[Sequence[float]] = SYSTEM.starts, prior: Array = P0) -> None:
        self.model, self.now = Platforms(ndim_state=4, mapping=(0, 1, 2, 3)), NOW
        motion = LinearGaussianTimeInvariantTransitionModel(transition_matrix=F, covariance_matrix=Q)
        self.predictor, self.updater = KalmanPredictor(motion), WrappingUpdater(self.model)
        self.states = [GaussianState(list(start), prior, timestamp=NOW) for start in starts]

    def step(self, measurements: Sequence[Array]) -> float:
        self.now, total = self.now + SECOND, 0.0
        for i, z in enumerate(measurements):
            prediction = self.predictor.predict(self.states[i], timestamp=self.now)
            detection = Detection(z, timestamp=self.now, measurement_model=self.model)
            self.states[i] = self.updater.update(SingleHypothesis(prediction, detection))
            total += self.states[i].covar.trace()
        return total

    @property
    def beliefs(self) -> list[tuple[Array, Array]]:
        return [(np.asarray(s.state_vector)[:, 0], np.asarray(s.covar)) for s in self.states]


def decode(action: Array) -> tuple[Array, Array]:
    """Standard deviations of the six quantities, and the field of view's edges, (6,) each."""
    deviation, edge = [], []
    for shares in (0.5 * (action + 1.0)).reshape(-1, 3).tolist():
        prf, bandwidth, pixel = (
            low * math.exp(share * math.log(high / low))
            for share, (low, high) in zip(shares, SYSTEM.action_set.ranges, strict=True)
        )
        r, rate = 0.5 * SPEED_OF_LIGHT / bandwidth, 0.5 * SYSTEM.wavelength * prf / SYSTEM.fft_length
        deviation += (r * CELL, rate * CELL, pixel * CELL)
        edge += (0.5 * SPEED_OF_LIGHT / prf, 0.25 * SYSTEM.wavelength * prf, 0.5 * SYSTEM.pixels * pixel)
    return np.array(deviation), np.array(edge)


def look(x: Array, P: Array, deviation: Array) -> tuple[Array, float]:
    """One target's 14 elements of the observation, and the information predicted for the settings."""
    x, P = F @ x, F @ P @ F.T + Q
    C = jacobian(x.tolist())
    spread = ((C @ P) * C).sum(axis=1)
    variances = P.diagonal()
    known = [variances[0] + variances[2], variances[1] + variances[3]]
    raw = np.concatenate([known, np.maximum(np.abs(measure(x.tolist())), 1e-6), np.maximum(spread, 1e-12)])
    return np.log10(raw), float((spread / (deviation * deviation)).sum())


def simulate(tracker: Tracker, steps: int = SYSTEM.horizon, returned: bool = True) -> int:
    """Steps of a peer: settings, truth, field of view, tracker; and the values that the environment returns."""
    rng, truth = np.random.default_rng(0), np.array(SYSTEM.starts)
    for _ in range(steps):
        deviation, edge = decode(WIDE)
        truth = truth @ F.T + rng.standard_normal((2, 4)) @ L.T
        exact = np.array([measure(x) for x in truth.tolist()])
        seen = np.abs(exact) <= edge
        assert seen.all()  # all targets are in view, so the peers need no masks
        tracker.step(list(exact + deviation * rng.standard_normal((2, 6))))
        if not returned:
            continue
        observation, promised = [], []
        for x, (mean, P) in zip(truth, tracker.beliefs, strict=True):
            elements, information = look(mean, P, deviation)
            observation.append(elements)
            promised.append(information)
            error = mean - x
            math.hypot(error[0], error[2])
            error @ np.linalg.solve(P, error)
        np.concatenate(observation).astype(np.float32)
        min(promised)
    return steps


def single_step(env: WaveformEnv) -> int:
    """One episode with its reset: observation, reward and info at each step."""
    env.reset()
    for _ in range(SYSTEM.horizon):
        env.step(WIDE)
    return SYSTEM.horizon


def vector_step(envs: WaveformVectorEnv, actions: Array) -> int:
    """One episode of a batch; the last step resets it."""
    for _ in range(SYSTEM.horizon + 1):
        envs.step(actions)
    return SYSTEM.horizon * len(actions)


def transition(envs: WaveformVectorEnv, actions: Array, repeats: int = 200) -> int:
    """World and trackers of a batch from the first step, without observations, rewards, info and resets."""
    system, world = envs.system, envs.world
    state = system.initial(world)
    for _ in range(repeats):
        state = system.transition(state, actions, world)
    return repeats * len(actions)


def against_filterpy() -> dict[str, tuple[Ratio, float | None]]:
    """Each ratio with its target, if any."""
    env, envs = WaveformEnv(RfEo), WaveformVectorEnv(RfEo, BATCH)
    envs.reset(seed=0)
    actions = np.tile(WIDE, (BATCH, 1))
    return {
        "RfEo step with info and resets, single": (
            compare(lambda: single_step(env), lambda: simulate(Filterpy())),
            3.0,
        ),
        f"RfEo step with info and resets, batch of {BATCH}": (
            compare(lambda: vector_step(envs, actions), lambda: simulate(Filterpy())),
            100.0,
        ),
        f"RfEo world and trackers alone, batch of {BATCH}": (
            compare(lambda: transition(envs, actions), lambda: simulate(Filterpy(), returned=False)),
            None,
        ),
    }


def against_stone_soup() -> dict[str, tuple[Ratio, float | None]]:
    """Each ratio with its target, if any."""
    envs = WaveformVectorEnv(RfEo, BATCH)
    envs.reset(seed=0)
    actions = np.tile(WIDE, (BATCH, 1))
    ratio = compare(lambda: vector_step(envs, actions), lambda: simulate(StoneSoup()))
    return {f"RfEo step with info and resets, batch of {BATCH}": (ratio, 250.0)}


def decision_us(repeats: int = 50) -> float:
    """CPU microseconds of one best action on the grid, single environment: the slowest of four beliefs of a run."""
    world = draw_worlds(SYSTEM, world_seeds(0, "test", 1))
    state, slowest = SYSTEM.initial(world), 0.0

    def decide(belief: Any) -> int:
        for _ in range(repeats):
            shortcuts.best_action(SYSTEM, belief)
        return repeats

    for step in range(501):
        action = shortcuts.best_action(SYSTEM, state.belief)
        if step in (0, 10, 100, 500):
            slowest = max(slowest, statistics.median(cpu_us(partial(decide, state.belief)) for _ in range(9)))
        state = SYSTEM.transition(state, action, world)
    return slowest


def lookaheads() -> dict[str, list[planners.Decision]]:
    """Time of a decision at several depths, single environment."""
    return {f"lookahead:{depth}, RfEo": [planners.measure(Lookahead(depth), 1, SYSTEM)] for depth in (1, 2, 3, 5, 10)}
