"""The constants of rules, found on worlds that are for tuning."""

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
    """Mean over worlds of the logarithm of the mean cost per step; infinite where that is no finite number.

    Policies are compared by geometric means of paired ratios, so this is what constants are tuned for: no world counts
    more because its costs are high.
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
        make: the policy of given constants.
        grid: values of each constant.
        start: where the descent starts.
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world.
        budget: rollouts.

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
