"""A small system with every kind of delayed cost, in plain NumPy: set-up, energy, known hiding, missed pulses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from wavegym.core import shortcuts, trees
from wavegym.core.action_sets import Library
from wavegym.core.arrays import Array
from wavegym.core.horizon_weights import LinearCost
from wavegym.core.system import ObservationField, State, System

TARGETS = 2
CANDIDATES = ("A short", "A long", "B short", "B long", "silence")
TARGET = np.array([0, 0, 1, 1, -1])  # of each candidate
VARIANCE = np.array([4.0, 1.0, 4.0, 1.0, 1.0])  # of its measurement
SPENDING = np.array([0.4, 1.0, 0.4, 1.0, 0.0])


class DelayWorld(NamedTuple):
    """One episode's random numbers."""

    start: Array  # (target, 2)
    noise: Array  # (target,), process noise
    hidden: Array  # (target,), the first of three steps at which it is hidden
    detection: Array  # (H, 1), uniform
    measurement: Array  # (H,), standard normal
    process: Array  # (H, target), standard normal


class DelayTruth(NamedTuple):
    """The truth."""

    state: Array  # (env, target, 2)


class DelayBelief(NamedTuple):
    """The belief and the resources."""

    step: Array  # (env,)
    mean: Array  # (env, target, 2)
    covariance: Array  # (env, target, 2, 2)
    noise: Array  # (env, target)
    pointing: Array  # (env,) which target the sensor is set up for
    dead: Array  # (env,) steps that the set-up still takes
    energy: Array  # (env,)
    visible: Array  # (env, H, target) bool


@dataclass(frozen=True)
class DelaySystem(System):
    """Two targets on lines and one sensor, which takes ``setup`` steps to turn to the other target.

    If the sensor is not set up for the chosen target, the step has no pulse. After ``setup`` such steps the pulse is
    sent, which takes energy. It detects a visible target with probability ``pd``.
    """

    horizon: int = 12
    dt: float = 1.0
    setup: int = 2
    budget: float = 4.0
    pd: float = 0.8
    weights: tuple[float, float] = (1.0, 0.5)

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        return (1,)

    @property
    def actions(self) -> Library:
        return Library(CANDIDATES)

    @property
    def transition_matrix(self) -> Array:
        return np.array([[1.0, self.dt], [0.0, 1.0]])

    @cached_property
    def linear_cost(self) -> LinearCost:
        return LinearCost(self.transition_matrix, self.weights)

    @property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        names = ("step", "pointing", "dead", "energy", "cost A", "cost B")
        return tuple(ObservationField(name, "1", 0.0, 1.0, name) for name in names)

    def draw_world(self, rng: np.random.Generator) -> DelayWorld:
        return DelayWorld(
            rng.normal(size=(TARGETS, 2)),
            np.exp(rng.uniform(np.log(0.05), np.log(1.0), TARGETS)),
            rng.integers(1, self.horizon, TARGETS),
            rng.random((self.horizon, 1)),
            rng.normal(size=self.horizon),
            rng.normal(size=(self.horizon, TARGETS)),
        )

    def initial(self, world: DelayWorld) -> State:
        count = len(world.start)
        since = np.arange(self.horizon)[:, None] - world.hidden[:, None]  # (env, H, target)
        belief = DelayBelief(
            np.zeros(count, np.int64),
            np.zeros((count, TARGETS, 2)),
            np.tile(np.eye(2), (count, TARGETS, 1, 1)),
            world.noise.copy(),
            np.zeros(count, np.int64),
            np.zeros(count, np.int64),
            np.full(count, self.budget),
            (since < 0) | (since > 2),
        )
        return State(DelayTruth(world.start.copy()), belief)

    def transition(self, state: State, action: Array, world: DelayWorld) -> State:
        belief = state.belief
        rows, at = np.arange(len(belief.step)), np.minimum(belief.step, self.horizon - 1)
        kick = np.array([self.dt**2 / 2, self.dt]) * (np.sqrt(belief.noise) * world.process[rows, at])[..., None]
        truth = (self.transition_matrix @ state.truth.state[..., None])[..., 0] + kick
        fresh, gains = self._step(belief, action, world.detection[rows, at])
        seen, target = truth[rows, TARGET[action], 0], TARGET[action]
        reading = seen + np.sqrt(VARIANCE[action]) * world.measurement[rows, at]
        innovation = reading - fresh.mean[rows, target, 0]
        fresh.mean[rows, target] += gains * innovation[:, None]
        return State(DelayTruth(truth), fresh)

    def predict(self, belief: DelayBelief, actions: Array, outcome: Array | None = None) -> DelayBelief:
        actions = np.asarray(actions)
        if actions.ndim == 1:
            return self._step(belief, actions, outcome)[0]
        envs, count = len(belief.step), actions.shape[1]
        rows = trees.take(belief, np.repeat(np.arange(envs), count))
        draws = None if outcome is None else outcome.reshape(envs * count, 1)
        stepped, _ = self._step(rows, np.broadcast_to(actions, (envs, count)).ravel(), draws)
        return trees.tree_map(lambda leaf: leaf.reshape(envs, count, *leaf.shape[1:]), stepped)

    def _step(self, belief: DelayBelief, action: Array, draw: Array | None) -> tuple[DelayBelief, Array]:
        """The next belief, and the Kalman gain (env, 2) of the target pointed at, 0 where there is no reading."""
        rows, target, F = np.arange(len(belief.step)), TARGET[action], self.transition_matrix
        at = np.minimum(belief.step, self.horizon - 1)
        dead = self.to_wait(belief)[rows, action]
        sends = (target >= 0) & (dead == 0)
        chance = np.where(sends, self.pd * belief.visible[rows, at, target], 0.0)
        share = chance if draw is None else (draw[:, 0] < chance).astype(np.float64)
        mean = (F @ belief.mean[..., None])[..., 0]
        covariance = F @ belief.covariance @ F.T + belief.noise[..., None, None] * self._noise()
        own = covariance[rows, target]
        gains = own[:, :, 0] / (own[:, 0, 0] + VARIANCE[action])[:, None]
        covariance[rows, target] = own - (share[:, None] * gains)[:, :, None] * own[:, None, 0, :]
        fresh = belief._replace(
            step=belief.step + 1,
            mean=mean,
            covariance=covariance,
            pointing=np.where(target >= 0, target, belief.pointing),
            dead=np.where(target >= 0, np.maximum(dead - 1, 0), belief.dead),
            energy=belief.energy - np.where(sends, SPENDING[action], 0.0),
        )
        return fresh, share[:, None] * gains

    def to_wait(self, belief: DelayBelief) -> Array:
        """Steps without a pulse before each candidate's, (env, candidate); none for silence."""
        same = belief.pointing[:, None] == TARGET
        return np.where(TARGET < 0, 0, np.where(same, belief.dead[:, None], self.setup))

    def mask(self, belief: DelayBelief) -> Array:
        return belief.energy[:, None] + 1e-9 >= SPENDING

    def cost(self, belief: DelayBelief) -> Array:
        diagonal = np.diagonal(belief.covariance, axis1=-2, axis2=-1)
        return (diagonal * np.asarray(self.weights)).sum(axis=-1).sum(axis=-1)

    def observe(self, belief: DelayBelief) -> Array:
        diagonal = np.diagonal(belief.covariance, axis1=-2, axis2=-1)
        costs = (diagonal * np.asarray(self.weights)).sum(axis=-1)
        return np.column_stack([belief.step, belief.pointing, belief.dead, belief.energy, costs]).astype(np.float64)

    def _noise(self) -> Array:
        dt = self.dt
        return np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])

    def _powers(self) -> tuple[Array, Array]:
        """F^k and the process noise of k steps at power 1, k = 0 .. horizon + 1, (k, 2, 2) each."""
        F, powers, noises = self.transition_matrix, [np.eye(2)], [np.zeros((2, 2))]
        for _ in range(self.horizon + 1):
            powers.append(F @ powers[-1])
            noises.append(F @ noises[-1] @ F.T + self._noise())
        return np.array(powers), np.array(noises)


