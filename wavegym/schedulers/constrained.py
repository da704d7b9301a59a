"""Schedulers of O'Rourke and Swindlehurst: the most information with a threshold for every target, and SLSQP.

The paper maximises the sum over targets of tr(P C' R~^-1 C), with P the predicted covariance and R~ the penalised
variances. Every target's term must be at least t, and the settings stay in their box (section IV). The paper uses
sequential quadratic programming (SLSQP). A grid needs neither a start nor a gradient.

Source: S. M. O'Rourke and A. L. Swindlehurst, "Adaptive RF/EO sensing with field-of-view constraints".
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from scipy.optimize import minimize

from wavegym.core import trees
from wavegym.core.action_sets import ParameterBox
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_choice, check_int
from wavegym.core.shortcuts import most_information
from wavegym.core.system import System
from wavegym.schedulers.myopic import Myopic, impossible, require

STEP = 1e-6  # of an action in [-1, 1], to either side, for central differences
SLACK = 1e-6  # relative: SLSQP stops a rounding error below its constraint, so the constraint is this much above t
OPTIONS = {"maxiter": 100, "ftol": 1e-9}  # of a logarithm: 1e-9 of the objective
OBJECTIVES = {"trace": "myopic", "information": "myopic-information"}  # objective: name of the scheduler


class InfeasibleThreshold(UserWarning):
    """No settings reach the threshold for every target; the scheduler then maximises the least information."""


class MyopicInformation:
    """The paper's scheduler on a grid: the most information one step ahead, at least t for every target.

    For systems that have ``most_information``, whose ``threshold`` is t. Where t cannot be reached, the least
    information of a target is maximised; an ``InfeasibleThreshold`` warns of this once for a batch of episodes.

    Attributes:
        feasible: (env,) bool, whether t was reached at the last decision.
    """

    feasible: Array

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError for a system without ``most_information``."""
        require("myopic-information", system, most_information)
        self._system: Any = system
        self._warned = False

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        actions, self.feasible = most_information(self._system, belief)
        if not self._warned and not self.feasible.all():
            self._warned = True
            _warn(self._system, self._system.information(belief, actions), self.feasible)
        return actions


