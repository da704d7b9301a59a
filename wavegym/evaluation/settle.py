"""``python -m wavegym.evaluation.settle ID ...``: find the constants of every rule and record them with the package."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import wavegym.schedulers
from wavegym.evaluation.command import Parser, guarded
from wavegym.evaluation.task import make_task
from wavegym.evaluation.worlds import draw_worlds, world_seeds
from wavegym.schedulers.rules.families import best_simple
from wavegym.schedulers.settled import FILE, PLANNER, SIMPLE, as_toml, records
from wavegym.systems.contract import System

WORLDS = 100


def settled_record(system: System, worlds: int, root: int, before: dict[str, Any]) -> dict[str, Any]:
    """The record of one system: rules tuned and compared on tuning worlds.

    Args:
        system: the closed loop.
        worlds: how many tuning worlds.
        root: the seed that they follow from.
        before: the present record; its planner is kept.

    Returns:
        The best rule, the best planner where one was recorded, each rule's constants, and under ``costs`` the geometric
        mean over the tuning worlds of each rule's mean cost per step.
    """
    best, constants, costs = best_simple(system, draw_worlds(system, world_seeds(root, "tune", worlds)))
    planner = {PLANNER: before[PLANNER]} if PLANNER in before else {}
    means = {name: float(f"{np.exp(cost):.4g}") for name, cost in costs.items()}
    return {SIMPLE: best, **planner, **constants, "costs": means}


def main(arguments: Sequence[str] | None = None) -> None:
    """Tune, compare and write."""
    parser = Parser(prog="python -m wavegym.evaluation.settle", description="Tune every rule and record its constants.")
    parser.add_argument("ids", nargs="+", metavar="ID", help="environments, such as CameraSlew-v0")
    parser.add_argument("--worlds", type=int, default=WORLDS, help=f"tuning worlds (default: {WORLDS})")
    parser.add_argument("--seed", type=int, default=0, help="of the tuning worlds (default: 0)")
    parser.add_argument("--planner", help="record this planner as the best, such as rollout:20")
    parser.add_argument("--out", type=Path, default=Path(wavegym.schedulers.__path__[0]) / FILE, help="file to write")
    read = parser.read(arguments)
    table = {name: dict(record) for name, record in records().items()}
    for env_id in read.ids:
        system = make_task(env_id, {}).system
        name = type(system).__name__
        record = settled_record(system, read.worlds, read.seed, table.get(name, {}))
        table[name] = {**record, **({PLANNER: read.planner} if read.planner else {})}
        ranking = sorted(record["costs"].items(), key=lambda item: item[1])
        print(f"{name}: best simple is {record[SIMPLE]}; " + ", ".join(f"{rule} {cost:g}" for rule, cost in ranking))
        read.out.write_text(as_toml(table), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(guarded(main))
