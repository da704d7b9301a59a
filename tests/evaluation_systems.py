"""Small systems whose costs are known in closed form and whose episodes end early, at different times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from wavegym.core.system import ObservationField, State, System


class Names(NamedTuple):
    labels: tuple[str, ...]


class World(NamedTuple):
    length: Any  # () steps until the episode ends
    level: Any  # () factor on every cost


class Truth(NamedTuple):
    nothing: Any  # (env,)


class Belief(NamedTuple):
    step: Any  # (env,)
    length: Any  # (env,)
    level: Any  # (env,)
    gain: Any  # (env,) of the last action


@dataclass(frozen=True)
class Uneven(System):
    """Costs level * gains[action] at every step and lasts 1 to ``horizon`` steps."""

    horizon: int = 9
    dt: float = 0.5
    gains: tuple[float, ...] = (1.0, 2.0, 4.0)

    @property
    def actions(self):
        return Names(tuple(f"gain {g:g}" for g in self.gains))

    @property
    def observation_fields(self):
        return (ObservationField("step", "1", 0.0, 10.0, "step"), ObservationField("level", "1", 0.0, 10.0, "level"))

    def draw_world(self, rng):
        return World(np.asarray(rng.integers(1, self.horizon + 1)), np.asarray(rng.lognormal()))

    def initial(self, world):
        zero = np.zeros(len(world.level))
        return State(Truth(zero), Belief(zero.astype(np.int64), world.length.copy(), world.level.copy(), zero + 1.0))

    def transition(self, state, action, world):
        p = state.belief
        return State(state.truth, Belief(p.step + 1, p.length, p.level, np.asarray(self.gains)[action]))

    def predict(self, belief, actions, outcome=None):
        gain = np.broadcast_to(np.asarray(self.gains)[actions], (len(belief.step), actions.shape[-1]))
        wide = [np.broadcast_to(a[:, None], gain.shape) for a in (belief.step + 1, belief.length, belief.level)]
        return Belief(*wide, gain)

    def cost(self, belief):
        return belief.level * belief.gain

    def observe(self, belief):
        return np.stack([belief.step.astype(np.float64), belief.level], axis=1)

    def terminal(self, belief):
        return belief.step >= belief.length


@dataclass(frozen=True)
class Measured(Uneven):
    """State info of two targets, which grows with the steps."""

    def state_info(self, state):
        step = state.belief.step.astype(np.float64)
        both = np.stack([step, 7.0 * step], axis=1)  # (env, target)
        lost = np.stack([step >= 1, step >= 3], axis=1)
        return {"position_error": both, "position_variance": 0.25 * both**2, "nees": both, "lost": lost, "gospa": step}


class Noise(NamedTuple):
    walk: Any  # (H,) steps of the target
    measured: Any  # (H,) errors of the measurements


class Walk(NamedTuple):
    x: Any  # (env,)


class Filtered(NamedTuple):
    step: Any  # (env,)
    mean: Any  # (env,)
    variance: Any  # (env,)


@dataclass(frozen=True)
class Walker(System):
    """A random walk of unit steps under a Kalman filter that takes the measurement noise for ``believed`` of its own.

    An action is the standard deviation of the measurements: 1, 2 or 4. With ``believed = 1`` the filter is exact.
    """

    horizon: int = 30
    dt: float = 1.0
    believed: float = 1.0
    noises: tuple[float, ...] = (1.0, 2.0, 4.0)
    nees_dimension: ClassVar[int | None] = 1

    @property
    def actions(self):
        return Names(tuple(f"noise {noise:g}" for noise in self.noises))

    @property
    def observation_fields(self):
        return (ObservationField("variance", "m^2", 0.0, 10.0, "variance"),)

    def draw_world(self, rng):
        return Noise(rng.normal(size=self.horizon), rng.normal(size=self.horizon))

    def initial(self, world):
        zero = np.zeros(len(world.walk))
        return State(Walk(zero), Filtered(zero.astype(np.int64), zero.copy(), zero.copy()))

    def transition(self, state, action, world):
        row, step = np.arange(len(state.belief.step)), state.belief.step
        x, noise = state.truth.x + world.walk[row, step], np.asarray(self.noises)[action]
        predicted = state.belief.variance + 1.0
        gain = predicted / (predicted + (self.believed * noise) ** 2)
        mean = state.belief.mean + gain * (x + noise * world.measured[row, step] - state.belief.mean)
        return State(Walk(x), Filtered(step + 1, mean, (1.0 - gain) * predicted))

    def predict(self, belief, actions, outcome=None):
        predicted = np.broadcast_to(belief.variance[:, None] + 1.0, (len(belief.step), actions.shape[-1]))
        gain = predicted / (predicted + (self.believed * np.asarray(self.noises)[actions]) ** 2)
        wide = [np.broadcast_to(a[:, None], gain.shape) for a in (belief.step + 1, belief.mean)]
        return Filtered(*wide, (1.0 - gain) * predicted)

    def cost(self, belief):
        return belief.variance

    def observe(self, belief):
        return belief.variance[:, None]

    def state_info(self, state):
        error = state.truth.x - state.belief.mean
        variance = np.where(state.belief.step > 0, state.belief.variance, 1.0)  # the start is known exactly
        return {"position_error": np.abs(error), "position_variance": variance, "nees": error**2 / variance}


@dataclass(frozen=True)
class Hopeless(Uneven):
    """Its costs are not valid for statistics."""

    price: float = 0.0

    def cost(self, belief):
        return self.price * belief.gain
