"""Small systems whose costs are known in closed form and whose episodes end early, at different times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from wavegym.core.system import Element, State, System


class Names(NamedTuple):
    labels: tuple[str, ...]


class World(NamedTuple):
    length: Any  # () steps until the episode ends
    level: Any  # () factor on every cost


class Hidden(NamedTuple):
    nothing: Any  # (env,)


class Public(NamedTuple):
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
    def elements(self):
        return (Element("step", "1", 0.0, 10.0, "step"), Element("level", "1", 0.0, 10.0, "level"))

    def draw_world(self, rng):
        return World(np.asarray(rng.integers(1, self.horizon + 1)), np.asarray(rng.lognormal()))

    def begin(self, world):
        zero = np.zeros(len(world.level))
        return State(Hidden(zero), Public(zero.astype(np.int64), world.length.copy(), world.level.copy(), zero + 1.0))

    def advance(self, state, action, world):
        p = state.public
        return State(state.hidden, Public(p.step + 1, p.length, p.level, np.asarray(self.gains)[action]))

    def imagine(self, public, actions, outcome=None):
        gain = np.broadcast_to(np.asarray(self.gains)[actions], (len(public.step), actions.shape[-1]))
        wide = [np.broadcast_to(a[:, None], gain.shape) for a in (public.step + 1, public.length, public.level)]
        return Public(*wide, gain)

    def cost(self, public):
        return public.level * public.gain

    def observe(self, public):
        return np.stack([public.step.astype(np.float64), public.level], axis=1)

    def ended(self, public):
        return public.step >= public.length


@dataclass(frozen=True)
class Measured(Uneven):
    """With two targets' metrics that grow with the steps."""

    def metrics(self, state):
        step = state.public.step.astype(np.float64)
        both = np.stack([step, 7.0 * step], axis=1)  # (env, target)
        return {"position_error": both, "nees": both, "lost": np.stack([step >= 1, step >= 3], axis=1)}


@dataclass(frozen=True)
class Hopeless(Uneven):
    """Costs nothing that statistics can work with."""

    price: float = 0.0

    def cost(self, public):
        return self.price * public.gain