class Continuous:
    """The least trace, or the most information, over a box of actions by SLSQP.

    For systems with ``action="box"`` and any penalty except the hard one, which has no gradient. SLSQP finds the local
    optimum near its start: the grid's choice or, as in the paper, drawn points. It searches the logarithm of the
    objective, because costs span decades. The best point evaluated is chosen, so the choice is never worse than a
    start. ``objective="information"`` has the threshold and the warning of ``MyopicInformation``.

    Args:
        objective: "trace", the system's cost one step ahead, or "information".
        starts: number of starts drawn from the box; 0 starts at the grid's choice. They are drawn once for a batch of
            episodes, so that a decision depends on the belief alone.

    Attributes:
        feasible: (env,) bool, with "information": whether t was reached at the last decision.

    Raises:
        InputError: an unknown objective, fewer than 0 starts.
    """

    feasible: Array

    def __init__(self, objective: str = "trace", starts: int = 0) -> None:
        self.objective, self.starts = check_choice("objective", objective, OBJECTIVES), check_int("starts", starts, 0)

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError for a hard penalty, another action set, or no ``most_information``."""
        name = f"{OBJECTIVES[self.objective]}:{'slsqp' if self.starts else 'polish'}"
        if self.objective == "information":
            require(name, system, most_information)
        self._system: Any = system
        if not isinstance(system.actions, ParameterBox):
            raise InputError(f"policy {name!r} is not for {type(system).__name__} in this form, expected action='box'")
        if getattr(system, "penalty", None) == "hard":
            raise impossible(name, system, "its hard penalty has no gradient")
        self._drawn = rng.uniform(-1.0, 1.0, (self.starts, len(system.actions)))
        self._grid, self._warned = Myopic(), False
        if not self.starts and self.objective == "trace":
            self._grid.begin(system, num_envs, rng)

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        count = len(belief.step)
        if self.starts:
            starts = np.broadcast_to(self._drawn, (count, *self._drawn.shape))
        elif self.objective == "trace":
            starts = self._grid.act(belief, observation, mask)[:, None]
        else:
            starts = most_information(self._system, belief)[0][:, None]
        rows = (trees.take(belief, np.array([e])) for e in range(count))
        searches = [self._search(row, own) for row, own in zip(rows, starts, strict=True)]
        if self.objective == "information":
            self.feasible = np.array([search.lacking == 0.0 for search in searches])
            if not self._warned and not self.feasible.all():
                self._warned = True
                share = self._system.information(belief, np.stack([search.best for search in searches]))
                _warn(self._system, share, self.feasible)
        return np.stack([search.best for search in searches])

    def _search(self, belief: Any, starts: Array) -> _Search:
        threshold = self._system.threshold if self.objective == "information" else None
        search = _Search(self._system, belief, threshold)
        for start in starts:
            search.run(start)
        return search


class _Search:
    """SLSQP for one environment, ``belief`` (1,); one call evaluates values, constraints and their differences.

    Attributes:
        best: (d,), of all points evaluated the one closest to the threshold; of equals the one of least value.
        lacking: by how much the least log information of a target at ``best`` is below log t; 0 if none is.
    """

    def __init__(self, system: Any, belief: Any, threshold: float | None) -> None:
        self._system, self._belief, self._threshold = system, belief, threshold
        self.best, self.lacking, self._least = np.empty(0), np.inf, np.inf
        self._at = np.empty(0)

    def run(self, start: Array) -> None:
        """One search from ``start`` (d,); a start below the threshold is first moved towards it."""
        bounds = [(-1.0, 1.0)] * len(start)
        if self._threshold and self._linearised(start)[2].min(initial=np.inf) < 0.0:
            start = self._lift(start, bounds)
        over = {
            "type": "ineq",
            "fun": lambda x: self._linearised(x)[2] - SLACK,
            "jac": lambda x: self._linearised(x)[3],
        }
        constraints = over if self._threshold else ()
        minimize(
            lambda x: self._linearised(x)[:2], start, method="SLSQP", jac=True, bounds=bounds, constraints=constraints,
            options=OPTIONS
        )  # fmt: skip

    def _lift(self, start: Array, bounds: list[tuple[float, float]]) -> Array:
        """Reach the threshold or maximise the least information: the greatest z under all constraints."""
        down = -np.eye(len(start) + 1)[-1]
        least = self._linearised(start)[2].min()
        above = {
            "type": "ineq",
            "fun": lambda y: self._linearised(y[:-1])[2] - y[-1],
            "jac": lambda y: np.column_stack(
                [self._linearised(y[:-1])[3], np.full(len(self._linearised(y[:-1])[2]), -1.0)]
            ),
        }
        found = minimize(
            lambda y: (-y[-1], down), np.append(start, least), method="SLSQP", jac=True,
            bounds=[*bounds, (None, 2.0 * SLACK)], constraints=above, options=OPTIONS
        )  # fmt: skip
        return np.clip(found.x[:-1], -1.0, 1.0)

    def _linearised(self, x: Array) -> tuple[float, Array, Array, Array]:
        """Value and gradient (d,), constraints (target,) and their gradients (target, d); cached for the last ``x``."""
        if not np.array_equal(x, self._at):
            self._at, count = x.copy(), len(x)
            steps = STEP * np.concatenate([np.zeros((1, count)), np.eye(count), -np.eye(count)])
            points = np.clip(np.clip(x, -1.0, 1.0) + steps, -1.0, 1.0)
            widths = np.diag(points[1 : count + 1] - points[count + 1 :])
            value, over = self._evaluate(points)
            slopes = [(a[1 : count + 1] - a[count + 1 :]).T / widths for a in (value, over)]
            self._found = float(value[0]), slopes[0], over[0], slopes[1]
        return self._found

    def _evaluate(self, points: Array) -> tuple[Array, Array]:
        """The value minimised (m,), and log information minus log t (m, target), of points (m, d)."""
        if self._threshold is None:
            cost = self._system.cost(self._system.predict(self._belief, points[None]))[0]
            value = np.log(np.maximum(cost, np.finfo(float).tiny))  # 0 where no target is in the scene
            over, lacking = np.zeros((len(points), 0)), np.zeros(len(points))
        else:
            information = np.maximum(self._system.information(self._belief, points[None])[0], np.finfo(float).tiny)
            value = -np.log(information.sum(axis=1))
            over = np.log(information) - np.log(self._threshold or 1.0)
            lacking = -np.minimum(over.min(axis=1), 0.0) * (self._threshold > 0.0)
        first = np.lexsort((value, lacking))[0]
        if (lacking[first], value[first]) < (self.lacking, self._least):
            self.best, self.lacking, self._least = points[first].copy(), float(lacking[first]), float(value[first])
        return value, over


def _warn(system: Any, information: Array, feasible: Array) -> None:
    """Warn that ``information`` (env, target) of the actions chosen is below the threshold where not ``feasible``."""
    share = information.min(axis=1)[~feasible]
    state = f"threshold is {system.threshold:g}, not reached in {len(share)} of {len(feasible)} environments"
    message = f"{state}, where the least information is maximised (nearest that all reach: {share.min():.3g})"
    warnings.warn(message, InfeasibleThreshold, stacklevel=3)
