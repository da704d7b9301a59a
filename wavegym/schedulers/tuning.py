"""Tuning on tuning worlds, never on test worlds: constant actions, and the constants of heuristics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize
from tqdm import tqdm

from wavegym.core import shortcuts
from wavegym.core.action_sets import ParameterBox
from wavegym.core.arrays import Array
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.schedulers.rollout import rollout
from wavegym.schedulers.simple import Cycle, Fixed

POLISHING = 200  # rollouts of one polish, at most
TOLERANCE = 1e-3  # of an action in [-1, 1]: a simplex this small ends a polish
REACH = 0.2  # edge length of the first simplex
BUDGET = 150  # rollouts of a descent over a grid

Constants = dict[str, Any]
Grid = Mapping[str, Sequence[Any]]


def tuning_costs(system: System, policy: Policy, worlds: Any, groups: int = 1) -> Array:
    """Mean over worlds of the mean cost per step; infinite where that is not a finite number (a filter diverged).

    Args:
        system, policy, worlds: the closed loop, its policy, and the worlds to play on.
        groups: number of groups of equally many successive worlds; each group has its own mean.

    Returns:
        (groups,).
    """
    with np.errstate(over="ignore", invalid="ignore"):
        means = rollout(system, policy, worlds).mean_cost.reshape(groups, -1).mean(axis=1)
    return np.where(np.isfinite(means), means, np.inf)


def best_fixed(system: System, worlds: Any) -> int:
    """The constant of least cost when transmitted at every step; the first of equals.

    The constants are played one after another, each on all worlds as one batch: one rollout is in memory at a time.

    Args:
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world.

    Returns:
        Index into ``constants`` of the system.
    """
    constants = tqdm(range(len(shortcuts.constants(system))), "tuning best-fixed", disable=None, leave=False)
    return int(np.argmin([tuning_costs(system, Fixed(k), worlds) for k in constants]))


def best_constant(system: System, worlds: Any) -> Array:
    """The best constant action: that of ``best_fixed``, polished over the whole box where actions are a ParameterBox.

    Args:
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world.

    Returns:
        The action, (), (sensor,) or (d,).
    """
    start: Array = np.asarray(shortcuts.constants(system)[best_fixed(system, worlds)])
    if not isinstance(system.actions, ParameterBox):
        return start
    with tqdm(desc="tuning tuned-constant", total=POLISHING, disable=None, leave=False) as bar:

        def cost(actions: Array) -> float:
            bar.update()
            return float(tuning_costs(system, Cycle(actions), worlds)[0])

        return polished(cost, start[None])[0]


def polished(cost: Callable[[Array], float], start: Array) -> Array:
    """A local minimum of ``cost`` over a box, by Nelder and Mead's simplex, restarted until that gains nothing.

    The simplex only compares costs, so heavy tails and infinite costs do no harm. It reaches the faces of the box
    exactly, and the result is never worse than ``start``. Powell's bounded method stops before the faces: it took 471
    rollouts against 208 for three slots of KershawEvansPosition, and as many for a constant of RfEo inside the box.

    Args:
        cost: of points shaped as ``start``.
        start: point of [-1, 1]^d, any shape; returned as it is where its cost is infinite.

    Returns:
        The best point of at most ``POLISHING`` evaluations.
    """
    best, least, left = start.ravel(), cost(start), POLISHING - 1
    while left > best.size and np.isfinite(least):
        inward = np.where(best > 0.0, -REACH, REACH)
        options = {
            "initial_simplex": np.vstack([best, best + np.diag(inward)]),
            "xatol": TOLERANCE,
            "fatol": np.inf,
            "maxfev": left,
            "adaptive": True,
        }
        bounds = [(-1.0, 1.0)] * best.size
        found = minimize(
            lambda x: cost(x.reshape(start.shape)), best, method="Nelder-Mead", bounds=bounds, options=options
        )
        left -= found.nfev
        gained = found.fun < least
        best, least = found.x, found.fun
        if not gained:
            break
    return best.reshape(start.shape)


def log_costs(system: System, policy: Policy, worlds: Any) -> Array:
    """The logarithm of the mean cost per step in each world, (world,).

    Policies are compared by geometric means of paired ratios, and constants are tuned for the same quantity: a world
    with high costs counts no more than another.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return np.log(rollout(system, policy, worlds).mean_cost)


def log_cost(system: System, policy: Policy, worlds: Any) -> float:
    """Mean of ``log_costs``; infinite where that is not finite."""
    mean = float(log_costs(system, policy, worlds).mean())
    return mean if np.isfinite(mean) else np.inf


def tuned(
    make: Callable[..., Policy], grid: Grid, start: Constants, system: System, worlds: Any, budget: int = BUDGET
) -> tuple[Constants, float]:
    """Constants of a local minimum of ``log_cost`` over a grid, by coordinate descent.

    One constant at a time takes whichever value of its grid costs least, until a sweep over all of them improves
    nothing, or the budget is spent.

    Args:
        make: makes the policy from its constants.
        grid: values of each constant.
        start: constants at which the descent starts.
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world.
        budget: largest number of rollouts.

    Returns:
        The constants, and their ``log_cost``.
    """
    seen: dict[tuple[Any, ...], float] = {}
    with tqdm(desc=f"tuning {make.__name__}", total=budget, disable=None, leave=False) as bar:

        def cost(constants: Constants) -> float:
            key = tuple(constants[name] for name in grid)
            if key not in seen:
                if len(seen) >= budget:
                    return np.inf
                bar.update()
                seen[key] = log_cost(system, make(**constants), worlds)
            return seen[key]

        best, least, improving = dict(start), cost(dict(start)), True
        while improving:
            improving = False
            for name, values in grid.items():
                for trial in [{**best, name: value} for value in values]:
                    if cost(trial) < least:
                        best, least, improving = trial, cost(trial), True
    return best, least
