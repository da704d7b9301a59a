"""The one-step scheduler with searched weights on the elements of the state, found by CMA-ES on tuning worlds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.shortcuts import delay, linear_cost
from wavegym.core.system import System
from wavegym.schedulers.heuristics.base import Heuristic
from wavegym.schedulers.heuristics.cma_search import Budget, minimised
from wavegym.schedulers.myopic import Myopic, impossible, require
from wavegym.schedulers.tuning import Constants, log_cost

SIGMA = 1.0  # of the first distribution, in natural logarithms of weights
LEAST = 0.01  # of the largest weight: the start of a weight that is 0 in the cost
DIGITS = 4  # of recorded weights


class WeightedMyopic(Heuristic):
    """The candidate of the least trace(W P) one step ahead, W = diag(weights), in place of the cost's Lambda.

    Information about velocities reduces the cost of later steps, and so does information along an axis that other looks
    measure poorly. The cost of one step ignores both. The rule is not for systems in which looks have delays, because
    one step of prediction does not contain a later look.

    Args:
        weights: one for each element of the state, >= 0.

    Raises:
        InputError: invalid weights; at ``begin``, a system for which the rule is not.
    """

    name = "weighted-myopic"

    def __init__(self, weights: Sequence[float]) -> None:
        self.weights = tuple(float(weight) for weight in weights)
        self._myopic = Myopic()

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        super().begin(system, num_envs, rng)
        given = own_weights(system)
        if len(given) != len(self.weights):
            raise impossible(self.name, system, f"it has {len(given)} weights, not {len(self.weights)}")
        self._myopic.begin(replace(self.system, weights=self.weights), num_envs, rng)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        return self._myopic.act(belief, None, mask)


def search_weights(system: System, worlds: Any, budget: Budget, seed: int = 0) -> Constants:
    """The weights of least cost that CMA-ES finds from those of the cost, the largest of which stays as it is.

    Args:
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world.
        budget: of evaluations or CPU seconds.
        seed: of the random numbers, >= 0.

    Raises:
        InputError: see ``WeightedMyopic``.
    """
    given = own_weights(system)
    start = np.log(np.maximum(given / given.max(), LEAST))
    is_free = np.arange(len(given)) != given.argmax()

    def constants(point: Array) -> Constants:
        logs = np.zeros(len(given))
        logs[is_free] = point
        return {"weights": [float(f"{weight:.{DIGITS}g}") for weight in given.max() * np.exp(logs)]}

    def cost(point: Array) -> float:
        return log_cost(system, WeightedMyopic(**constants(point)), worlds)

    return constants(minimised(cost, start[is_free], SIGMA, budget, 1.0, seed).point)


def own_weights(system: Any) -> Array:
    """The weights of the system's cost, (n,). Raises an InputError where the rule cannot replace them."""
    require(WeightedMyopic.name, system, linear_cost)
    given = np.asarray(linear_cost(system).weights, np.float64)
    if delay.of(system):
        raise impossible(WeightedMyopic.name, system, "its looks have delays")
    if given.ndim != 1 or not is_dataclass(system) or "weights" not in [field.name for field in fields(system)]:
        raise impossible(WeightedMyopic.name, system, "its weights are not one number for each element of the state")
    return given
