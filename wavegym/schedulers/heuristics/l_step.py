"""L-step gain from one step of prediction, for any system with a linear motion model."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import check_int
from wavegym.core.horizon_weights import horizon_weights
from wavegym.core.shortcuts import linear_cost
from wavegym.core.system import System
from wavegym.schedulers.heuristics.base import Heuristic
from wavegym.schedulers.myopic import impossible

BELIEFS = 200_000  # in memory at a time


class Gain(Heuristic):
    """L-step gain: the candidate after which the next ``ahead`` steps cost least without further measurements.

    It minimises trace(M P) summed over the targets, with P as ``predict`` expects it after one step and M of
    ``horizon_weights``. It needs one ``predict``, one covariance for each target and a linear motion model. With
    ``ahead=1`` it is the myopic scheduler. A pulse with a delay has no gain here; for delays see ``AwareGreedy`` and
    ``CostOfDelay``.

    Args:
        ahead: L, steps.

    Raises:
        InputError: fewer than one step.
    """

    needs = (linear_cost,)

    def __init__(self, ahead: int) -> None:
        self.ahead = check_int("ahead", ahead, 1)
        self.name = f"gain:{self.ahead}"

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        super().begin(system, num_envs, rng)
        known = linear_cost(system)
        self._weights = horizon_weights(known.F, known.weights, self.ahead)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``. Raises an InputError where the belief has no covariance."""
        if not hasattr(belief, "covariance"):
            raise impossible(self.name, self.system, "its belief has no single covariance")
        count, chunk = len(belief.step), max(1, BELIEFS // len(self.candidates))
        values = np.empty((count, len(self.candidates)))
        for start in range(0, count, chunk):
            part = np.arange(start, min(start + chunk, count))
            predicted = self.system.predict(trees.take(belief, part), self.candidates[None])
            values[part] = weighted(predicted.covariance, self._weights)
        return self.candidates[np.argmin(values if mask is None else np.where(mask, values, np.inf), axis=1)]


def weighted(covariance: Array, M: Array) -> Array:
    """trace(M P) summed over the targets, (env, candidate), of covariances (env, candidate[, target], n, n)."""
    products = covariance * M
    return products.reshape(*products.shape[:2], -1).sum(axis=2)
