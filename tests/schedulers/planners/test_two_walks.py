"""Two scalar random walks, one measured a step, for certain: rollouts against dynamic programming on a grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from wavegym.core.action_sets import Library
from wavegym.core.system import ObservationField, State, System
from wavegym.schedulers.myopic import Myopic
from wavegym.schedulers.planners import RolloutPlanner
from wavegym.schedulers.rollout import rollout
from wavegym.schedulers.simple import Fixed, RoundRobin

NOISE, ERROR = np.array([4.0, 1.0]), np.array([2.0, 0.5])  # what a step adds, and variance of a measurement
FIRST = np.array([20.0, 10.0])
STEPS, CELLS, MOST = 40, 400, 200.0  # MOST: a variance that no walk reaches under a sensible policy


class Variances(NamedTuple):
    step: np.ndarray
    p: np.ndarray  # (..., 2)


@dataclass(frozen=True)
class TwoWalks(System):
    """The action is the walk to measure; the cost is the sum of the variances."""

    horizon: int = STEPS
    dt: float = 1.0
    terminates: ClassVar[bool] = False

    actions = property(lambda self: Library(("first", "second")))
    observation_fields = (ObservationField("p1", "1", 0.0, 10.0, ""), ObservationField("p2", "1", 0.0, 10.0, ""))

    def draw_world(self, rng):
        return np.zeros(())

    def initial(self, world):
        return State(None, Variances(np.zeros(len(world), np.int64), np.tile(FIRST, (len(world), 1))))

    def transition(self, state, action, world):
        return State(None, self.predict(state.belief, action))

    def predict(self, belief, actions, outcome=None):
        step, p = belief.step, belief.p
        if actions.ndim == 2:
            step, p = np.repeat(step[:, None], actions.shape[1], 1), p[:, None]
        return Variances(step + 1, after(p, actions))

    def cost(self, belief):
        return belief.p.sum(axis=-1)

    def observe(self, belief):
        return belief.p

    def terminal(self, belief):
        return belief.step >= self.horizon


def after(p, action):
    p = p + NOISE
    return np.where(np.arange(2) == action[..., None], p * ERROR / (p + ERROR), p)


@pytest.fixture(scope="module")
def least_cost():
    """Of all steps together, from ``FIRST``.

    The cost to go is a concave function of the variances. So interpolation between grid points, and a variance cut off
    at the grid's end, make it smaller, never larger: the result is a lower bound.
    """
    axis = np.geomspace(0.1, MOST, CELLS)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    branches = [after(points, np.full((CELLS, CELLS), action)) for action in range(2)]
    to_go = np.zeros((CELLS, CELLS))
    for _ in range(STEPS):
        value = RegularGridInterpolator((axis, axis), to_go)
        to_go = np.minimum(*(p.sum(axis=-1) + value(np.clip(p, axis[0], MOST)) for p in branches))
    return float(RegularGridInterpolator((axis, axis), to_go)(FIRST)[0])


@pytest.mark.slow
def test_a_rollout_to_the_end_is_within_5_percent_of_the_optimum_and_never_below(least_cost):
    found = rollout(TwoWalks(), RolloutPlanner(Myopic(), STEPS), np.zeros(1)).cost.sum()
    assert least_cost <= found <= 1.05 * least_cost


def test_no_policy_is_below_the_optimum(least_cost):
    for policy in (Fixed(0), Fixed(1), RoundRobin(), Myopic()):
        assert rollout(TwoWalks(), policy, np.zeros(1)).cost.sum() > least_cost
