"""A small system with masks and early ends, and small libraries for the real one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wavegym.core.action_sets import Library
from wavegym.core.system import State, System
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition

SMALL = {"durations": (10e-6, 50e-6, 300e-6), "sweeps": (0.0, 1e6, -1e6)}
CA = {"model": "ca", "weights": (1.0, 0.5, 0.1), "prior_variance": (1e4, 1e3, 10.0)}


def small(horizon, **kwargs):
    """Nine waveforms, two states."""
    return KershawEvansPosition(**{**SMALL, "horizon": horizon, **kwargs})


def small_ca(horizon, **kwargs):
    """Nine waveforms, three states."""
    return KershawEvans(**{**SMALL, **CA, "horizon": horizon, **kwargs})


class Level(NamedTuple):
    step: np.ndarray
    level: np.ndarray


class Start(NamedTuple):
    level: np.ndarray


@dataclass(frozen=True)
class Ladder(System):
    """A level is multiplied and raised; above 40 the episode ends; one of the actions is always forbidden."""

    horizon: int = 6
    dt: float = 1.0

    @property
    def actions(self):
        return Library(("a", "b", "c"))

    def draw_world(self, rng):
        return Start(np.array(rng.uniform(1, 30)))

    def initial(self, world):
        return State(None, Level(np.zeros(len(world.level), int), world.level.copy()))

    def transition(self, state, action, world):
        return State(None, self.predict(state.belief, action))

    def predict(self, belief, actions, outcome=None):
        level = belief.level[:, None] if actions.ndim == 2 else belief.level
        step = belief.step[:, None] if actions.ndim == 2 else belief.step
        level = np.array([0.3, 1.5, 1.0])[actions] * level + np.array([12.0, 1.0, 3.0])[actions]
        return Level(np.broadcast_to(step + 1, level.shape), level)

    def cost(self, belief):
        return belief.level

    def terminal(self, belief):
        return (belief.step >= self.horizon) | (belief.level > 40)

    def mask(self, belief):
        return (belief.level.astype(int)[:, None] % 3) != np.arange(3)
