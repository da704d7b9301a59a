"""The constants of each heuristic in each system: recorded for the suite's defaults, tuned on demand elsewhere."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import resources
from typing import Any

from wavegym.core.system import System
from wavegym.core.toml import toml_key, toml_value
from wavegym.schedulers.heuristics.base import Heuristic
from wavegym.schedulers.heuristics.registry import HEURISTICS, best_simple, tune_heuristic

FILE = "tuned_constants.toml"
SIMPLE, PLANNER = "best-simple", "best-planner"
BASE = "planner-base"  # the heuristic that planners follow in simulated futures, where it is not the best one
DEFAULT_PLANNER = "rollout:10"  # for a system without a record


@cache
def records() -> dict[str, dict[str, Any]]:
    """Everything recorded, by ``record_key``."""
    table: dict[str, dict[str, Any]] = tomllib.loads((resources.files("wavegym.schedulers") / FILE).read_text("utf-8"))
    return table


def record_key(system: System) -> str:
    """``"package.module:Class"``: a class of the same name in another module has a different record, or none."""
    return f"{type(system).__module__}:{type(system).__qualname__}"


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
        tuned = best_simple(system, worlds)
        return HEURISTICS[tuned.best].make(**tuned.constants[tuned.best])
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
