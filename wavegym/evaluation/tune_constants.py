"""Tune the constants of every heuristic and record them with the package.

python -m wavegym.evaluation.tune_constants ID ...
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import wavegym.schedulers
from wavegym.core import trees
from wavegym.core.command_line import Parser, guarded
from wavegym.core.system import System
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.evaluation.files import write_whole
from wavegym.evaluation.task import make_task
from wavegym.schedulers.heuristics.registry import HEURISTICS, best_simple
from wavegym.schedulers.heuristics.tuning import log_cost
from wavegym.schedulers.registry import PLANNERS, PLANS, planner_builder
from wavegym.schedulers.tuned_constants import BASE, FILE, PLANNER, SIMPLE, as_toml, record_key

WORLDS, PLANNED = 100, 32


def tuned_record(system: System, worlds: Any, planners: Sequence[str], before: dict[str, Any]) -> dict[str, Any]:
    """The record of one system: heuristics tuned and compared on tuning worlds, and planners based on the best one.

    Args:
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world.
        planners: names of the planners to choose the best one from; without names the recorded one stays.
        before: the present record, with the planners' settings.

    Returns:
        The best heuristic, the best planner, planners' settings and each heuristic's constants. ``costs``: geometric
        means over all worlds of the heuristics' mean costs per step. ``planner_costs``: the same of planners over the
        first PLANNED worlds, relative to the best heuristic's.
    """
    _, constants, found_costs = best_simple(system, worlds)
    costs = {name: _rounded(log) for name, log in found_costs.items()}
    best = min(costs, key=lambda name: costs[name])  # of equal costs, to the digits recorded, the first
    kept: dict[str, Any] = {name: before[name] for name in (PLANNER, BASE, *PLANNERS, *PLANS) if name in before}
    few = trees.first(worlds, PLANNED)
    base = kept.get(BASE, best)
    floor = log_cost(system, HEURISTICS[best].make(**constants[best]), few)
    found: dict[str, float] = {}
    for name in planners:
        settings = before.get(name.partition(":")[0], {})
        planner = planner_builder(name)(HEURISTICS[base].make(**constants[base]), **settings)
        found[name] = _rounded(log_cost(system, planner, few) - floor)
        print(f"{type(system).__name__}: {name} {found[name]:g}", flush=True)
    chosen: dict[str, Any] = (
        {PLANNER: min(found, key=lambda name: found[name]), "planner_costs": found} if found else {}
    )
    return {SIMPLE: best, **kept, **chosen, **constants, "costs": costs}


def _rounded(log: float) -> float:
    return float(f"{np.exp(log):.4g}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Tune, compare and write."""
    parser = Parser(
        prog="python -m wavegym.evaluation.tune_constants", description="Tune every rule and record its constants."
    )
    parser.add_argument("ids", nargs="+", metavar="ID", help="environments, such as CameraSlew-v0")
    parser.add_argument("--worlds", type=int, default=WORLDS, help=f"tuning worlds (default: {WORLDS})")
    parser.add_argument("--seed", type=int, default=0, help="of the tuning worlds (default: 0)")
    parser.add_argument(
        "--planners", default="", help="choose the best planner of these, such as rollout:10,rollout:20"
    )
    parser.add_argument("--out", type=Path, default=Path(wavegym.schedulers.__path__[0]) / FILE, help="file to write")
    read = parser.read(arguments)
    planners = [name for name in read.planners.split(",") if name]
    for name in planners:
        planner_builder(name)
    table = as_table(read.out) if read.out.exists() else {}
    systems = [make_task(env_id, {}).system for env_id in read.ids]
    for system in systems:
        name, worlds = record_key(system), draw_worlds(system, world_seeds(read.seed, "tune", read.worlds))
        record = table[name] = tuned_record(system, worlds, planners, table.get(name, {}))
        ranking = sorted(record["costs"].items(), key=lambda item: item[1])
        print(f"{name}: best simple is {record[SIMPLE]}; " + ", ".join(f"{rule} {cost:g}" for rule, cost in ranking))
        write_whole(read.out.parent, {read.out.name: as_toml(table).encode()})


def as_table(file: Path) -> dict[str, dict[str, Any]]:
    """The records in a file."""
    return tomllib.loads(file.read_text(encoding="utf-8"))


if __name__ == "__main__":
    sys.exit(guarded(main))
