"""Schedulers by the names that command lines and summaries use."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.errors import InputError, check_choice, check_int
from wavegym.core.policy import Policy
from wavegym.core.registry import Registry
from wavegym.core.shortcuts import innovation_covariance
from wavegym.core.system import System
from wavegym.schedulers.closed_form import MyopicClosedForm
from wavegym.schedulers.constrained import Continuous, MyopicInformation
from wavegym.schedulers.cycle import best_cycle
from wavegym.schedulers.heuristics.grids import HEURISTICS
from wavegym.schedulers.heuristics.index_policies import Gain
from wavegym.schedulers.lookahead import Lookahead
from wavegym.schedulers.myopic import Myopic, Progressive, impossible, require
from wavegym.schedulers.optimum import Optimum
from wavegym.schedulers.planners.mcts import MonteCarloTree
from wavegym.schedulers.planners.receding_horizon import PlanOnce, RecedingHorizon
from wavegym.schedulers.planners.rollout import BeamSearch, DwellRollout, RolloutPlanner, TreeSearch
from wavegym.schedulers.simple import Cycle, Fixed, RandomChoice, RoundRobin, constant_action
from wavegym.schedulers.tuned_constants import BASE, PLANNER, SIMPLE, planner_name, recorded, tuned_heuristic
from wavegym.schedulers.tuning import best_constant, best_fixed


def make_policy(name: str, system: System, tuning_worlds: Any, base: Policy | None = None) -> Policy:
    """The scheduler called ``name``.

    Args:
        name: one of ``MEANINGS``, with a number or a name in place of its capital letter (``lookahead:3``); or of a
            scheduler registered with ``wavegym.register_scheduler``. Heuristics have the constants recorded for the
            suite's systems (``schedulers.tuned_constants``), or else are tuned on ``tuning_worlds``. A planner
            improves on the base policy recorded (``best-simple`` unless another is), or on the scheduler after an
            ``@``: ``rollout:20@myopic``.
        system: the closed loop.
        tuning_worlds: tapes, axis 0 = world, that are not those of the test.
        base: base policy of a planner, in place of the recorded one or the one after an ``@``.

    Raises:
        InputError: an unknown or renamed name, an invalid number or NAME in it, or a scheduler that is not for this
            system. ``wavegym.evaluation.compare`` plays ``baselines``, which have their own parameters.
    """
    check_not_renamed("policy", name.partition("@")[0])
    family, _, argument = name.partition(":")
    if family == "fixed":
        return _fixed(name, argument, system)
    if family == "myopic-margin":
        return _ready(Myopic(margin=_decimal(name, family, argument)), system)
    if family in NUMBERED:
        return NUMBERED[family](_integer(name, family, argument))
    if _is_planner(name):
        return _planner(name, system, tuning_worlds, base)
    if name not in SCHEDULERS:
        loops = shortcuts.baselines(system)
        if check_choice("policy", name, dict.fromkeys((*MEANINGS, *SCHEDULERS.names(), *loops))) in loops:
            scheduler, changed = loops[name]
            raise InputError(f"policy is {name!r}, expected a scheduler (nearest: {scheduler!r} with {changed})")
    policy = SCHEDULERS.get(name)(system, tuning_worlds)
    if not isinstance(policy, Policy):
        raise InputError(f"scheduler {name!r} made {policy!r}, expected a Policy with begin and act")
    return policy


def is_scheduler(name: str) -> bool:
    """Whether ``name`` is a scheduler's (or was, before it was renamed) rather than, say, a folder's."""
    families = "fixed", "myopic-margin", *NUMBERED
    is_known = name.partition(":")[0] in families or name.partition("@")[0] in RENAMED
    return is_known or _is_planner(name) or name in SCHEDULERS


def _is_planner(name: str) -> bool:
    planner = name.partition("@")[0]
    return planner.partition(":")[0] in (*PLANNERS, *PLANS)


def check_not_renamed(what: str, name: str) -> None:
    """Raise an InputError that gives the present name of a scheduler that was renamed."""
    if name in RENAMED:
        raise InputError(f"{what} is {name!r}, which is called {RENAMED[name]!r} now")


def _fixed(name: str, argument: str, system: System) -> Policy:
    """Looked up at once: a mistake shows before anything is tuned."""
    is_name = bool(shortcuts.named_constants(system)) and not INTEGER.fullmatch(argument)
    if not is_name and argument in _named_in_box(system):
        raise InputError(f"policy is {name!r}, which is a point of the box, expected an index or action='box'")
    constant = argument if is_name else _integer(name, "fixed", argument)
    constant_action(system, constant)
    return Fixed(constant)


def _named_in_box(system: Any) -> dict[str, Any]:
    """The named constants that the system would have with ``action="box"``."""
    if getattr(system, "action", "box") == "box" or not dataclasses.is_dataclass(system):
        return {}
    with suppress(ValueError):  # a system without that form; pydantic's errors and ours are ValueErrors
        boxed: Any = dataclasses.replace(system, action="box")  # type: ignore[type-var]
        return dict(shortcuts.named_constants(boxed))
    return {}


def _integer(name: str, family: str, argument: str) -> int:
    if not INTEGER.fullmatch(argument):
        number = float(argument) if re.fullmatch(r"-?\d*\.?\d+", argument) else 2
        wanted = f"{family}: and an integer (nearest: '{family}:{round(number)}')"
        raise InputError(f"policy is {name!r}, expected {wanted}")
    return int(argument)


def _decimal(name: str, family: str, argument: str) -> float:
    if not DECIMAL.fullmatch(argument):
        nearest = 0 if DECIMAL.fullmatch(argument.removeprefix("-")) else 2
        raise InputError(f"policy is {name!r}, expected {family}: and a number >= 0 (nearest: '{family}:{nearest}')")
    return float(argument)


def _ready(policy: Policy, system: System) -> Policy:
    """The policy, begun once: an unfit system shows before anything is played."""
    policy.begin(system, 1, np.random.default_rng(0))
    return policy


def _determinant(system: System, worlds: Any) -> Policy:
    if not hasattr(system.initial(worlds).belief, "covariance"):
        raise impossible("myopic:determinant", system, "its belief has no single covariance")
    return Myopic("determinant")


def _gate(system: System, worlds: Any) -> Policy:
    require("myopic:gate", system, innovation_covariance)
    return Myopic("gate")


def _heuristic(name: str) -> Callable[[System, Any], Policy]:
    return lambda system, worlds: _ready(tuned_heuristic(name, system, worlds), system)


def _planner(name: str, system: System, worlds: Any, base: Policy | None) -> Policy:
    """A planner and its base; the planner's name is checked before anything is tuned."""
    planner, at, followed = name.partition("@")
    build, record = planner_builder(planner), recorded(system)
    if base is None and at:
        base = make_policy(followed, system, worlds)
    elif base is None:
        base = tuned_heuristic(record.get(BASE, SIMPLE), system, worlds)
    return build(base, **record.get(planner.partition(":")[0], {}))


