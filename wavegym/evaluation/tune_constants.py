"""The baselines of an environment: every heuristic tuned, a heuristic searched, planners swept; all on tuning worlds.

    python -m wavegym.evaluation.tune_constants ID ... --cpu-seconds 60 --sweep 300

Constants go to a TOML file, by default the suite's own record, and the sweep of planners to ``ID.csv``.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import wavegym.schedulers
from wavegym.core import trees
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError, check_choice, check_int, check_positive
from wavegym.core.files import write_whole
from wavegym.core.registry import import_package
from wavegym.core.system import System
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.evaluation.planner_sweep import LIMITS, Setting, Swept, as_csv, best_within, sweep
from wavegym.evaluation.play import make_task
from wavegym.schedulers.heuristics.grids import HEURISTICS, SEARCHED
from wavegym.schedulers.registry import PLANNERS, PLANS, planner_builder
from wavegym.schedulers.tuned_constants import (
    BASE,
    FILE,
    PLANNER,
    QUICK,
    SIMPLE,
    Search,
    Simple,
    as_toml,
    best_simple,
    record_key,
)
from wavegym.schedulers.tuning import Constants, log_cost

WORLDS, PLANNED = 100, 32
CPU_SECONDS, SEARCH_WORLDS, SWEEP_WORLDS = 60.0, 64, 16
BASES = 2  # best heuristics that planners of a sweep follow, beside the recorded base
SWEEPS = Path("results/baselines")
NONE = "none"  # in place of the name of a heuristic


def tuned_record(
    system: System,
    worlds: Any,
    planners: Sequence[str],
    before: dict[str, Any],
    search: Search = QUICK,
    only: Sequence[str] = (),
) -> dict[str, Any]:
    """The record of one system: heuristics tuned and compared on tuning worlds, and planners based on the best one.

    Args:
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world.
        planners: names of the planners to choose the best one from; without names the recorded one stays.
        before: the present record, with the planners' settings.
        search: for the heuristics whose constants CMA-ES finds.
        only: heuristics to tune; the constants of others stay as ``before``. Without names all are tuned.

    Returns:
        The best heuristic, the best planner, planners' settings and each heuristic's constants. ``costs``: geometric
        means over all worlds of the heuristics' mean costs per step. ``searches``: what CMA-ES spent on each heuristic.
        ``planner_costs``: the same of planners over the first PLANNED worlds, relative to the best heuristic's. A
        recorded planner keeps its base, ``planner-base``, if another heuristic has become the best.
    """
    known = {name: before[name] for name in HEURISTICS if only and name in before and name not in only}
    simple = best_simple(system, worlds, search, known)
    constants = simple.constants
    costs = {name: _rounded(log) for name, log in simple.costs.items()}
    best = min(costs, key=lambda name: costs[name])  # of equal costs, to the digits recorded, the first
    kept: dict[str, Any] = {name: before[name] for name in (PLANNER, BASE, *PLANNERS, *PLANS) if name in before}
    followed = before.get(BASE, before.get(SIMPLE, best))
    if PLANNER in kept and followed != best and followed in constants:
        kept[BASE] = followed
    few = trees.first(worlds, PLANNED)
    base = kept.get(BASE, best)
    floor = log_cost(system, HEURISTICS[best].make(**constants[best]), few) if planners else 0.0
    found: dict[str, float] = {}
    for name in planners:
        settings = before.get(name.partition(":")[0], {})
        planner = planner_builder(name)(HEURISTICS[base].make(**constants[base]), **settings)
        found[name] = _rounded(log_cost(system, planner, few) - floor)
        print(f"{type(system).__name__}: {name} {found[name]:g}", flush=True)
    chosen: dict[str, Any] = (
        {PLANNER: min(found, key=lambda name: found[name]), "planner_costs": found} if found else {}
    )
    spent = _searches(simple, before if only else {})
    return {SIMPLE: best, **kept, **chosen, **constants, "costs": costs, **spent}


def _searches(simple: Simple, before: Mapping[str, Any]) -> dict[str, Any]:
    """The entry ``searches``: those of now, and those on record of heuristics that were not searched again."""
    kept = {name: spent for name, spent in before.get("searches", {}).items() if name in simple.constants}
    return {"searches": {**kept, **simple.searches}} if kept or simple.searches else {}


def swept_record(
    system: System, worlds: Any, record: dict[str, Any], before: Mapping[str, Any], seconds: float
) -> tuple[dict[str, Any], list[Swept]]:
    """The record with the planner of least cost in a sweep, and the sweep.

    The bases are the best heuristics of the record and the base of the planner before.

    Args:
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world.
        record: of ``tuned_record``.
        before: the record before it, whose planner is tried first.
        seconds: CPU seconds for the sweep.
    """
    costs = record["costs"]
    ranked = sorted(costs, key=lambda name: costs[name])
    followed = before.get(BASE, before.get(SIMPLE, ranked[0]))
    names = dict.fromkeys((record[SIMPLE], *ranked[:BASES], *(name for name in (followed,) if name in costs)))
    bases = {name: HEURISTICS[name].make(**record[name]) for name in names}
    recorded = []
    if PLANNER in before and followed in bases:
        planner = before[PLANNER]
        is_ahead = planner.startswith("lookahead")
        own = {} if is_ahead else dict(before.get(planner.partition(":")[0], {}))
        recorded = [Setting(planner, "" if is_ahead else followed, own)]
    rows = sweep(system, bases, worlds, seconds, recorded)
    best = best_within(rows, np.inf).setting
    if not best.planner:
        return record, rows
    family = best.planner.partition(":")[0]
    kept = {key: value for key, value in record.items() if key not in (PLANNER, BASE, family, "planner_costs")}
    chosen: dict[str, Any] = {SIMPLE: record[SIMPLE], PLANNER: best.planner}
    if best.base and best.base != record[SIMPLE]:
        chosen[BASE] = best.base
    if best.settings:
        chosen[family] = dict(best.settings)
    return {**chosen, **{key: value for key, value in kept.items() if key not in chosen}}, rows


def _rounded(log: float) -> float:
    return float(f"{np.exp(log):.4g}")


def parser() -> Parser:
    """The options."""
    options = Parser(
        prog="python -m wavegym.evaluation.tune_constants",
        description="Tune every heuristic, search one, sweep the planners, and record what was found.",
    )
    options.add_argument("ids", nargs="+", metavar="ID", help="environments, such as CameraSlew-v0 or package:ID")
    options.add_argument("--worlds", type=int, default=WORLDS, help=f"tuning worlds (default: {WORLDS})")
    options.add_argument("--seed", type=int, default=0, help="of the tuning worlds and of CMA-ES (default: 0)")
    options.add_argument("--heuristics", default="", help="tune these alone, or none; the others keep their record")
    seconds = f"CPU seconds of CMA-ES for each heuristic that it searches (default: {CPU_SECONDS:g})"
    options.add_argument("--cpu-seconds", type=float, metavar="S", help=seconds)
    options.add_argument(
        "--evaluations", type=int, metavar="N", help="policies that CMA-ES plays, in place of CPU seconds: reproducible"
    )
    options.add_argument(
        "--search-worlds", type=int, default=SEARCH_WORLDS, help=f"worlds of CMA-ES (default: {SEARCH_WORLDS})"
    )
    options.add_argument("--planners", default="", help="choose the best planner of these, such as rollout:10,tree:2")
    options.add_argument("--sweep", type=float, metavar="S", help="sweep the planners for S CPU seconds")
    options.add_argument(
        "--sweep-worlds", type=int, default=SWEEP_WORLDS, help=f"worlds of the sweep (default: {SWEEP_WORLDS})"
    )
    options.add_argument("--sweep-out", type=Path, default=SWEEPS, help=f"folder for ID.csv (default: {SWEEPS})")
    options.add_argument(
        "--import", action="append", default=[], dest="packages", metavar="PACKAGE",
        help="import a package that registers environments; may be repeated",
    )  # fmt: skip
    options.add_argument("--out", type=Path, default=Path(wavegym.schedulers.__path__[0]) / FILE, help="file to write")
    return options


def main(arguments: Sequence[str] | None = None) -> None:
    """Tune, search, sweep and write."""
    read = parser().read(arguments)
    planners, only = ([name for name in names.split(",") if name] for names in (read.planners, read.heuristics))
    search = _search(read)
    for name in planners:
        planner_builder(name)
    for name in only:
        check_choice("heuristic", name, (NONE, *HEURISTICS))
    check_int("sweep-worlds", read.sweep_worlds, 2)
    if read.sweep is not None:
        check_positive("sweep", read.sweep)
    for package in read.packages:
        import_package(package)
    table = as_table(read.out) if read.out.exists() else {}
    for env_id, system in [(task.env_id, task.system) for task in (make_task(env_id, {}) for env_id in read.ids)]:
        name, worlds = record_key(system), draw_worlds(system, world_seeds(read.seed, "tune", read.worlds))
        before = table.get(name, {})
        searched = [heuristic for heuristic in SEARCHED if not only or heuristic in only]
        limit = f"{search.evaluations} evaluations" if search.evaluations else f"{search.seconds:g} CPU seconds"
        if searched:
            print(
                f"{name}: CMA-ES has {limit} on at most {search.worlds} worlds for each of {', '.join(searched)}",
                flush=True,
            )
        record = table[name] = tuned_record(system, worlds, planners, before, search, only)
        _print_record(name, record, only)
        if read.sweep is not None:
            print(f"{name}: sweep of planners for {read.sweep:g} CPU seconds on {read.sweep_worlds} worlds", flush=True)
            few = trees.first(worlds, read.sweep_worlds)
            table[name], rows = swept_record(system, few, record, before, read.sweep)
            write_whole(read.sweep_out, {f"{env_id.rpartition('/')[2]}.csv": as_csv(rows).encode()})
            _print_sweep(name, rows)
        write_whole(read.out.parent, {read.out.name: as_toml(table).encode()})


def _search(read: Any) -> Search:
    """How CMA-ES searches. Raises an InputError for both limits at once, or a number out of range."""
    if read.evaluations is not None and read.cpu_seconds is not None:
        raise InputError("--evaluations and --cpu-seconds are both given, expected one (nearest: --evaluations)")
    seconds = None if read.evaluations is not None else CPU_SECONDS if read.cpu_seconds is None else read.cpu_seconds
    search = Search(read.evaluations, seconds, read.seed, check_int("search-worlds", read.search_worlds, 1))
    search.budget()
    return search


def _print_record(name: str, record: Mapping[str, Constants | Any], only: Sequence[str]) -> None:
    for heuristic, spent in record.get("searches", {}).items():
        if not only or heuristic in only:
            done = f"{spent['evaluations']} evaluations in {spent['cpu_seconds']:g} CPU seconds"
            gained = ""
            if "percent" in spent:
                error = spent["standard_error"]
                gained = f"; {spent['percent']:+g} +- {error:g} % against its start on {spent['worlds']} other worlds"
            print(f"{name}: {heuristic} was found with {done}{gained}")
    ranking = sorted(record["costs"].items(), key=lambda item: item[1])
    print(
        f"{name}: best-simple is {record[SIMPLE]}; " + ", ".join(f"{heuristic} {cost:g}" for heuristic, cost in ranking)
    )


def _print_sweep(name: str, rows: Sequence[Swept]) -> None:
    for limit in LIMITS:
        try:
            row = best_within(rows, limit)
        except InputError:
            continue
        percent = 100.0 * float(np.expm1(row.log_ratio))
        within = "without a limit" if np.isinf(limit) else f"within {limit:g} ms"
        what = f"{row.setting.planner or 'no planner'}@{row.setting.base}" if row.setting.base else row.setting.planner
        print(f"{name}: best {within}: {what} {percent:+.1f} % of the best heuristic's cost, {row.cpu_ms:.3g} ms")


def as_table(file: Path) -> dict[str, dict[str, Any]]:
    """The records in a file."""
    return tomllib.loads(file.read_text(encoding="utf-8"))


if __name__ == "__main__":
    sys.exit(guarded(main))
