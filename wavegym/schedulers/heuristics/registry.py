"""The heuristics by name, each with the grid over which its constants are tuned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from wavegym.core import trees
from wavegym.core.errors import InputError, check_int
from wavegym.core.policy import Policy
from wavegym.core.shortcuts import constants
from wavegym.core.system import System
from wavegym.schedulers.heuristics.base import Heuristic, PolicyAsHeuristic
from wavegym.schedulers.heuristics.clear_slots import ClearSlotPrice
from wavegym.schedulers.heuristics.cma_search import Budget, Interval, searched_constants
from wavegym.schedulers.heuristics.dwell import best_dwell
from wavegym.schedulers.heuristics.hold_until_detected import HoldUntilDetected
from wavegym.schedulers.heuristics.index_policies import AwareGreedy, CostOfDelay, Greedy
from wavegym.schedulers.heuristics.l_step import Gain
from wavegym.schedulers.heuristics.price_policies import AdaptiveLagrangianPrice, ConstantPace, LagrangianPrice
from wavegym.schedulers.heuristics.rule_features import RuleFeatures
from wavegym.schedulers.heuristics.searched_rule import SearchedRule, search_rule
from wavegym.schedulers.heuristics.timeline_grids import (
    SEARCHED_DWELL,
    SEARCHED_DWELL_INTERVALS,
    TIMELINE_RULES,
)
from wavegym.schedulers.heuristics.timeline_rules import SearchedDwell
from wavegym.schedulers.heuristics.tuning import BUDGET, Constants, Grid, log_cost, tuned
from wavegym.schedulers.heuristics.weighted_myopic import WeightedMyopic, own_weights, search_weights
from wavegym.schedulers.myopic import Myopic
from wavegym.schedulers.rollout import allowed, check_equal_steps
from wavegym.schedulers.simple import Cycle

AHEAD = (1, 2, 3, 4, 6, 8, 10, 12, 14, 17, 20, 25)
FAR = (1, 2, 4, 6, 8, 11, 14, 20, 25, 32, 40, 60)  # for accounts that must last
MOST = 50_000  # beliefs predicted in an episode, so that tuning "gain" takes a reasonable time
CLEAR_SLOT = {"price": 100.0, "power": 1.0, "cushion": 1.0, "ahead": 4.0, "reach": 1.0, "scale": 0.0}
TIMELINE_WORLDS = 16  # an episode has thousands of dwells
FEW_WORLDS = 16  # for a heuristic that predicts to the episode's end, or searches a box


@dataclass(frozen=True)
class TunableHeuristic:
    """A heuristic with the search for its constants.

    Args:
        make: makes the heuristic from its constants.
        grid: values of each constant; none where ``intervals`` are given, or where another search is made.
        start: the constants from which tuning starts.
        worlds: largest number of tuning worlds; None for all.
        budget: rollouts of each descent.
        also: starts of further descents.
        intervals: of constants that CMA-ES searches, from the best of ``start`` and ``also``.
    """

    make: Callable[..., Heuristic]
    grid: Grid
    start: Constants
    worlds: int | None = None
    budget: int = BUDGET
    also: tuple[Constants, ...] = ()
    intervals: Mapping[str, Interval] = field(default_factory=dict)


class Search(NamedTuple):
    """How CMA-ES searches the constants of a heuristic, each time anew.

    Attributes:
        evaluations: largest number of policies played; None for any number.
        seconds: CPU seconds; None for any number. With it the result depends on the machine.
        seed: of the random numbers, >= 0.
        worlds: largest number of worlds, the first of those for tuning.
    """

    evaluations: int | None = 300
    seconds: float | None = None
    seed: int = 0
    worlds: int = 64

    def budget(self) -> Budget:
        """A new budget. Raises an InputError for a number out of range."""
        return Budget(self.evaluations, self.seconds)


class Simple(NamedTuple):
    """Every heuristic that a system admits, tuned and compared."""

    best: str
    constants: dict[str, Constants]
    costs: dict[str, float]  # ``log_cost`` on all worlds
    searches: dict[str, dict[str, Any]]  # evaluations, CPU seconds and worlds of those that CMA-ES found


def _cycle(actions: Any) -> Heuristic:
    return PolicyAsHeuristic(Cycle(np.asarray(actions)))


def _myopic() -> Heuristic:
    return PolicyAsHeuristic(Myopic())


QUICK = Search()
SEARCHES: dict[str, Callable[[System], Any]] = {  # heuristics that have no constants to start from: what they need
    "cycle": constants,
    WeightedMyopic.name: own_weights,
    SearchedRule.name: RuleFeatures,
}
TIMELINE = (*(rule.name for rule, *_ in TIMELINE_RULES), SearchedDwell.name)  # for one beam on a time line
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
    "clear-slot-price": TunableHeuristic(
        ClearSlotPrice,
        {},
        CLEAR_SLOT,
        also=tuple({**CLEAR_SLOT, "price": float(f"{price:.3g}")} for price in np.geomspace(1.0, 1e5, 11)),
        intervals={
            "price": Interval(0.01, 1e7, is_log=True),
            "power": Interval(0.0, 4.0),
            "cushion": Interval(0.0, 20.0),
            "ahead": Interval(1.0, 40.0),
            "reach": Interval(0.0, 3.0),
            "scale": Interval(0.0, 1.5),
        },
    ),
    **{
        rule.name: TunableHeuristic(rule, grid, start, worlds=TIMELINE_WORLDS, budget=60)
        for rule, grid, start in TIMELINE_RULES
    },
    SearchedDwell.name: TunableHeuristic(
        SearchedDwell,
        {},
        SEARCHED_DWELL,
        worlds=TIMELINE_WORLDS,
        also=({**SEARCHED_DWELL, "ahead": 1.0, "worth": 2.0},),
        intervals=SEARCHED_DWELL_INTERVALS,
    ),
    WeightedMyopic.name: TunableHeuristic(WeightedMyopic, {}, {}, worlds=FEW_WORLDS),
    SearchedRule.name: TunableHeuristic(SearchedRule, {}, {}),
}
SEARCHED = tuple(  # those whose constants CMA-ES finds
    name for name, rule in HEURISTICS.items() if rule.intervals or name in (WeightedMyopic.name, SearchedRule.name)
)


def tune_heuristic(
    name: str, system: System, worlds: Any, search: Search = QUICK, reference: Policy | None = None
) -> Constants:
    """The constants of the heuristic ``name``, found on ``worlds``.

    Args:
        name: one of ``HEURISTICS``.
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world.
        search: for a heuristic whose constants CMA-ES finds.
        reference: the policy under which the scales of a searched rule are found; the one-step scheduler by default.

    Raises:
        InputError: the heuristic cannot be computed for this system.
    """
    return _tuned(name, system, worlds, search, reference)[0]


def _tuned(
    name: str, system: System, worlds: Any, search: Search, reference: Policy | None
) -> tuple[Constants, dict[str, Any]]:
    """The constants, and what CMA-ES spent on them, if it did."""
    heuristic = HEURISTICS[name]
    check(name, system, worlds)
    if name == "cycle":
        return {"actions": best_dwell(system, worlds).tolist()}, {}
    most = min(check_int("worlds", search.worlds, 1), heuristic.worlds or search.worlds)
    if name == SearchedRule.name:
        rule = search_rule(system, worlds, search.budget(), search.seed, reference, trees.first(worlds, most))
        return rule.constants, _spent(rule.evaluations, rule.cpu_seconds, most)
    if name == WeightedMyopic.name:
        budget = search.budget()
        weights = search_weights(system, trees.first(worlds, most), budget, search.seed)
        return weights, _spent(budget.evaluations, budget.used, most)
    starts = (heuristic.start, *heuristic.also)
    if heuristic.intervals:
        few, budget = trees.first(worlds, most), search.budget()

        def cost(constants: Constants) -> float:
            return log_cost(system, heuristic.make(**constants), few)

        found, _ = searched_constants(cost, heuristic.intervals, starts, budget, search.seed)
        return found, _spent(budget.evaluations, budget.used, most)
    few = trees.first(worlds, heuristic.worlds)
    ends = [tuned(heuristic.make, heuristic.grid, start, system, few, heuristic.budget) for start in starts]
    return min(ends, key=lambda end: end[1])[0], {}


def _spent(evaluations: int, seconds: float, worlds: int) -> dict[str, Any]:
    return {"evaluations": evaluations, "cpu_seconds": round(seconds, 1), "worlds": worlds}


def check(name: str, system: System, worlds: Any) -> None:
    """Raise an InputError where the heuristic ``name`` cannot be computed, or not be tuned in reasonable time."""
    if name in SEARCHES:
        check_equal_steps(f"heuristic {name!r}", system)
        SEARCHES[name](system)
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


def best_simple(
    system: System, worlds: Any, search: Search = QUICK, known: Mapping[str, Constants] | None = None
) -> Simple:
    """Every heuristic that the system admits, tuned on ``worlds`` and compared there.

    The searched rule comes last: the best of the others is the reference of its scales.

    Args:
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world.
        search: for heuristics whose constants CMA-ES finds.
        known: constants of heuristics that are not tuned again.
    """
    constants: dict[str, Constants] = {}
    costs: dict[str, float] = {}
    searches: dict[str, dict[str, Any]] = {}
    for name, heuristic in HEURISTICS.items():
        best = min(costs, key=lambda name: costs[name], default=None)
        reference = None if best is None else HEURISTICS[best].make(**constants[best])
        spent: dict[str, Any] = {}
        try:
            if known and name in known:
                constants[name] = known[name]
            else:
                constants[name], spent = _tuned(name, system, worlds, search, reference)
        except (InputError, NotImplementedError):
            continue
        costs[name] = log_cost(system, heuristic.make(**constants[name]), worlds)
        if spent:
            searches[name] = spent
    return Simple(min(costs, key=lambda name: costs[name]), constants, costs, searches)
