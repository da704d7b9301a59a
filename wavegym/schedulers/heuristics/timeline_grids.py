"""The constants of the rules for one beam on a time line: where tuning starts, and the values that it tries."""

from __future__ import annotations

from typing import Any

from wavegym.schedulers.heuristics.cma_search import Interval
from wavegym.schedulers.heuristics.frame_greedy import FrameGreedy
from wavegym.schedulers.heuristics.timeline_rules import (
    DelayIndex,
    EarliestDeadline,
    GainPerSecond,
    PriceOfTime,
    RoundRobinSearch,
    VanKeukBlackman,
)
from wavegym.schedulers.heuristics.tuning import Constants, Grid

DWELLS = tuple(range(4))  # numbers of the dwells of a slot or sector
AHEAD = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)
WORTH = (0.25, 0.5, 1.0, 1.4, 2.0, 3.0, 4.0, 6.0, 9.0)
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
            "pointing": (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4),
            "snr": (5.0, 10.0, 20.0, 40.0, 80.0),
            "confirm": (0.0, 0.1, 0.2, 0.5),
            "search": DWELLS,
        },
        {"pointing": 0.2, "snr": 20.0, "confirm": 0.1, "search": 2},
    ),
    (GainPerSecond, {"ahead": AHEAD, "worth": WORTH}, {"ahead": 0.5, "worth": 1.0}),
    (
        PriceOfTime,
        {"ahead": AHEAD, "worth": WORTH, "price": (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 20.0)},
        {"ahead": 0.5, "worth": 1.0, "price": 2.0},
    ),
    (
        DelayIndex,
        {"ahead": AHEAD, "worth": WORTH, "later": (0.1, 0.3, 1.0), "kappa": (0.0, 0.25, 0.5, 0.75)},
        {"ahead": 0.5, "worth": 2.0, "later": 0.3, "kappa": 0.25},
    ),
    (
        FrameGreedy,
        {"ahead": AHEAD, "worth": WORTH, "frame": (0.1, 0.15, 0.2, 0.3, 0.5, 0.8)},
        {"ahead": 0.5, "worth": 1.0, "frame": 0.2},
    ),
)
SEARCHED_DWELL = {
    "ahead": 0.5,
    "later": 3.0,
    "far": 0.0,
    "tentative": 0.0,
    "long": 0.0,
    "worth": 1.0,
    "long_search": 0.0,
    "load": 0.0,
}
SEARCHED_DWELL_INTERVALS = {
    "ahead": Interval(0.1, 1.5, is_log=True),
    "later": Interval(1.0, 6.0, is_log=True),
    "far": Interval(0.0, 1.0),
    "tentative": Interval(-2.0, 4.0),
    "long": Interval(-0.7, 0.7),
    "worth": Interval(0.1, 20.0, is_log=True),
    "long_search": Interval(-0.7, 0.7),
    "load": Interval(-1.0, 1.0),
}
