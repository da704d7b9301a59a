"""The heuristics by name, each with the grid over which its constants are tuned, and where tuning starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wavegym.core.shortcuts import constants
from wavegym.core.system import System
from wavegym.core.traits import DwellRule
from wavegym.schedulers.heuristics.band_rules import (
    Claim,
    MultiObjective,
    SenseAndAvoid,
    SenseAndHold,
    Thompson,
    UpperConfidence,
)
from wavegym.schedulers.heuristics.base import Heuristic, PolicyAsHeuristic
from wavegym.schedulers.heuristics.cma_search import Interval
from wavegym.schedulers.heuristics.index_policies import AwareGreedy, CostOfDelay, Gain, Greedy, HoldUntilDetected
from wavegym.schedulers.heuristics.price_policies import (
    AdaptiveLagrangianPrice,
    ClearSlotPrice,
    ConstantPace,
    LagrangianPrice,
)
from wavegym.schedulers.heuristics.rule_features import RuleFeatures
from wavegym.schedulers.heuristics.searched_rule import SearchedRule
from wavegym.schedulers.heuristics.timeline_rules import (
    DelayIndex,
    EarliestDeadline,
    FrameGreedy,
    GainPerSecond,
    PriceOfTime,
    RoundRobinSearch,
    SearchedDwell,
    VanKeukBlackman,
)
from wavegym.schedulers.heuristics.weighted_myopic import WeightedMyopic, own_weights
from wavegym.schedulers.myopic import Myopic
from wavegym.schedulers.simple import Cycle
from wavegym.schedulers.tuning import BUDGET, Constants, Grid

AHEAD = (1, 2, 3, 4, 6, 8, 10, 12, 14, 17, 20, 25)
FAR = (1, 2, 4, 6, 8, 11, 14, 20, 25, 32, 40, 60)  # for accounts that must last
CLEAR_SLOT = {"price": 100.0, "power": 1.0, "cushion": 1.0, "ahead": 4.0, "reach": 1.0, "scale": 0.0}
TIMELINE_WORLDS = 16  # an episode has thousands of dwells
FEW_WORLDS = 16  # for a heuristic that predicts to the episode's end, or searches a box
DWELLS = tuple(range(4))  # numbers of the dwells of a slot or sector
POWERS = (0.0, 0.25, 0.5, 0.75, 1.0)  # of the value of a find
WORTH = (0.25, 0.5, 1.0, 1.4, 2.0, 3.0, 4.0, 6.0, 9.0)


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
        fresh: each generation of CMA-ES draws other worlds, as many; for constants that few worlds would decide.
    """

    make: Callable[..., Heuristic]
    grid: Grid
    start: Constants
    worlds: int | None = None
    budget: int = BUDGET
    also: tuple[Constants, ...] = ()
    intervals: Mapping[str, Interval] = field(default_factory=dict)
    fresh: bool = False


def _cycle(actions: Any) -> Heuristic:
    return PolicyAsHeuristic(Cycle(np.asarray(actions)))


def _myopic() -> Heuristic:
    return PolicyAsHeuristic(Myopic())


TIMELINE_RULES: tuple[tuple[Any, Grid, Constants], ...] = (
    (
        RoundRobinSearch,
        {"share": (0.2, 0.35, 0.5, 0.65, 0.8), "update": DWELLS, "search": DWELLS},
        {"share": 0.5, "update": 2, "search": 2},
    ),
    (
        EarliestDeadline,
        {
            "revisit": (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0),
            "confirm": (0.0, 0.1, 0.2, 0.5),
            "update": DWELLS,
            "search": DWELLS,
        },
        {"revisit": 1.0, "confirm": 0.1, "update": 2, "search": 2},
    ),
    (
        VanKeukBlackman,
        {
            "pointing": (0.02, 0.035, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4),
            "snr": (5.0, 10.0, 20.0, 40.0, 80.0),
            "confirm": (0.0, 0.1, 0.2, 0.5),
            "search": DWELLS,
        },
        {"pointing": 0.2, "snr": 20.0, "confirm": 0.1, "search": 2},
    ),
    (GainPerSecond, {"worth": WORTH, "power": POWERS}, {"worth": 0.5, "power": 0.75}),
    (
        PriceOfTime,
        {"worth": WORTH, "power": POWERS, "price": (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 20.0)},
        {"worth": 0.5, "power": 0.75, "price": 2.0},
    ),
    (
        DelayIndex,
        {"worth": WORTH, "power": POWERS, "later": (0.1, 0.3, 1.0), "kappa": (0.0, 0.25, 0.5, 0.75)},
        {"worth": 0.5, "power": 0.75, "later": 0.3, "kappa": 0.25},
    ),
    (
        FrameGreedy,
        {"worth": WORTH, "power": POWERS, "frame": (0.1, 0.15, 0.2, 0.3, 0.5, 0.8)},
        {"worth": 0.5, "power": 0.75, "frame": 0.2},
    ),
)
STEPS_HEARD = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
BAND_RULES: dict[str, TunableHeuristic] = {
    SenseAndAvoid.name: TunableHeuristic(SenseAndAvoid, {}, {}),
    SenseAndHold.name: TunableHeuristic(
        SenseAndHold,
        {"window": STEPS_HEARD, "keep": tuple(range(8)), "widest": tuple(range(1, 9))},
        {"window": 2, "keep": 1, "widest": 8},
        also=({"window": 4, "keep": 0, "widest": 2},),
    ),
    Claim.name: TunableHeuristic(
        Claim,
        {"width": tuple(range(1, 9)), "patience": (1, 2, 3, 4, 6, 8), "window": STEPS_HEARD},
        {"width": 2, "patience": 2, "window": 8},
    ),
    MultiObjective.name: TunableHeuristic(
        MultiObjective,
        {"weight": (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0), "window": STEPS_HEARD},
        {"weight": 0.5, "window": 1},
        also=({"weight": 0.7, "window": 12},),
    ),
    Thompson.name: TunableHeuristic(Thompson, {"window": STEPS_HEARD}, {"window": 8}),
    UpperConfidence.name: TunableHeuristic(
        UpperConfidence,
        {"window": STEPS_HEARD, "optimism": (0.0, 0.25, 0.5, 1.0, 1.5, 2.0)},
        {"window": 8, "optimism": 0.5},
    ),
}
SEARCHED_DWELL = DwellRule(worth=0.35, power=1.0)._asdict()
SEARCHED_DWELL_INTERVALS = {
    "long": Interval(-1.0, 1.0),
    "tentative": Interval(-0.5, 2.0),
    "worth": Interval(0.1, 20.0, is_log=True),
    "power": Interval(0.0, 1.5),
    "long_search": Interval(-1.0, 1.0),
    "far": Interval(-1.0, 2.0),
    "age": Interval(-1.0, 0.5),
}
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
        fresh=True,
        intervals=SEARCHED_DWELL_INTERVALS,
    ),
    **BAND_RULES,
    WeightedMyopic.name: TunableHeuristic(WeightedMyopic, {}, {}, worlds=FEW_WORLDS),
    SearchedRule.name: TunableHeuristic(SearchedRule, {}, {}),
}
SEARCHED = tuple(  # those whose constants CMA-ES finds
    name for name, rule in HEURISTICS.items() if rule.intervals or name in (WeightedMyopic.name, SearchedRule.name)
)
