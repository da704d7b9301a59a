"""Schedulers of O'Rourke and Swindlehurst: the most information of which every target has its share, and SLSQP.

The paper maximises the sum over targets of tr(P C' R~^-1 C), P the predicted covariance and R~ the penalised variances,
where every target's term is at least t and the settings stay in their box (section IV). Its steps are those of
sequential quadratic programming (SLSQP); a grid needs no start and no gradient.

Source: S. M. O'Rourke and A. L. Swindlehurst, "Adaptive RF/EO sensing with field-of-view constraints".
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from scipy.optimize import minimize

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.capabilities import MostInformation
from wavegym.core.errors import InputError, check_choice, check_int
from wavegym.core.parameter_box import ParameterBox
from wavegym.core.system import System
from wavegym.schedulers.myopic import Myopic, impossible, require

STEP = 1e-6  # of an action in [-1, 1], to either side, for a gradient
SLACK = 1e-6  # relative: SLSQP aims so far above the threshold, because it stops a rounding short of what it aims at
OPTIONS = {"maxiter": 100, "ftol": 1e-9}  # a logarithm's: 1e-9 of the objective
OBJECTIVES = {"trace": "myopic", "information": "myopic-information"}  # and their schedulers' names


class InfeasibleThreshold(UserWarning):
    """No settings give every target its share of information; the scheduler then gives the worst-off target most."""


class MyopicInformation:
    """The paper's scheduler on a grid: the most information one step ahead of which every target has the share t.

    For systems with ``most_information(public) -> (actions (env, ...), feasible (env,))``, ``information(public,
    actions) -> (env, target)`` and ``threshold``, which is t. Where t cannot be had the worst-off target gets most, and
    an ``InfeasibleThreshold`` says so, once for a batch of episodes.

    Attributes:
        feasible: (env,) bool, whether t could be had at the last decision.
    """

    feasible: Array

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError for a system without ``most_information``."""
        require("myopic-information", system, MostInformation)
        self._system: Any = system
        self._warned = False

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        actions, self.feasible = self._system.most_information(belief)
        if not self._warned and not self.feasible.all():
            self._warned = True
            _warn(self._system, self._system.information(belief, actions), self.feasible)
        return actions


class Continuous:
    """The least trace, or the most information, over a box of actions by SLSQP.

    For systems with ``action="box"``, of any penalty but the hard one, whose steps have no slope to follow. SLSQP finds
    the local optimum next to where it starts: the grid's choice or, as the paper has it, drawn points. The logarithm of
    the objective is searched, because costs span decades. The best point evaluated is chosen, so it is never worse than
    a start. ``objective="information"``: as for ``MyopicInformation``, with its warning.

    Args:
        objective: "trace", the system's cost one step ahead, or "information".
        starts: how many starts to draw from the box; 0: none, but the grid's choice. They are drawn once for a batch
            of episodes, so that a decision depends on nothing but the belief.

    Attributes:
        feasible: (env,) bool, of "information": whether t could be had at the last decision.

    Raises:
        InputError: an unknown objective, fewer than 0 starts.
    """

    feasible: Array

    def __init__(self, objective: str = "trace", starts: int = 0) -> None:
        self.objective, self.starts = check_choice("objective", objective, OBJECTIVES), check_int("starts", starts, 0)

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError for a hard penalty, another action form, or no ``most_information``."""
        name = f"{OBJECTIVES[self.objective]}:{'slsqp' if self.starts else 'polish'}"
        if self.objective == "information":
            require(name, system, MostInformation)
        self._system: Any = system
        if not isinstance(system.actions, ParameterBox):
            raise InputError(f"policy {name!r} is not for {type(system).__name__} in this form, expected action='box'")
        if getattr(system, "penalty", None) == "hard":
            raise impossible(name, system, "its hard penalty has no slope to follow")
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
            starts = self._system.most_information(belief)[0][:, None]
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
    """SLSQP for one environment, ``belief`` (1,); values, constraints and all their differences come from one call.

    Attributes:
        best: (d,), of all points evaluated the one that lacks least of the threshold, of those the best.
        lacking: by how much its worst-off target's log information is below log t; 0 where none is.
    """

    def __init__(self, system: Any, belief: Any, threshold: float | None) -> None:
        self._system, self._public, self._threshold = system, belief, threshold
        self.best, self.lacking, self._least = np.empty(0), np.inf, np.inf
        self._at = np.empty(0)

    def run(self, start: Array) -> None:
        """One search from ``start`` (d,); what lacks of the threshold there comes first."""
        bounds = [(-1.0, 1.0)] * len(start)
        if self._threshold and self._look(start)[2].min(initial=np.inf) < 0.0:
            start = self._lift(start, bounds)
        over = {"type": "ineq", "fun": lambda x: self._look(x)[2] - SLACK, "jac": lambda x: self._look(x)[3]}
        constraints = over if self._threshold else ()
        minimize(
            lambda x: self._look(x)[:2], start, method="SLSQP", jac=True, bounds=bounds, constraints=constraints,
            options=OPTIONS
        )  # fmt: skip

    def _lift(self, start: Array, bounds: list[tuple[float, float]]) -> Array:
        """Where the worst-off target has the threshold, or most: the greatest z below every target's constraint."""
        down = -np.eye(len(start) + 1)[-1]
        least = self._look(start)[2].min()
        above = {
            "type": "ineq",
            "fun": lambda y: self._look(y[:-1])[2] - y[-1],
            "jac": lambda y: np.column_stack([self._look(y[:-1])[3], np.full(len(self._look(y[:-1])[2]), -1.0)]),
        }
        found = minimize(
            lambda y: (-y[-1], down), np.append(start, least), method="SLSQP", jac=True,
            bounds=[*bounds, (None, 2.0 * SLACK)], constraints=above, options=OPTIONS
        )  # fmt: skip
        return np.clip(found.x[:-1], -1.0, 1.0)

    def _look(self, x: Array) -> tuple[float, Array, Array, Array]:
        """Value and gradient (d,), constraints (target,) and theirs (target, d); what was asked last is kept."""
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
        """What is minimised (m,), and log information above log t (m, target), of points (m, d)."""
        if self._threshold is None:
            value = np.log(self._system.cost(self._system.predict(self._public, points[None]))[0])
            over, lacking = np.zeros((len(points), 0)), np.zeros(len(points))
        else:
            information = np.maximum(self._system.information(self._public, points[None])[0], np.finfo(float).tiny)
            value = -np.log(information.sum(axis=1))
            over = np.log(information) - np.log(self._threshold or 1.0)
            lacking = -np.minimum(over.min(axis=1), 0.0) * (self._threshold > 0.0)
        first = np.lexsort((value, lacking))[0]
        if (lacking[first], value[first]) < (self.lacking, self._least):
            self.best, self.lacking, self._least = points[first].copy(), float(lacking[first]), float(value[first])
        return value, over


def _warn(system: Any, information: Array, feasible: Array) -> None:
    """``information`` (env, target) of what was chosen."""
    share = information.min(axis=1)[~feasible]
    what = f"threshold is {system.threshold:g}, not reached in {len(share)} of {len(feasible)} environments"
    told = f"{what}, where the worst-off target gets most (nearest that all reach: {share.min():.3g})"
    warnings.warn(told, InfeasibleThreshold, stacklevel=3)
