"""The heuristics by name, each with the grid over which its constants are tuned."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.errors import InputError
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.schedulers.heuristics.base import Heuristic, PolicyAsHeuristic
from wavegym.schedulers.heuristics.dwell import best_dwell
from wavegym.schedulers.heuristics.hold_until_detected import HoldUntilDetected
from wavegym.schedulers.heuristics.index_policies import AwareGreedy, CostOfDelay, Greedy
from wavegym.schedulers.heuristics.l_step import Gain
from wavegym.schedulers.heuristics.price_policies import AdaptiveLagrangianPrice, ConstantPace, LagrangianPrice
from wavegym.schedulers.heuristics.tuning import BUDGET, Constants, Grid, log_cost, tuned
from wavegym.schedulers.myopic import Myopic
from wavegym.schedulers.rollout import allowed
from wavegym.schedulers.simple import Cycle

AHEAD = (1, 2, 3, 4, 6, 8, 10, 12, 14, 17, 20, 25)
FAR = (1, 2, 4, 6, 8, 11, 14, 20, 25, 32, 40, 60)  # for accounts that must last
MOST = 50_000  # beliefs predicted in an episode, so that tuning "gain" takes a reasonable time
FEW_WORLDS = 16  # for a heuristic that predicts to the episode's end


@dataclass(frozen=True)
class TunableHeuristic:
    """A heuristic with the search for its constants.

    Args:
        make: makes the heuristic from its constants.
        grid: values of each constant.
        start: the constants from which tuning starts.
        worlds: largest number of tuning worlds; None for all.
        budget: rollouts of each descent.
        also: starts of further descents.
    """

    make: Callable[..., Heuristic]
    grid: Grid
    start: Constants
    worlds: int | None = None
    budget: int = BUDGET
    also: tuple[Constants, ...] = ()


def _cycle(actions: Any) -> Heuristic:
    return PolicyAsHeuristic(Cycle(np.asarray(actions)))


def _myopic() -> Heuristic:
    return PolicyAsHeuristic(Myopic())


HEURISTICS: dict[str, TunableHeuristic] = {
    "myopic": TunableHeuristic(_myopic, {}, {}),
    "cycle": TunableHeuristic(_cycle, {}, {}),
    "gain": TunableHeuristic(Gain, {"ahead": AHEAD}, {"ahead": 4}),
    "greedy": TunableHeuristic(Greedy, {"ahead": AHEAD}, {"ahead": 4}),
    "aware-greedy": TunableHeuristic(
        AwareGreedy,
        {"kappa": (0.0, 0.2, 0.4, 0.8, 1.2, 1.6, 2.0, 2.5, 3.0, 4.0, 6.0, 8.0, 12.0), "ahead": AHEAD},
        {"kappa": 0.4, "ahead": 4},
    ),
    "cost-of-delay": TunableHeuristic(
        CostOfDelay,
        {
            "alpha": (0.0, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0),
            "later": (1, 2, 3, 4, 6, 9, 12),
            "ahead": AHEAD,
            "power": (0.0, 0.4, 0.7, 1.0, 1.3, 1.6, 2.0),
            "bonus": (0.0, 0.1, 0.2, 0.3, 0.5, 0.8),
        },
        {"alpha": 0.2, "later": 4, "ahead": 10, "power": 1.3, "bonus": 0.2},
        also=({"alpha": 0.5, "later": 1, "ahead": 8, "power": 1.0, "bonus": 0.0},),
    ),
    "hold-until-detected": TunableHeuristic(HoldUntilDetected, {"ahead": (1, 2, 3, 4, 5, 6, 7, 8, 10)}, {"ahead": 4}),
    "lagrangian-price": TunableHeuristic(
        LagrangianPrice,
        {
            "price": tuple(float(f"{price:.3g}") for price in 10.0 ** np.arange(-2.0, 7.05, 0.1)),
            "ahead": FAR,
            "power": (0.0, 0.5, 1.0, 1.5, 2.0, 3.0),
        },
        {"price": 1.0, "ahead": 4, "power": 0.0},
        budget=500,
        also=({"price": 501.0, "ahead": 8, "power": 1.0},),
    ),
    "adaptive-lagrangian-price": TunableHeuristic(
        AdaptiveLagrangianPrice,
        {"ahead": (4, 8, 14, 25, 40), "thrift": (0.8, 1.0, 1.25)},
        {"ahead": 8, "thrift": 1.0},
        FEW_WORLDS,
        12,
    ),
    "constant-pace": TunableHeuristic(
        ConstantPace, {"ahead": FAR, "share": (0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 5.0, 8.0)}, {"ahead": 4, "share": 1.0}
    ),
}


def tune_heuristic(name: str, system: System, worlds: Any) -> Constants:
    """The constants of the heuristic ``name``, found on ``worlds``.

    Raises:
        InputError: the heuristic cannot be computed for this system.
    """
    heuristic = HEURISTICS[name]
    if name == "cycle":
        return {"actions": best_dwell(system, worlds).tolist()}
    check(name, system, worlds)
    few = trees.first(worlds, heuristic.worlds)
    starts = (heuristic.start, *heuristic.also)
    ends = [tuned(heuristic.make, heuristic.grid, start, system, few, heuristic.budget) for start in starts]
    return min(ends, key=lambda end: end[1])[0]


def check(name: str, system: System, worlds: Any) -> None:
    """Raise an InputError where the heuristic ``name`` cannot be computed, or not be tuned in reasonable time."""
    if name == "cycle":
        return
    if name == "gain" and len(system.candidates()) * system.horizon > MOST:
        wanted = f"at most {MOST} beliefs predicted in an episode (nearest: 'gain:L')"
        raise InputError(
            f"heuristic 'gain' tries {len(system.candidates())} candidates at each step, expected {wanted}"
        )
    policy: Policy = HEURISTICS[name].make(**HEURISTICS[name].start)
    belief = system.initial(trees.first(worlds, 1)).belief
    policy.begin(system, 1, np.random.default_rng(0))
    policy.act(belief, None, allowed(system, belief))


def best_simple(system: System, worlds: Any) -> tuple[str, dict[str, Constants], dict[str, float]]:
    """Every heuristic that the system admits, tuned on ``worlds`` and compared there.

    Returns:
        The name of the best heuristic, the constants of all, and the ``log_cost`` of all.
    """
    constants, costs = {}, {}
    for name, heuristic in HEURISTICS.items():
        try:
            constants[name] = tune_heuristic(name, system, worlds)
        except (InputError, NotImplementedError):
            continue
        costs[name] = log_cost(system, heuristic.make(**constants[name]), worlds)
    return min(costs, key=lambda name: costs[name]), constants, costs
