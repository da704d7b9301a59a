"""Tuning of the constants of heuristics, on tuning worlds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from tqdm import tqdm

from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.schedulers.rollout import rollout

Constants = dict[str, Any]
Grid = Mapping[str, Sequence[Any]]

BUDGET = 150  # rollouts


def log_cost(system: System, policy: Policy, worlds: Any) -> float:
    """Mean over worlds of the logarithm of the mean cost per step; infinite where that is not finite.

    Policies are compared by geometric means of paired ratios, and constants are tuned for the same quantity: a world
    with high costs counts no more than another.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        mean = float(np.log(rollout(system, policy, worlds).mean_cost).mean())
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
