"""Consistency, true error and time of the trackers in clutter: ``python -m research.benchmarks.consistency``.

Plays the environments with targets in clutter on the same worlds with every tracker. Writes one row for each
environment, policy and tracker to ``results/consistency/clutter.csv`` and prints a Markdown table. Policies keep the
constants recorded for the defaults. The page docs/consistency_in_clutter.md explains the columns.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.arrays import Array
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.evaluation.play import make_task
from wavegym.evaluation.statistics import Estimate, of_worlds
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.rollout import allowed
from wavegym.schedulers.tuned_constants import recorded

SEED = 22  # of the worlds
ENVIRONMENTS = ("AgileClutter-v0", "BeamAllocation-v0", "EnergyBudget-v0", "EnergyBudgetKnown-v0")
SIZES = {"jpda": (0,), "mixture": (1, 2, 4, 8, 16, 32, 64), "particle": (100, 1000, 10_000)}
PARAMETER = {"mixture": "components", "particle": "particles"}
POLICIES = ("random", "myopic", "best-planner")  # in addition to best-simple
MOST_OUTSIDE = 5  # returns outside the gates of a track that is kept: the rule of AgileClutter's source paper
SLOW = {("particle", 10_000): 5, "best-planner": 12}  # these are played on fewer worlds, by this factor

SHOWN = {"nees": "NEES", "nees_kept": "NEES, kept", "true_over_believed": "true / believed", "error": "true error"}


class Case(NamedTuple):
    """One row: what is played."""

    environment: str
    policy: str
    tracker: str
    size: int  # components or particles; 0 for JPDA

    def worlds(self, count: int) -> int:
        """The number of worlds."""
        return count // (SLOW.get((self.tracker, self.size), 1) * SLOW.get(self.policy, 1))


class Figures(NamedTuple):
    """Figures of each world, (world,): sums over steps and present targets, and numbers of targets."""

    nees: Array
    entries: Array
    kept_nees: Array
    kept_entries: Array
    error: Array
    trace: Array
    tracks: Array
    outside: Array


def cases(sizes: dict[str, tuple[int, ...]]) -> Iterator[Case]:
    """Every tracker and size with the best heuristic, then the other policies, planners last."""
    for environment in ENVIRONMENTS:
        for tracker, counts in sizes.items():
            for size in counts:
                yield Case(environment, "best-simple", tracker, size)
    for policy in POLICIES:
        for environment in ENVIRONMENTS:
            if policy != recorded(make_task(environment, {}).system)["best-simple"]:
                if policy != "best-planner":
                    yield Case(environment, policy, "jpda", 0)
                yield Case(environment, policy, "mixture", 16)


def play(case: Case, count: int) -> tuple[Figures, float]:
    """The figures of each world, and CPU microseconds of a step of one environment without the decision."""
    default = make_task(case.environment, {}).system
    changed = {"tracker": case.tracker} | ({PARAMETER[case.tracker]: case.size} if case.size else {})
    system: Any = make_task(case.environment, changed).system
    policy, worlds = make_policy(case.policy, default, None), draw_worlds(system, world_seeds(SEED, "test", count))
    policy.begin(system, count, np.random.default_rng(SEED))
    state, weights = system.initial(worlds), np.asarray(system.weights)
    system.transition(state, shortcuts.constants(system)[:1].repeat(count, axis=0), worlds)  # compiles
    steps, spent = [], 0.0
    for _ in range(system.horizon):
        action = policy.act(state.belief, None, allowed(system, state.belief))
        start = time.process_time()
        state = system.transition(state, np.asarray(action), worlds)
        spent += time.process_time() - start
        info, diagonal = system.state_info(state), np.diagonal(state.belief.covariance, axis1=2, axis2=3)
        steps.append([info["present"], info["nees"], info["squared_error"], (diagonal * weights).sum(axis=2)])
    return _sums(np.array(steps), info["returns_outside"] > MOST_OUTSIDE), 1e6 * spent / (count * system.horizon)


def _sums(steps: Array, outside: Array) -> Figures:
    """``steps`` (step, 4, world, target): present, NEES, squared error, trace; ``outside`` (world, target), bool."""
    present = steps[:, 0] > 0.0
    kept = present & ~outside
    nees, error, trace = (np.where(present, steps[:, i], 0.0).sum(axis=(0, 2)) for i in (1, 2, 3))
    kept_nees = np.where(kept, steps[:, 1], 0.0).sum(axis=(0, 2))
    tracks = np.full(len(outside), outside.shape[1])
    return Figures(
        nees, present.sum(axis=(0, 2)), kept_nees, kept.sum(axis=(0, 2)), error, trace, tracks, outside.sum(axis=1)
    )


def row(case: Case, count: int) -> dict[str, Any]:
    """The columns of one case."""
    worlds = case.worlds(count)
    f, us = play(case, worlds)

    def ratio(top: Array, bottom: Array) -> Estimate:
        return of_worlds(lambda i: top[i].sum(-1) / bottom[i].sum(-1), worlds, np.random.default_rng(0))

    columns = {
        "nees": ratio(f.nees, f.entries),
        "nees_kept": ratio(f.kept_nees, f.kept_entries),
        "true_over_believed": ratio(f.error, f.trace),
        "error": ratio(f.error, f.entries),
    }
    found: dict[str, Any] = {**case._asdict(), "worlds": worlds}
    for name, (value, interval) in columns.items():
        low, high = interval or (np.nan, np.nan)
        found |= {name: f"{value:.3g}", f"{name}_low": f"{low:.3g}", f"{name}_high": f"{high:.3g}"}
    return found | {"outside_percent": f"{100.0 * f.outside.sum() / f.tracks.sum():.3g}", "us_per_step": f"{us:.3g}"}


def plain(number: str) -> str:
    """A number of the file without an exponent."""
    return f"{float(number):.0f}" if float(number) >= 1000.0 else number


def table(rows: list[dict[str, Any]]) -> Iterator[str]:
    """The lines of the page's table in Markdown."""
    yield f"| environment | policy | worlds | tracker | {' | '.join(SHOWN.values())} | outside % | us a step |"
    yield "|" + " --- |" * 10
    for r in rows:
        cells = [r["environment"], r["policy"], r["worlds"], f"{r['tracker']} {r['size']}".removesuffix(" 0")]
        for name in SHOWN:
            value, low, high = (plain(r[name + end]) for end in ("", "_low", "_high"))
            cells.append(f"{value} [{low}, {high}]")
        yield f"| {' | '.join(map(str, [*cells, r['outside_percent'], plain(r['us_per_step'])]))} |"


def main() -> None:
    """Play all cases. After an interruption the same command plays the cases that are missing in the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=300)
    parser.add_argument("--out", type=Path, default=Path("results/consistency/clutter.csv"))
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    if options.out.exists():
        with options.out.open(newline="") as file:
            rows = list(csv.DictReader(file))
    done = {(r["environment"], r["policy"], r["tracker"], int(r["size"])) for r in rows}
    for case in cases(SIZES):
        if tuple(case) not in done:
            rows.append(row(case, options.worlds))
            with options.out.open("w", newline="") as file:
                writer = csv.DictWriter(file, list(rows[0]))
                writer.writeheader()
                writer.writerows(rows)
    print("\n".join(table(rows)))


if __name__ == "__main__":
    main()