@shortcuts.gain_by_target.register(DelaySystem)
@shortcuts.gain.register(DelaySystem)
def gain(system: DelaySystem, belief: DelayBelief, wait: Array | int, ahead: Array | int) -> Array:
    waits = np.broadcast_to(np.asarray(wait), (len(belief.step), len(TARGET)))
    at = belief.step[:, None] + waits
    steps = np.minimum(waits, system.horizon) + 1
    powers, noises = system._powers()
    rows = np.arange(len(belief.step))[:, None]
    own = powers[steps] @ belief.covariance[rows, TARGET] @ powers[steps].swapaxes(2, 3)
    own = own + belief.noise[rows, TARGET][..., None, None] * noises[steps]
    shown = belief.visible[rows, np.minimum(at, system.horizon - 1), TARGET] & (at < system.horizon) & (TARGET >= 0)
    counted = np.broadcast_to(np.asarray(ahead), (len(belief.step), TARGETS))[:, TARGET]
    M = system.linear_cost.weights_ahead(int(counted.max()))[counted - 1]
    column = own[..., 0]
    worth = (column * (M[..., 0] * column[..., :1] + M[..., 1] * column[..., 1:])).sum(axis=2)
    return np.where(shown, system.pd * worth / (own[..., 0, 0] + VARIANCE), 0.0)


@shortcuts.delay.register(DelaySystem)
def delay(system: DelaySystem, belief: DelayBelief) -> Array:
    return system.to_wait(belief)


@shortcuts.spending.register(DelaySystem)
def spending(system: DelaySystem) -> Array:
    return SPENDING


@shortcuts.linear_cost.register(DelaySystem)
def linear_cost(system: DelaySystem) -> LinearCost:
    return system.linear_cost


def delay_worlds(system: System, count: int, seed: int = 0) -> Any:
    """``count`` tapes, axis 0 = world."""
    rng = np.random.default_rng(seed)
    return trees.stack([system.draw_world(rng) for _ in range(count)])
