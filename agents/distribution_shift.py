"""Policies under distribution shift: ``python -m agents.distribution_shift [ENVIRONMENT ...]``.

``results/experiments.toml`` lists the changed parameters. Agents and tuned constants are those of the original
parameters. Each shift is played twice. First the tracker, and so prediction, has the new parameters. Then only the
world has them, if the truth may differ in all of them; here the best planner plays too, in the first ``PLANNED``
worlds. Results are written to results/distribution_shift, their tables to docs/learned.md.

``--agents`` does not play the planner and keeps its figures. ``--outside`` only counts, in a few worlds, how often the
observations of the agents are outside the range of their training. ``--tables`` renews the tables without playing.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents import blocks
from agents.experiment import load_experiments
from agents.leaderboard import PAGE, ROOT, SEED, against, environment_of
from wavegym.core.command_line import Parser, guarded, named_values
from wavegym.core.errors import InputError, check_choice
from wavegym.core.files import write_whole
from wavegym.core.parameters import parameter_infos
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.core.worlds import word
from wavegym.evaluation import compare, full_id, make_task, statistics
from wavegym.evaluation.adapters import AGENTS, SAVED
from wavegym.evaluation.comparison import BASELINE
from wavegym.evaluation.consistency import consistency, reversals
from wavegym.evaluation.play import EpisodeResults
from wavegym.evaluation.summary import named
from wavegym.evaluation.table import decimal, flagged, interval, number, signed, tabulated
from wavegym.policies.runs import load_policy
from wavegym.registration import stem
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.tuned_constants import PLANNER, SIMPLE

FOLDER = ROOT / "results" / "distribution_shift"
START, END = "<!-- made by `python -m agents.distribution_shift`: -->", "<!-- shifts to here -->"
WORLDS = 200
COUNTED = 50  # worlds of ``--outside``
PLANNED = 32  # worlds of the planner, which takes most of the time
KNOWN, UNKNOWN = "known", "unknown"  # known or unknown to the tracker


def load_shifts() -> dict[str, dict[str, dict[str, Any]]]:
    """Changed parameters by environment and shift."""
    return {
        stem(each.env): {name: named_values(given) for name, given in each.shifts.items()}
        for each in load_experiments().values()
        if each.shifts
    }


def play(
    name: str, shifts: dict[str, dict[str, Any]], jobs: int, before: dict[str, Any] | None = None
) -> dict[str, Any]:
    """The figures of every shift, with a tracker that knows it (``known``) and one that does not (``unknown``).

    If ``before`` has figures with the same best heuristic, the planner is not played and keeps its figures.
    """
    env_id = full_id(name)
    original = make_task(env_id, {}).system
    policies = {SIMPLE: ({}, make_policy(SIMPLE, original, None)), **_agents(name)}
    planner = None if before else make_policy(PLANNER, original, None)
    found: dict[str, Any] = {}
    for shift, given in shifts.items():
        found[shift] = {
            half: _figures(env_id, policies, planner if half == UNKNOWN else None, changes, jobs)
            for half, changes in halves(original, given).items()
        }
        if before and UNKNOWN in found[shift]:
            found[shift][UNKNOWN]["policies"][PLANNER] = before[shift][UNKNOWN]["policies"][PLANNER]
    return found


def count_outside(name: str, shifts: dict[str, dict[str, Any]], found: dict[str, Any], jobs: int) -> None:
    """Add to the figures of ``play`` how often the agents' observations are outside the range of their training."""
    env_id = full_id(name)
    original, agents = make_task(env_id, {}).system, _agents(name)
    for shift, given in shifts.items():
        for half, changes in halves(original, given).items():
            for algo, (own, policy) in agents.items():
                comparison = compare(env_id, {algo: policy}, worlds=COUNTED, jobs=jobs, keep=FOLDER, **own, **changes)
                row = found[shift][half]["policies"][algo]
                row["outside"] = statistics.finite(np.mean(comparison.results(algo).outside))


def _agents(name: str) -> dict[str, tuple[dict[str, Any], Any]]:
    """The saved agents of an environment by algorithm: the parameters in which they play, and all training seeds."""
    env_id, found = full_id(name), {}
    for algo in AGENTS:
        folder = SAVED / name / algo
        if folder.is_dir():
            own = environment_of(folder)
            found[algo] = own, load_policy(folder, env_id, make_task(env_id, own).system)
    return found


