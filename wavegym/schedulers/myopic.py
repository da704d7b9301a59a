"""One-step schedulers, as in the papers: over all candidates, or over progressively finer grids."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_choice, check_int, check_non_negative
from wavegym.core.shortcuts import Shortcut, sensor_by_sensor, why_not
from wavegym.core.system import System
from wavegym.core.traits import UnequalSteps

Objective = Callable[[Any, Any, Array], Array]  # (system, belief, candidates (1, c)) -> (env, c)


def trace(system: Any, belief: Any, candidates: Array) -> Array:
    """trace(Lambda P) after the update."""
    return system.cost(system.predict(belief, candidates))


def determinant(system: Any, belief: Any, candidates: Array) -> Array:
    """det P after the update; of several targets, the product.

    With Gaussian chirps of fixed energy det R is the same for all, so det P = det P^- det R / det S: minimising it
    *maximises* the validation gate and leads to the edge of the box. It is included because the literature uses it.
    """
    each = np.linalg.det(system.predict(belief, candidates).covariance)  # (env, candidate[, target])
    return each.reshape(*each.shape[:2], -1).prod(axis=2)


def gate_volume(system: Any, belief: Any, candidates: Array) -> Array:
    """det S, proportional to the squared volume of the validation gate (Kershaw & Evans 1994)."""
    return np.linalg.det(shortcuts.innovation_covariance(system, belief, candidates))


def mean_trace(system: Any, belief: Any, candidates: Array) -> Array:
    """Traces of all tracks in use after the update, summed: eq. (7) of Barbosa et al. times the number of tracks.

    That number is the same for all candidates. Where a track can be lost, the cost differs: there it weighs a track
    with its probability of existence. Where none can be lost, this is the cost.
    """
    return system.trace(system.predict(belief, candidates))


def gain_per_second(system: Any, belief: Any, candidates: Array) -> Array:
    """Minus the gain per second, which replaces the cost where steps differ in length."""
    return -shortcuts.gain_per_second(system, belief)[:, candidates[0]]


OBJECTIVES: dict[str, Objective] = {
    "trace": trace,
    "determinant": determinant,
    "gate": gate_volume,
    "mean-trace": mean_trace,
}


class Myopic:
    """The candidate with the least predicted objective one step ahead; the first of equals.

    The system's own search is used where it has ``best_action`` and nothing is masked. Otherwise, or where
    that search raises NotImplementedError (for a form of the action set, say), every candidate is tried.

    Args:
        objective: "trace" (the cost), "determinant", "gate" or "mean-trace", or a function of (system, belief,
            candidates).
        fused: whether the system's own search may be used.
        margin: number of standard deviations by which a prediction keeps targets inside the field of view, in place of
            the system's own.

    Raises:
        InputError: an unknown objective, a margin that is negative or not finite.
    """

    def __init__(self, objective: str | Objective = "trace", fused: bool = True, margin: float | None = None) -> None:
        if isinstance(objective, str):
            objective = OBJECTIVES[check_choice("objective", objective, OBJECTIVES)]
        self.objective: Objective = objective
        self.fused = fused
        self.margin = None if margin is None else check_non_negative("margin", margin)

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError where a margin is asked for and the system has none."""
        self._system: Any = system
        if self.margin is not None:
            if not hasattr(system, "margin"):
                raise impossible(f"myopic-margin:{self.margin:g}", system, "it has no margin")
            self._system = replace(system, margin=self.margin)  # type: ignore[call-arg]
        if self.objective is trace and isinstance(system, UnequalSteps):
            require("myopic", system, shortcuts.gain_per_second)
            self.objective = gain_per_second
        self._search = shortcuts.best_action.of(self._system) if self.fused and self.objective is trace else None
        self._candidates: Array | None = None  # computed on demand: the system's own search may not need them

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        if self._search and mask is None:
            with suppress(NotImplementedError):
                return self._search(belief)
        if self._candidates is None:
            self._candidates = self._system.candidates()
        values = self.objective(self._system, belief, self._candidates[None])
        return self._candidates[np.argmin(values if mask is None else np.where(mask, values, np.inf), axis=1)]


