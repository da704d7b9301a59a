"""The constants of each heuristic in each system: recorded for the suite's defaults, tuned on demand elsewhere."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import resources
from typing import Any, NamedTuple

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.core.files import toml_key, toml_value
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.schedulers.cycle import best_dwell
from wavegym.schedulers.heuristics.base import Heuristic
from wavegym.schedulers.heuristics.cma_search import Budget, constants_on_fresh_worlds, searched_constants
from wavegym.schedulers.heuristics.grids import HEURISTICS, SEARCHES, TunableHeuristic
from wavegym.schedulers.heuristics.searched_rule import SearchedRule, search_rule
from wavegym.schedulers.heuristics.weighted_myopic import WeightedMyopic, search_weights
from wavegym.schedulers.rollout import allowed, check_equal_steps
from wavegym.schedulers.tuning import Constants, log_cost, log_costs, tuned

FILE = "tuned_constants.toml"
SIMPLE, PLANNER = "best-simple", "best-planner"
BASE = "planner-base"  # the heuristic that planners follow in simulated futures, where it is not the best one
DEFAULT_PLANNER = "rollout:10"  # for a system without a record
FRESH, GENERATIONS = 1_000_001, 10_000  # first seed of fresh worlds, after generation -1; most generations of a search
MOST = 50_000  # beliefs predicted in an episode, so that tuning "gain" takes a reasonable time


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


QUICK = Search()


class Simple(NamedTuple):
    """Every heuristic that a system admits, tuned and compared."""

    best: str
    constants: dict[str, Constants]
    costs: dict[str, float]  # ``log_cost`` on all worlds
    searches: dict[str, dict[str, Any]]  # evaluations, CPU seconds and worlds of those that CMA-ES found


@cache
def records() -> dict[str, dict[str, Any]]:
    """Everything recorded, by ``record_key``."""
    table: dict[str, dict[str, Any]] = tomllib.loads((resources.files("wavegym.schedulers") / FILE).read_text("utf-8"))
    return table


def record_key(system: System | type) -> str:
    """``"package.module:Class"``: a class of the same name in another module has a different record, or none."""
    kind = system if isinstance(system, type) else type(system)
    return f"{kind.__module__}:{kind.__qualname__}"


def recorded(system: System) -> dict[str, Any]:
    """The record of this system's class if the system has the class's default parameters; else an empty dictionary.

    ``truth`` does not count, because schedulers do not know it.
    """
    with suppress(TypeError, ValueError):  # a class without defaults
        if record_key(system) in records() and system.belief_model == type(system)():
            return records()[record_key(system)]
    return {}


def tuned_heuristic(name: str, system: System, worlds: Any) -> Heuristic:
    """The heuristic ``name``, or "best-simple", with recorded constants, or else with constants tuned on ``worlds``.

    Args:
        name: one of ``HEURISTICS``, or "best-simple".
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world; used only where nothing is recorded.

    Raises:
        InputError: the heuristic cannot be computed for this system.
    """
    record, system = recorded(system), system.belief_model
    if name == SIMPLE and SIMPLE in record:
        name = record[SIMPLE]
    elif name == SIMPLE:
        found = best_simple(system, worlds)
        return HEURISTICS[found.best].make(**found.constants[found.best])
    constants = record[name] if name in record else tune_heuristic(name, system, worlds)
    return HEURISTICS[name].make(**constants)


def planner_name(system: System) -> str:
    """The name of the best planner: as recorded, or ``DEFAULT_PLANNER``."""
    name: str = recorded(system).get(PLANNER, DEFAULT_PLANNER)
    return name


def as_toml(table: Mapping[str, Mapping[str, Any]]) -> str:
    """The records as the text of a TOML file: strings, numbers, flags, lists, and one more level of tables."""
    lines = ["# Constants of heuristics, found on tuning worlds by: python -m wavegym.evaluation.tune_constants"]
    for system in sorted(table):
        entries = table[system]
        lines += ["", f"[{toml_key(system)}]"]
        lines += [f"{toml_key(key)} = {toml_value(value)}" for key, value in entries.items()]
    return "\n".join(lines) + "\n"


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
    if heuristic.fresh:
        return _tuned_on_fresh_worlds(heuristic, system, search, min(search.worlds, len(trees.leaves(worlds)[0])))
    if heuristic.intervals:
        few, budget = trees.first(worlds, most), search.budget()

        def cost(constants: Constants) -> float:
            return log_cost(system, heuristic.make(**constants), few)

        found, _ = searched_constants(cost, heuristic.intervals, starts, budget, search.seed)
        return found, _spent(budget.evaluations, budget.used, most)
    few = trees.first(worlds, heuristic.worlds)
    ends = [tuned(heuristic.make, heuristic.grid, start, system, few, heuristic.budget) for start in starts]
    return min(ends, key=lambda end: end[1])[0], {}


def _tuned_on_fresh_worlds(
    heuristic: TunableHeuristic, system: System, search: Search, count: int
) -> tuple[Constants, dict[str, Any]]:
    """The constants, what CMA-ES spent, and by how many per cent they beat the start on further worlds, with its error.

    Each generation draws ``count`` tuning worlds that no other has, nor the table of costs.
    """
    budget = search.budget()

    def costs(generation: int, constants: Constants) -> Array:
        seeds = world_seeds(FRESH + GENERATIONS * search.seed + generation, "tune", count)
        return log_costs(system, heuristic.make(**constants), draw_worlds(system, seeds))

    found, gained = constants_on_fresh_worlds(costs, heuristic.intervals, heuristic.start, budget, search.seed)
    error = 100.0 * float(gained.std(ddof=1)) / math.sqrt(len(gained))
    against = {"percent": round(100.0 * float(gained.mean()), 2), "standard_error": round(error, 2)}
    return found, {**_spent(budget.evaluations, budget.used, count), **against}


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
