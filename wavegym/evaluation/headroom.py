"""Headroom of planning: ``python -m wavegym.evaluation.headroom ID ... --out FOLDER`` plays ladders of policies.

The ladder goes from random choice over tuned constants and cycles, heuristics that read the belief and the one-step
scheduler to planners that simulate futures. All meet the same test worlds; constants are tuned on other worlds. Costs
are compared in pairs, against the best heuristic.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError, check_choice
from wavegym.core.files import write_whole
from wavegym.core.system import System
from wavegym.core.work import add_worker_options, workers
from wavegym.core.worlds import tuning_tapes, word
from wavegym.evaluation import statistics
from wavegym.evaluation.comparison import BASELINE, Comparison, compare
from wavegym.evaluation.consistency import reversals
from wavegym.evaluation.play import EpisodeResults, make_task
from wavegym.evaluation.report import TABLE, compressed, read_results
from wavegym.evaluation.summary import by_consistency, by_truth, us_per_decision, versions
from wavegym.registration import SYSTEMS
from wavegym.schedulers.heuristics.searched_rule import ChangedFeaturesError
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.tuned_constants import SIMPLE, recorded, records

LADDER = (
    "random",
    "best-fixed",
    "cycle",
    "myopic",
    "weighted-myopic",
    "lagrangian-price",
    "constant-pace",
    "adaptive-lagrangian-price",
    "greedy",
    "aware-greedy",
    "cost-of-delay",
    "hold-until-detected",
    "clear-slot-price",
    "searched-rule",
    SIMPLE,
    "plan-once",
    "best-planner",
)
WORLDS = 300
LONGEST = 80  # greatest horizon for plan-once


class Kept(NamedTuple):
    """The stored results of policies that are not played again."""

    by_policy: dict[str, EpisodeResults]
    rows: dict[str, Any]  # of ID.json, by policy

    @classmethod
    def of(cls, folder: Path, name: str, again: Sequence[str], seed: int, worlds: int) -> Kept:
        """The policies in a folder's ``name.json`` and ``name.csv.xz``, except for those of ``again``.

        Raises:
            InputError: a missing file, or one of other worlds.
        """
        by_policy = read_results(folder / f"{name}{TABLE}")
        found = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
        if (on_file := (found["seed"], found["worlds"])) != (seed, worlds):
            raise InputError(f"{folder / name}.json has (seed, worlds) = {on_file}, expected {(seed, worlds)}")
        others = [policy for policy in by_policy if policy not in again]
        rows = found["policies"]
        return cls({policy: by_policy[policy] for policy in others}, {policy: rows[policy] for policy in others})


NOTHING = Kept({}, {})


def ladder(
    env_id: str,
    worlds: int,
    seed: int,
    jobs: int,
    progress: bool = True,
    names: Sequence[str] | None = None,
    keep: Path | None = None,
) -> Comparison:
    """Every policy of the ladder that the environment admits, on the same worlds.

    Args:
        env_id: a registered id.
        worlds, seed, jobs, progress, keep: see ``wavegym.evaluation.compare``.
        names: of the policies; all by default.

    Raises:
        InputError: an unknown id, a number out of range, a searched heuristic on record for other features.
    """
    system = make_task(env_id, {}).system
    tuning = tuning_tapes(system, seed)
    policies: dict[str, Any] = {}
    simple = recorded(system).get(SIMPLE)
    for name in LADDER:
        is_left_out = names is not None and name not in names
        is_again = name == SIMPLE and simple in policies
        if is_left_out or is_again or (name == "plan-once" and system.horizon > LONGEST):
            continue
        try:
            policies[name] = _made(name, system, tuning)
        except ChangedFeaturesError:
            raise
        except (InputError, NotImplementedError):  # a policy that this system cannot have
            continue
    comparison = compare(env_id, policies, worlds=worlds, seed=seed, jobs=jobs, progress=progress, keep=keep)
    if SIMPLE in comparison.played:
        return comparison
    return replace(comparison, played={**comparison.played, SIMPLE: comparison.played[str(simple)]})  # played once


def _made(name: str, system: System, tuning: Any) -> Any:
    policy = make_policy(name, system, tuning)
    policy.begin(system, 1, np.random.default_rng(0))
    return policy


def figures(comparison: Comparison, kept: Kept = NOTHING) -> dict[str, Any]:
    """The figures of a comparison for the page, as plain types.

    Args:
        comparison: of the policies that were played.
        kept: of other policies on the same worlds.
    """
    system = comparison.task.system
    by_policy = {**kept.by_policy, **comparison.by_policy()}
    rows = {}
    for name, results in by_policy.items():
        rng = np.random.default_rng([comparison.seed, word("bootstrap")])
        mean = statistics.mean(results.cost, rng)
        ratio = statistics.difference(results.cost, by_policy[SIMPLE].cost, rng).geometric
        truth = by_truth(results, by_policy[SIMPLE], rng)
        own = kept.rows.get(name, {})
        if name in comparison.played:
            own = {**by_consistency(comparison, name, rng), "us_per_decision": us_per_decision(comparison, name)}
        rows[name] = {
            **own,
            "mean": mean.value,
            "ci": mean.ci,
            "vs_simple_percent": ratio.value,
            "vs_simple_ci": ratio.ci,
            "truth": truth,
        }
    return {
        "env": comparison.task.env_id,
        "worlds": len(comparison.seeds),
        "seed": comparison.seed,
        "horizon": system.horizon,
        "tuned_constants": recorded(system),
        "versions": versions(),
        "in_gospa": by_policy[SIMPLE].in_gospa,
        "nees_dimension": system.nees_dimension,
        "policies": rows,
        "reversals": reversals(by_policy, comparison.seed),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Play and write."""
    parser = Parser(prog="python -m wavegym.evaluation.headroom", description="How much is there to gain by planning.")
    tuned = [env_id for env_id, each in SYSTEMS.items() if each.system in records() and not each.parameters]
    wanted = "environments (default: those of the suite with heuristics on record)"
    parser.add_argument("ids", nargs="*", metavar="ID", default=tuned, help=wanted)
    parser.add_argument("--worlds", type=int, default=WORLDS, help=f"test worlds (default: {WORLDS})")
    parser.add_argument("--seed", type=int, default=0, help="of all worlds (default: 0)")
    parser.add_argument("--policies", default="", help="play these alone; the others keep what is on file in --out")
    add_worker_options(parser)
    parser.add_argument("--out", type=Path, required=True, help="folder for ID.json and ID.csv.xz")
    read = parser.read(arguments)
    again = tuple(check_choice("policy", name, LADDER) for name in read.policies.split(",") if name)
    tasks = [make_task(env_id, {}) for env_id in read.ids]
    for task in tasks:
        name = task.env_id.rpartition("/")[2]
        names = (*again, BASELINE, SIMPLE) if again else LADDER
        kept = Kept.of(read.out, name, names, read.seed, read.worlds) if again else NOTHING
        with workers(read):
            comparison = ladder(task.env_id, read.worlds, read.seed, read.jobs, names=names, keep=read.out)
        found = figures(comparison, kept)
        text = json.dumps(found, indent=2, allow_nan=False) + "\n"
        by_policy = {**comparison.by_policy(), **kept.by_policy}
        write_whole(read.out, {f"{name}.json": text.encode(), f"{name}{TABLE}": compressed(by_policy)})
        best = found["policies"]["best-planner"]["vs_simple_percent"]
        print(f"{name}: the best planner costs {best:+.1f} % of the best heuristic's cost")


if __name__ == "__main__":
    sys.exit(guarded(main))
