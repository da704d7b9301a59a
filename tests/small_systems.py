"""A small system with masks and early ends, whose costs can be computed by hand, and a tracker with a memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, get_args, get_type_hints

import gymnasium as gym
import numpy as np

from wavegym.core.action_sets import Library
from wavegym.core.system import ObservationField, State, System
from wavegym.targets import constant_velocity
from wavegym.trackers.imm import ImmKalman

BRIEF = {
    "wavegym/UrbanSignal-v0": {"horizon": 12, "pulses": 5, "arrivals": (-5.0, 0.0)},
    "wavegym/MultifunctionRadar-v1": {"horizon": 300, "settled": 0.0},
}
"""Settings for whole episodes of ids whose steps take milliseconds, or whose episodes have thousands of them."""


def two_models():
    """A tracker of targets in the plane that has a memory and a process noise of its own."""
    return ImmKalman(tuple(constant_velocity(1.0, q, ("x", "y")) for q in (0.02, 5.0)))


class Fuel(NamedTuple):
    step: np.ndarray
    left: np.ndarray  # (env,)
    cost: np.ndarray  # (env,)


class Tank(NamedTuple):
    left: np.ndarray


@dataclass(frozen=True)
class Burner(System):
    """Action a burns a + 1 units of fuel and makes the cost 1 / (a + 1); an empty tank ends the episode."""

    horizon: int = 8
    dt: float = 1.0
    fuel: int = 5

    @property
    def actions(self):
        return Library(("low", "middle", "high"))

    @property
    def observation_fields(self):
        return (ObservationField("fuel", "1", 0.0, 10.0, "what is left"),)

    def draw_world(self, rng):
        return Tank(np.array(float(self.fuel + rng.integers(2))))

    def initial(self, world):
        count = len(world.left)
        return State(None, Fuel(np.zeros(count, np.int64), world.left.copy(), np.full(count, 2.0)))

    def transition(self, state, action, world):
        return State(None, self.predict(state.belief, action))

    def predict(self, belief, actions, outcome=None):
        step, left = (x[:, None] if actions.ndim == 2 else x for x in (belief.step, belief.left))
        left = left - (actions + 1)
        return Fuel(
            np.broadcast_to(step + 1, left.shape).copy(), left, np.broadcast_to(1 / (actions + 1), left.shape).copy()
        )

    def cost(self, belief):
        return belief.cost.copy()

    def observe(self, belief):
        return belief.left[:, None]

    def terminal(self, belief):
        return (belief.step >= self.horizon) | (belief.left <= 0)

    def mask(self, belief):
        return np.arange(1, 4) <= belief.left[:, None]


@dataclass(frozen=True)
class Leaky(Burner):
    """Returns an array of its state as the cost."""

    def cost(self, belief):
        return belief.left


@dataclass(frozen=True)
class LeakyMetric(Burner):
    """Returns an array of its state in the state info."""

    def state_info(self, state):
        return {"fuel": state.belief.left}


def has_form(id, form):
    """Whether the system takes ``action=form``; one with a single form may have no such parameter."""
    system = type(gym.make(id).unwrapped.system)
    accepted = get_type_hints(system).get("action")
    return accepted is not None and form in get_args(accepted)