def halves(system: System, parameters: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The parameters of both halves of a shift; without ``unknown`` if the truth may not differ in all parameters."""
    found = {KNOWN: parameters}
    if set(parameters) <= {info.name for info in parameter_infos(type(system)) if info.truth}:
        found[UNKNOWN] = {"truth": parameters}
    return found


def _figures(
    env_id: str, policies: dict[str, Any], planner: Policy | None, changes: dict[str, Any], jobs: int
) -> dict[str, Any]:
    """Each policy (with its own actions), the one-step scheduler and perhaps a planner in the changed environment."""
    by_policy: dict[str, EpisodeResults] = {}
    for name, (own, policy) in policies.items():
        comparison = compare(env_id, {name: policy}, worlds=WORLDS, jobs=jobs, keep=FOLDER, **own, **changes)
        for each in comparison.played:
            by_policy.setdefault(each, comparison.results(each))
    dimension, simple = comparison.task.system.nees_dimension, by_policy[SIMPLE]
    rows = {name: _against_simple(results, simple, dimension) for name, results in by_policy.items()}
    if planner:
        few = min(PLANNED, WORLDS)
        results = compare(env_id, {PLANNER: planner}, worlds=few, jobs=jobs, keep=FOLDER, **changes).results(PLANNER)
        rows[PLANNER] = _against_simple(results, EpisodeResults(*(values[:, :few] for values in simple)), dimension)
    return {"policies": rows, "reversals": reversals(by_policy, SEED)}


def _against_simple(results: EpisodeResults, simple: EpisodeResults, dimension: int | None) -> dict[str, Any]:
    """One policy's figures, as plain types."""
    found = consistency(results, dimension, np.random.default_rng([SEED, word("bootstrap")]))
    return {
        "belief": named("percent", "ci", against(results.cost, simple.cost)),
        "truth": named("percent", "ci", against(results.squared_error, simple.squared_error)),
        "nees": {**named("mean", "ci", found.nees), "flag": found.flag},
        "lost": statistics.finite(np.mean(results.lost)),
        "outside": statistics.finite(np.mean(results.outside)),
    }


def tables(results: dict[str, dict[str, Any]]) -> str:
    """For each half, by belief and by truth, a line for each environment and shift."""
    parts = []
    for half, title in {KNOWN: "The tracker knows the change", UNKNOWN: "The tracker does not know it"}.items():
        pair = blocks.both(_table(results, half, "belief"), _table(results, half, "truth"))
        parts.append(f"{title}. {pair}\n\n{_orders(results, half)}")
    return "\n\n".join(parts)


def _table(results: dict[str, dict[str, Any]], half: str, by: str) -> str:
    """Every policy against the best heuristic.

    The costs come with the share of observations outside the agents' training; the errors with NEES and lost targets.
    """
    compared = (*((PLANNER,) if half == UNKNOWN else ()), *AGENTS)
    head = ["environment", "shift", "myopic"]
    for name in compared:
        head += [name.upper() if name in AGENTS else "best planner", "95 %"]
    if by == "belief":
        head += ["outside: PPO", "DQN"]
    else:
        head += ["NEES: best-simple", "95 %", "lost: best-simple", "PPO", "DQN"]
    rows = []
    for env, shift, found in _played(results, half):
        policies = found["policies"]
        cells = [env, shift, signed(policies[BASELINE][by]["percent"])]
        for name in compared:
            row = policies.get(name)
            cells += [signed(row[by]["percent"]), interval(row[by]["ci"], signed)] if row else ["", ""]
        if by == "belief":
            cells += [_share(policies.get(name, {}).get("outside")) for name in AGENTS]
        else:
            nees = policies[SIMPLE]["nees"]
            cells += [flagged(nees["mean"], nees["flag"]), interval(nees["ci"], number)]
            cells += [decimal(policies[name]["lost"]) if name in policies else "" for name in (SIMPLE, *AGENTS)]
        rows.append(cells)
    return tabulated(head, rows)


def _share(outside: float | None) -> str:
    return "" if outside is None else f"{100.0 * outside:.0f} %"


def _orders(results: dict[str, dict[str, Any]], half: str) -> str:
    """The changed environments in which belief and truth rank two policies differently."""
    told = {f"{env}, {shift}": found["reversals"] for env, shift, found in _played(results, half)}
    return blocks.order_list(told)


def _played(results: dict[str, dict[str, Any]], half: str) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Environment, shift and figures of every shift that was played in this half."""
    for env, shifts in results.items():
        for shift, found in shifts.items():
            if half in found:
                yield env, shift, found[half]


def renew(names: Sequence[str]) -> None:
    """Renew the tables in docs/learned.md from all results."""
    files = [FOLDER / f"{name}.json" for name in names]
    blocks.renew(PAGE, START, END, tables({file.stem: _read(file) for file in files if file.exists()}))


def _read(file: Path) -> dict[str, Any]:
    """The figures in a file. Raises an InputError for a file of an earlier version, which has only one half."""
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    if not all(KNOWN in shift for shift in found.values()):
        wanted = f"it from `python -m agents.distribution_shift {file.stem}`"
        raise InputError(f"{file} does not tell whether the tracker knows of the shift, expected {wanted}")
    return found


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.distribution_shift", description="Policies under distribution shift.")
    parser.add_argument(
        "names", nargs="*", metavar="ENVIRONMENT", help="names (default: all with shifts in results/experiments.toml)"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--agents", action="store_true", help="do not play the planner; its figures stay")
    parser.add_argument("--outside", action="store_true", help="count observations outside the training; play no more")
    parser.add_argument("--tables", action="store_true", help="renew the tables from earlier results; play nothing")
    read = parser.read(None)
    shifts = load_shifts()
    for name in () if read.tables else read.names or shifts:
        changes = shifts[check_choice("environment", name, shifts)]
        if read.outside:
            found = _read(FOLDER / f"{name}.json")
            count_outside(name, changes, found, read.jobs)
        else:
            found = play(name, changes, read.jobs, _read(FOLDER / f"{name}.json") if read.agents else None)
        write_whole(FOLDER, {f"{name}.json": (json.dumps(found, indent=2) + "\n").encode()})
    renew(list(shifts))


if __name__ == "__main__":
    sys.exit(guarded(main))