def require(name: str, system: System, kind: Shortcut[..., Any] | type) -> None:
    """Raise an InputError if the system lacks the shortcut or trait that the scheduler ``name`` needs."""
    why = why_not(system, kind)
    if why:
        raise impossible(name, system, why)


def impossible(name: str, system: System, why: str) -> InputError:
    """The error for a scheduler that is not for this system."""
    return InputError(f"policy {name!r} cannot be computed for {type(system).__name__}: {why}; nearest: 'myopic'")


class Progressive:
    """The chirps with the least predicted trace one step ahead (Sira et al., section 5).

    For every sensor in turn, and every phase law and direction, it searches a grid over log duration and log sweep.
    Finer grids around the best point follow, each up to the neighbours of this point. For systems that have
    ``sensor_by_sensor``, with ``action="box"``.

    Args:
        points: grid points per axis, at least 3.
        levels: number of grids, at least 1.

    Raises:
        InputError: too few points or levels.
    """

    def __init__(self, points: int = 5, levels: int = 3) -> None:
        self.points, self.levels = check_int("points", points, 3), check_int("levels", levels, 1)

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError for a system without chirps, or with another form of actions."""
        if not (sensor_by_sensor.of(system) and getattr(system, "action", None) == "box"):
            what = f"{type(system).__name__} with action={getattr(system, 'action', None)!r}"
            raise InputError(f"policy 'myopic:progressive' is not for {what}, expected chirps and action='box'")
        self._system: Any = system
        self._sensors = sensor_by_sensor(system)

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        system = self._system
        predicted, chosen = self._sensors.begin(belief), []
        for i in range(system.action_set.sensors):
            chirp, C, windows = self._search(predicted, i)
            chosen.append(chirp)
            if i + 1 < system.action_set.sensors:
                predicted = self._sensors.after(predicted, i, C, windows, np.zeros(len(C), np.int64))
        law, duration, sweep = (np.stack(parts, axis=1) for parts in zip(*chosen, strict=True))
        return system.action_set.encode_chirps(law, duration, sweep)

    def _search(self, predicted: Any, sensor: int) -> tuple[tuple[Array, Array, Array], Array, Array]:
        """The best chirp for one sensor, (env,) each of law, duration and signed sweep, its C (env, 2, 2) and receive
        window (env, 10).
        """
        action_set, count = self._system.action_set, len(predicted.mean)
        law = np.repeat(np.arange(len(action_set.laws)), 2)  # (group,)
        sign = np.tile([1.0, -1.0], len(action_set.laws))
        low = np.log([min(action_set.durations), min(action_set.sweeps)])
        width = np.log([max(action_set.durations), max(action_set.sweeps)]) - low
        centre = np.full((count, len(law), 2), 0.5)  # of each group's grid, in shares of the width
        axis = np.linspace(-0.5, 0.5, self.points)
        offsets = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)  # (point, 2)
        reach = 1.0
        rows = np.arange(count)
        for _ in range(self.levels):
            share = np.clip(centre[:, :, None] + reach * offsets, 0.0, 1.0)  # (env, group, point, 2)
            chirp = np.exp(low + width * share)
            sweeps = chirp[..., 1] * sign[:, None]
            laws = np.broadcast_to(law[:, None], sweeps.shape)
            C = action_set.chirp_covariance(laws, chirp[..., 0], sweeps)
            windows = action_set.chirp_windows(laws, chirp[..., 0], sweeps)
            flat = C.reshape(count, -1, 2, 2), windows.reshape(count, -1, windows.shape[-1])
            alarm = np.zeros(flat[0].shape[1], np.int64)  # boxes have one threshold
            cost = self._sensors.costs(predicted, sensor, *flat, alarm).reshape(sweeps.shape)
            best = cost.argmin(axis=2)
            centre = np.take_along_axis(share, best[:, :, None, None], axis=2)[:, :, 0]
            reach *= 2.0 / (self.points - 1)
        group = np.take_along_axis(cost, best[:, :, None], axis=2)[..., 0].argmin(axis=1)
        point = best[rows, group]
        found = law[group], chirp[rows, group, point, 0], sweeps[rows, group, point]
        return found, C[rows, group, point], windows[rows, group, point]
