"""A short list of actions that promise a low cost one step ahead; an agent picks one by its rank."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from wavegym.core.action_sets import ParameterBox, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.core.policy import decision_makers
from wavegym.core.shortcuts import best_action
from wavegym.core.system import ObservationField, System
from wavegym.core.traits import UnequalSteps

SEVERAL = (PerSensorLibrary, ParameterBox)  # action sets of which an action has several elements
EQUAL = 1e-9  # relative difference of costs that are equal but for rounding
NEAR = (0.02, 0.1)  # in a box, to either side of the best point along each parameter


class Listed(NamedTuple):
    """The list of each environment, the best action first.

    Attributes:
        actions: (env, rank, ...).
        allowed: (env, rank) bool. Ranks beyond the allowed actions hold the best one again.
    """

    actions: Array
    allowed: Array


class Shortlist:
    """The choice of the one-step scheduler, and the ``count`` - 1 other candidates of least expected cost.

    The candidates of a library are all its actions. Those of several sensors, or of a box, differ from that choice at
    one sensor: there they have any waveform or, in a box, any point of the system's grid. In a box one parameter may
    also be a little larger or smaller, and a candidate may cost less than the choice: the scheduler's search in a box
    does not find its least point.

    Args:
        system: the closed loop.
        count: length of the list, >= 1; the number of candidates if that is less.

    Raises:
        InputError: ``count`` is no integer >= 1, or the steps of the system differ in length.
    """

    def __init__(self, system: System, count: int) -> None:
        if isinstance(system, UnequalSteps):
            wanted = "forecasts=True, which shows all actions: the costs of steps of unequal length do not compare"
            raise InputError(f"candidates is {count!r} in {type(system).__name__}, expected {wanted}")
        self._system, self._candidates = system, system.candidates()
        self._masked = type(system).mask is not System.mask
        self._changes = _changes(system, self._candidates) if isinstance(system.actions, SEVERAL) else None
        most = len(self._candidates) if self._changes is None else 1 + len(self._changes.replaces)
        self.count = min(check_int("candidates", count, 1), most)
        self._last: tuple[Any, Any] = (None, None)  # a belief and its list

    @property
    def fields(self) -> tuple[ObservationField, ...]:
        """What an observation tells of each listed action: its point in the box, or its place in each library."""
        actions, meaning = self._system.actions, "the action, from -1 to 1"
        if isinstance(actions, ParameterBox):
            return tuple(ObservationField(p.name, "1", 0.0, 1.0, meaning) for p in actions.parameters)
        sensors = actions.sensors if isinstance(actions, PerSensorLibrary) else 1
        return tuple(ObservationField(f"place_{i + 1}", "1", 0.0, 1.0, meaning) for i in range(sensors))

    def described(self, actions: Array) -> Array:
        """The values of ``fields``, (env, rank, field), of listed actions."""
        known = self._system.actions
        if isinstance(known, ParameterBox):
            return actions
        return 2.0 * actions.reshape(*actions.shape[:2], -1) / max(len(known.labels) - 1, 1) - 1.0

    def __call__(self, belief: Any) -> Listed:
        """The list at ``belief``. An observation and the step after it ask for the same: it is computed once."""
        known, listed = self._last
        if known is not belief:
            listed = self._listed(belief)
            self._last = belief, listed
        return listed

    def _listed(self, belief: Any) -> Listed:
        rows = np.arange(len(belief.step))[:, None]
        if self._changes is not None:
            best = self._best(belief)[:, None]
            candidates = np.concatenate([best, self._changes.of(best)], axis=1)
            ranked = _first_then_cheapest(self._costs(belief, candidates))
            actions = candidates[rows, ranked[:, : self.count]]
            return Listed(actions, np.ones(actions.shape[:2], np.bool_))
        costs = self._costs(belief, np.broadcast_to(self._candidates, (len(rows), len(self._candidates))))
        if self._masked:
            costs = np.where(self._system.mask(belief), costs, np.inf)
        ranked = costs.argsort(axis=1, kind="stable")[:, : self.count]
        allowed = np.isfinite(costs[rows, ranked])
        return Listed(self._candidates[np.where(allowed, ranked, ranked[:, :1])], allowed)

    def _costs(self, belief: Any, candidates: Array) -> Array:
        return self._system.cost(self._system.predict(belief, candidates))

    def taken(self, belief: Any, ranks: Array) -> Array:
        """The actions (env, ...) of ``ranks`` (env,) in the list at ``belief``. Raises an InputError beyond its end."""
        if ((ranks < 0) | (ranks >= self.count)).any():
            raise InputError(f"ranks are {ranks.min()} to {ranks.max()}, expected indices in [0, {self.count - 1}]")
        return self(belief).actions[np.arange(len(ranks)), ranks]

    def _best(self, belief: Any) -> Array:
        """The choice of the one-step scheduler, (env, ...)."""
        if search := best_action.of(self._system):
            with suppress(NotImplementedError):
                return search(belief)
        ahead = self._system.predict(belief, self._candidates[None])
        return self._candidates[self._system.cost(ahead).argmin(axis=1)]


def _first_then_cheapest(costs: Array) -> Array:
    """Candidates (env, candidate): the first, then by cost; at the end all but the first of each cost.

    Copies of an action would fill the list, and settings that make no difference now, such as a larger field of view
    than needed.
    """
    rows = np.arange(len(costs))[:, None]
    first, key = costs[:, :1], costs.copy()
    key[:, 0] = -np.inf
    ranked = key.argsort(axis=1, kind="stable")
    ordered = costs[rows, ranked]
    repeated = np.isclose(ordered, first, rtol=EQUAL, atol=0.0)
    repeated[:, 1:] |= np.isclose(ordered[:, 1:], ordered[:, :-1], rtol=EQUAL, atol=0.0)
    repeated[:, 0] = False
    return ranked[rows, repeated.argsort(axis=1, kind="stable")]


class Changes(NamedTuple):
    """Changes of an action: what each replaces, and by what, (change, element); in a box also what it adds."""

    replaces: Array
    values: Array
    shifts: Array | None

    def of(self, actions: Array) -> Array:
        """The changed actions, (env, change, element), of actions (env, 1, element)."""
        changed = np.where(self.replaces, self.values, actions)
        return changed if self.shifts is None else np.clip(changed + self.shifts, -1.0, 1.0)


def _changes(system: System, candidates: Array) -> Changes:
    """One sensor's part of a candidate in place of one's own; in a box also steps along one parameter."""
    actions, width = system.actions, candidates.shape[1]
    replaces, values = [], []
    for n, maker in enumerate(decision_makers(system)):
        own = [n]
        if isinstance(actions, ParameterBox):
            own = [actions.names.index(name) for name in maker.parameters]
        part = np.unique(candidates[:, own], axis=0)
        where = np.zeros((len(part), width), np.bool_)
        where[:, own] = True
        rows = np.zeros((len(part), width), candidates.dtype)
        rows[:, own] = part
        replaces.append(where)
        values.append(rows)
    if not isinstance(actions, ParameterBox):
        return Changes(np.concatenate(replaces), np.concatenate(values), None)
    steps = np.concatenate([sign * near * np.eye(width) for near in NEAR for sign in (-1.0, 1.0)])
    none = np.zeros_like(steps)
    shifts = np.concatenate([*(np.zeros(rows.shape) for rows in values), steps])
    return Changes(np.concatenate([*replaces, none > 0.0]), np.concatenate([*values, none]), shifts)


def shortlist(system: System, count: int | None) -> Shortlist | None:
    """The list; None without a ``count``, or where a list of ``count`` would hold every action of a library.

    Raises:
        InputError: see ``Shortlist``.
    """
    if count is None:
        return None
    listed = Shortlist(system, count)
    whole = not isinstance(system.actions, SEVERAL) and listed.count == len(system.candidates())
    return None if whole else listed