def planner_builder(name: str) -> Callable[..., Policy]:
    """The function that makes the planner ``name`` from a base policy and settings.

    Raises:
        InputError: no such planner, or a number after the colon that is no integer >= 1.
    """
    family, _, argument = name.partition(":")
    if family in PLANS:
        return PLANS[check_choice("planner", name, PLANS)]
    make, number = PLANNERS[check_choice("planner", family, PLANNERS)], _integer(name, family, argument)
    check_int(f"{family}:", number, 1)
    return lambda base, **settings: make(base, number, **settings)


INTEGER, DECIMAL = re.compile(r"-?\d+"), re.compile(r"\d+\.?\d*|\.\d+")
STARTS = 8  # of SLSQP
NUMBERED: dict[str, Callable[[int], Policy]] = {"lookahead": Lookahead, "gain": Gain}
PLANNERS: dict[str, Callable[..., Policy]] = {  # of a base, and the number after the colon
    "rollout": RolloutPlanner,
    "tree": TreeSearch,
    "beam": BeamSearch,
    "mcts": MonteCarloTree,
    "dwell-rollout": DwellRollout,  # the number: of futures for each candidate
}
PLANS: dict[str, Callable[..., Policy]] = {"receding-horizon": RecedingHorizon, "plan-once": PlanOnce}
PLAIN: dict[str, Callable[[System, Any], Policy]] = {  # of a system, and of worlds for tuning
    "random": lambda system, worlds: RandomChoice(),
    "round-robin": lambda system, worlds: RoundRobin(),
    "best-fixed": lambda system, worlds: Fixed(best_fixed(system, worlds)),
    "tuned-constant": lambda system, worlds: Cycle(best_constant(system, worlds)[None]),
    "tuned-cycle": lambda system, worlds: Cycle(best_cycle(system, worlds)),
    "myopic": lambda system, worlds: Myopic(),
    "myopic:exhaustive": lambda system, worlds: Myopic(fused=False),
    "myopic:determinant": _determinant,
    "myopic:gate": _gate,
    "myopic:mean-trace": lambda system, worlds: Myopic("mean-trace"),
    "myopic:closed-form": lambda system, worlds: MyopicClosedForm(),
    "myopic:progressive": lambda system, worlds: Progressive(),
    "myopic:slsqp": lambda system, worlds: _ready(Continuous(starts=STARTS), system),
    "myopic:polish": lambda system, worlds: _ready(Continuous(), system),
    "myopic-information": lambda system, worlds: _ready(MyopicInformation(), system),
    "myopic-information:slsqp": lambda system, worlds: _ready(Continuous("information", STARTS), system),
    "myopic-information:polish": lambda system, worlds: _ready(Continuous("information"), system),
    "optimum": lambda system, worlds: Optimum(),
    **{name: _heuristic(name) for name in (*HEURISTICS, SIMPLE) if name not in ("myopic", "gain")},
    PLANNER: lambda system, worlds: make_policy(planner_name(system), system, worlds),
}
SCHEDULERS: Registry[Callable[[System, Any], Policy]] = Registry("scheduler", PLAIN)
MEANINGS = {  # of every name; a capital letter stands for a number or a name
    "random": "an action drawn uniformly from those allowed",
    "round-robin": "every constant action in turn",
    "fixed:K": "the constant action K at every step",
    "fixed:NAME": "the constant action that the system calls NAME",
    "best-fixed": "the best constant action on tuning worlds",
    "tuned-constant": "the best constant action; in a box, improved by a local search",
    "tuned-cycle": "the best cycle of one to three actions that a search on tuning worlds finds",
    "myopic": "the least predicted cost one step ahead: the scheduler of the papers",
    "myopic:exhaustive": "myopic, found by trying every action",
    "myopic:determinant": "the least determinant of the predicted covariance",
    "myopic:gate": "the least volume of the validation gate",
    "myopic:mean-trace": "the least trace of all tracks, whatever their existence",
    "myopic:closed-form": "myopic in closed form, for Gaussian chirps in a box",
    "myopic:progressive": "myopic, one sensor after the other, for chirps in a box",
    "myopic:slsqp": "myopic in a box, by gradients from 8 drawn points",
    "myopic:polish": "myopic in a box, by gradients from the best point of a grid",
    "myopic-information": "the most information at which every target has the system's threshold",
    "myopic-information:slsqp": "myopic-information in a box, by gradients from 8 drawn points",
    "myopic-information:polish": "myopic-information in a box, by gradients from the best point of a grid",
    "myopic-margin:M": "myopic, with predictions M standard deviations inside the field of view",
    "lookahead:H": "the least predicted cost over H steps",
    "optimum": "no scheduler but a lower bound: it knows the future of the world",
    "weighted-myopic": "one step ahead, with searched weights on the elements of the state",
    "gain:L": "the least cost of the next L steps, without further measurements",
    "greedy": "the greatest gain, delays ignored",
    "aware-greedy": "the greatest gain, divided by a function of the delay",
    "cost-of-delay": "the greatest loss if the pulse is postponed",
    "hold-until-detected": "the greatest gain until the target can be measured again",
    "lagrangian-price": "the greatest gain less a constant price of energy",
    "adaptive-lagrangian-price": "the greatest gain less the price of energy at which it just lasts",
    "constant-pace": "the greatest gain at a constant rate of spending",
    "clear-slot-price": "the greatest gain less a price of energy by the clear slots left",
    "cycle": "the best cycle of dwells that a search on tuning worlds finds",
    "searched-rule": "a heuristic linear in forecasts, with searched weights",
    "round-robin-search": "for a time line: the oldest track and the next sector in turn",
    "earliest-deadline": "for a time line: the most overdue track, else a search",
    "van-keuk-blackman": "for a time line: a track with an uncertain azimuth, else a search",
    "gain-per-second": "for a time line: the greatest gain per second",
    "price-of-time": "for a time line: the greatest gain less the price of its time",
    "delay-index": "for a time line: the greatest loss by a delay",
    "frame-greedy": "for a time line: a frame of dwells, by marginal gain per second",
    "searched-dwell": "for a time line: the greatest score of a searched formula",
    "sense-and-avoid": "in a shared band: the widest band that was clear in the last step",
    "sense-and-hold": "in a shared band: the widest band that was clear for some steps, with hysteresis",
    "claim": "in a shared band: one band, held until it was occupied for some steps",
    "multi-objective-sensing": "in a shared band: the greatest weighted sum of log SINR and log bandwidth",
    "thompson": "in a shared band: myopic, with a drawn probability of an occupied channel",
    "ucb": "in a shared band: myopic, with an optimistic probability of an occupied channel",
    SIMPLE: "the best of the tuned heuristics and of myopic",
    "rollout:H": "planner: each action, then the base policy, in sampled futures of H steps",
    "tree:H": "planner: sequences of H actions, then the base policy",
    "beam:W": "planner: beam search that keeps W sequences",
    "mcts:N": "planner: Monte-Carlo tree search with N simulated futures",
    "receding-horizon": "planner: a plan of many steps, improved at every step",
    "plan-once": "planner: a plan of the whole episode, made at its beginning",
    "dwell-rollout:N": "planner for a time line: N futures of the dwells of the greatest score",
    PLANNER: "the planner recorded as the best",
}
RENAMED = {  # yesterday's name: today's
    "until-seen": "hold-until-detected",
    "priced": "lagrangian-price",
    "adaptive-price": "adaptive-lagrangian-price",
    "paced": "constant-pace",
    "replan": "receding-horizon",
}
