"""Steps per second of every environment: ``python -m research.benchmarks.steps [ID ...]``.

Under random allowed actions, the best heuristic and the trained agent, single and in batches, on one core; in the
largest batch also on two. Only ``step`` and the resets in it are timed, not the decisions. A step on one core counts in
CPU time; two threads are compared with one by the wall clock, in turn, so the machine should have nothing else to do.
Figures go to results/speed.csv, the table to docs/speed.md and (``python -m research.pages``) the environments' pages.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import wavegym
from agents import blocks
from research.benchmarks.figures import read_rows, renew_rows
from wavegym.core.command_line import Parser, guarded
from wavegym.evaluation.adapters import SAVED
from wavegym.evaluation.table import tabulated
from wavegym.policies.runs import RUN, environment_of, read_run
from wavegym.registration import SYSTEMS, full_id, stem
from wavegym.schedulers.tuned_constants import SIMPLE

ROOT = Path(__file__).parents[2]
FILE, PAGE = ROOT / "results" / "speed.csv", ROOT / "docs" / "speed.md"
START, END = "<!-- made by `python -m research.benchmarks.steps`: -->", "<!-- steps to here -->"
BATCHES, SECONDS, ROUNDS = (1, 64, 4096), 1.5, 5
RANDOM, TRAINED = "random", "trained"
HEAD = "environment,actions,batch,steps_per_second,on_two_cores"


class Speed(NamedTuple):
    """One figure of the table."""

    environment: str
    actions: str
    batch: int
    per_second: float
    two_cores: float | None  # speed in two threads over that in one


class Player:
    """A batch under one policy, whose steps alone are timed."""

    def __init__(self, env_id: str, actions: str, count: int, threads: int = 1) -> None:
        run = SAVED / stem(env_id) / "ppo" / "seed0" / RUN
        parameters = environment_of(read_run(run)) if actions == TRAINED else {}
        self.envs: Any = gym.make_vec(env_id, num_envs=count, num_threads=threads, **parameters)
        agent = wavegym.load_agent(env_id, "ppo", **parameters) if actions == TRAINED else actions
        self.envs.reset(seed=0)
        loop: Any = self.envs.unwrapped
        self._policy = loop.policy(agent)
        self._count = count
        self.play(0.0, time.process_time)  # kernels are compiled

    def play(self, seconds: float, clock: Callable[[], float]) -> float:
        """Play for so many seconds, at least two steps; the mean time of a step, s for each environment."""
        steps, stepping, begun = 0, 0.0, time.perf_counter()
        while steps < 2 or time.perf_counter() - begun < seconds:
            actions, start = self._policy(), clock()
            self.envs.step(actions)
            stepping += clock() - start
            steps += 1
        return stepping / steps / self._count


def measured(env_id: str, actions: str, batches: tuple[int, ...] = BATCHES) -> Iterator[Speed]:
    """The figures of one environment under one policy."""
    for count in batches:
        one = Player(env_id, actions, count)
        per_second, ratio = 1.0 / one.play(SECONDS, time.process_time), None
        if count == max(BATCHES):
            two = Player(env_id, actions, count, threads=2)
            span = SECONDS / ROUNDS
            ratios = [one.play(span, time.perf_counter) / two.play(span, time.perf_counter) for _ in range(ROUNDS)]
            ratio = float(np.median(ratios))
        yield Speed(stem(env_id), actions, count, per_second, ratio)


def all_of(env_id: str) -> Iterator[Speed]:
    """The figures of one environment; of simulated signals, with which nobody trains, single and random steps only."""
    if "Signal" in env_id:
        yield from measured(env_id, RANDOM, BATCHES[:1])
        return
    for actions in (RANDOM, SIMPLE, TRAINED):
        yield from measured(env_id, actions)


def read() -> list[Speed]:
    """The figures of results/speed.csv."""
    return [
        Speed(env, by, int(batch), float(speed), float(two) if two else None)
        for env, by, batch, speed, two in read_rows(FILE)
    ]


def cells_of(speed: Speed) -> list[str]:
    """A row of results/speed.csv."""
    two_cores = "" if speed.two_cores is None else f"{speed.two_cores:.3g}"
    return [speed.environment, speed.actions, str(speed.batch), f"{speed.per_second:.4g}", two_cores]


def table(found: list[Speed]) -> str:
    """One line for each environment and policy, with steps per second."""
    by_line: dict[tuple[str, str], dict[int, Speed]] = {}
    for speed in found:
        by_line.setdefault((speed.environment, speed.actions), {})[speed.batch] = speed
    rows = []
    for (name, actions), cells in by_line.items():
        speeds = [f"{cells[batch].per_second:,.0f}" if batch in cells else "" for batch in BATCHES]
        largest = cells.get(max(BATCHES))
        rows.append([name, actions, *speeds, f"{largest.two_cores:.2f}" if largest and largest.two_cores else ""])
    head = ["environment", "actions", *(f"batch of {batch}" if batch > 1 else "single" for batch in BATCHES)]
    return tabulated([*head, "two cores over one"], rows)


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m research.benchmarks.steps", description="Steps per second of the environments.")
    parser.add_argument("ids", nargs="*", metavar="ID", help="environments (default: all of the suite)")
    ids = [full_id(name) for name in parser.read(None).ids] or list(SYSTEMS)
    for env_id in ids:
        renew_rows(FILE, HEAD, stem(env_id), [cells_of(speed) for speed in all_of(env_id)])
    blocks.renew(PAGE, START, END, table(read()))


if __name__ == "__main__":
    sys.exit(guarded(main))
