"""The subcommand ``evaluate``: compare policies, trained ones included, on the same worlds."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from wavegym.core.command_line import Parser, guarded, settings
from wavegym.core.errors import InputError

POLICIES = """comma-separated: random, round-robin, fixed:K, fixed:NAME, best-fixed, tuned-constant, tuned-cycle,
myopic, myopic:exhaustive (tries every action), myopic:determinant, myopic:gate, myopic:closed-form,
myopic:progressive, myopic:slsqp and myopic:polish (these four with --set action=box), myopic-information,
myopic-information:slsqp, myopic-information:polish, myopic-margin:M, lookahead:H, optimum; rules whose constants are
tuned on other worlds: cycle, gain:L, greedy, aware-greedy, cost-of-delay, hold-until-detected, lagrangian-price, adaptive-lagrangian-price, constant-pace,
best-simple (the best of them); planners that simulate futures: rollout:H, tree:H, beam:W, mcts:N, receding-horizon, plan-once,
best-planner; a whole loop that the system names, such as open-loop of Urban; ppo and dqn, the trained agents that come
with the environment; or the folder of a trained run (or of several runs, one for each seed)"""
SAVED = Path(__file__).parents[2] / "results" / "runs"  # ENVIRONMENT/LEARNER/seedN, as agents.experiment makes them
LEARNERS = ("ppo", "dqn")

RECORDED = "KershawEvansPosition-v0"

# Arguments of `compare` that are no parameters of an environment, and their options.
COMPARISON = {
    "env_id": "it as the first argument",
    "policies": "--policies NAMES",
    "worlds": "--worlds N",
    "root": "--seed S",
    "jobs": "--jobs J",
    "progress": "none: the bar shows on a terminal only",
}


def parser() -> Parser:
    """The options."""
    options = Parser(prog="wavegym evaluate", description="Compare policies on the same worlds.")
    options.add_argument("env", metavar="ENV", help="id of the environment, with or without wavegym/")
    options.add_argument("--policies", default="myopic,best-fixed,random", help=f"{POLICIES} (default: %(default)s)")
    options.add_argument(
        "--worlds", type=int, default=200, metavar="N", help="number of test worlds (default: %(default)s)"
    )
    options.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    options.add_argument("--seed", type=int, default=0, metavar="S", help="another seed, other worlds (default: 0)")
    options.add_argument("--jobs", type=int, default=-1, metavar="J", help="processes (default: one for each core)")
    options.add_argument("--tracks", type=Path, metavar="FILE.csv", help="recorded targets")
    options.add_argument(
        "--radar",
        type=float,
        nargs="+",
        metavar="X",
        help="position of the radar: LAT LON [ALT], or X Y [Z] in metres",
    )
    options.add_argument("--set", nargs="+", default=[], metavar="KEY=VALUE", help="parameters of the environment")
    return options


def parameters(options: Any, env_id: str) -> dict[str, Any]:
    """The system's parameters from the options. InputError if the system takes no recorded targets."""
    from wavegym.evaluation import make_task

    chosen = settings(options.set)
    for name in chosen:
        if name in COMPARISON:
            raise InputError(f"--set {name} is no parameter of an environment, expected {COMPARISON[name]}")
    if options.tracks:
        if not hasattr(make_task(env_id, {}).system, "tracks"):
            raise InputError(f"--tracks {options.tracks}: {env_id} takes no recorded targets, as {RECORDED} does")
        chosen |= {"targets": "recorded", "tracks": options.tracks}
    if options.radar:
        if len(options.radar) not in (2, 3):
            raise InputError(f"--radar has {len(options.radar)} numbers, expected LAT LON or LAT LON ALT")
        chosen["radar"] = (*options.radar, 0.0)[:3]
    return chosen


def policies(names: str, env_id: str) -> dict[str, Any]:
    """Where each policy comes from: None for a scheduler, a loader for a folder.

    Raises:
        InputError: two policies of one name, none at all, or a saved agent that this environment does not have.
    """
    from wavegym.schedulers.registry import is_scheduler

    found: dict[str, Any] = {}
    for name in filter(None, (part.strip() for part in names.split(","))):
        folder = saved(name, env_id) if name in LEARNERS else Path(name)
        trained = name in LEARNERS or os.sep in name or (folder.is_dir() and not is_scheduler(name))
        key = folder.resolve().name if trained else name
        if key in found:
            raise InputError(f"two policies are called {key!r}, expected different names (rename a folder)")
        found[key] = partial(load_trained, folder, env_id) if trained else None
    if not found:
        raise InputError(f"--policies is {names!r}, expected at least one name, such as myopic")
    return found


def stem(env_id: str) -> str:
    """The environment's name without namespace and version."""
    return env_id.rpartition("/")[2].rpartition("-v")[0]


def saved(name: str, env_id: str) -> Path:
    """The folder of the agents called ``name`` that come with an environment.

    Raises:
        InputError: there are none, the nearest way to have some named.
    """
    environment = stem(env_id)
    folder = SAVED / environment / name
    if not folder.is_dir():
        from wavegym.policies.pretrained import pretrained_folder

        if packaged := pretrained_folder(env_id, name):
            return packaged
        wanted = f"the folder of a run (nearest: wavegym train {environment}-v0 --algo {name} --out runs/{name})"
        raise InputError(f"policy is {name!r}, of which none is saved for {env_id}, expected {wanted}")
    return folder


def load_trained(folder: Path, env_id: str, system: Any) -> Any:
    """The trained runs in a folder, one policy each."""
    try:
        from wavegym.policies.runs import load_policy
    except ImportError as error:
        raise InputError(f"policy {str(folder)!r} needs the agents: {error}; pip install 'wavegym[agents]'") from error
    return load_policy(folder, env_id, system)


def evaluate(arguments: Sequence[str] | None) -> None:
    """Play, compare, write, print."""
    options = parser().read(arguments)
    # These imports take half a second; a misspelt option is reported before them.
    from wavegym.evaluation import compare, full_id, write_report

    env_id = full_id(options.env)
    options.out.mkdir(parents=True, exist_ok=True)
    comparison = compare(
        env_id,
        policies(options.policies, env_id),
        worlds=options.worlds,
        root=options.seed,
        jobs=options.jobs,
        **parameters(options, env_id),
    )
    print(write_report(comparison, options.out))
    print(f"\nwritten to {options.out}: report.html, summary.json, episodes.csv, table.md, comparison.png")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    return guarded(lambda: evaluate(arguments))
