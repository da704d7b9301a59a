"""Small systems whose costs are known in closed form and whose episodes end early, at different times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

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
        return {"position_error": both, "nees": both, "lost": np.stack([step >= 1, step >= 3], axis=1)}


@dataclass(frozen=True)
class Hopeless(Uneven):
    """Its costs are not valid for statistics."""

    price: float = 0.0

    def cost(self, belief):
        return self.price * belief.gain
