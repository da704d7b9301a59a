"""The subcommand ``dataset``: episodes of a policy as a Minari dataset."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from wavegym.cli.environments import add_environment, read_environment
from wavegym.core.command_line import Parser
from wavegym.core.errors import InputError


def parser() -> Parser:
    """The options."""
    options = Parser(prog="wavegym dataset", description="Write episodes of a policy as a Minari dataset.")
    add_environment(options)
    known = "a policy as `wavegym evaluate --policies` takes it (default: %(default)s)"
    options.add_argument("--policy", default="myopic", metavar="NAME", help=known)
    options.add_argument("--episodes", type=int, default=100, metavar="N", help="(default: %(default)s)")
    options.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the datasets")
    options.add_argument("--name", default="", help="of the dataset (default: from environment and policy)")
    exploration = "probability of an action drawn uniformly from those allowed (default: %(default)s)"
    options.add_argument("--exploration", type=float, default=0.0, metavar="P", help=exploration)
    others = "comma-separated policies whose choices are recorded too"
    options.add_argument("--would-choose", default="", metavar="NAMES", help=others)
    returns = "also play every other action of every step, and record its return"
    options.add_argument("--all-returns", action="store_true", help=returns)
    options.add_argument("--seed", type=int, default=0, metavar="S", help="episode i plays reset(seed=S + i)")
    return options


def dataset(arguments: Sequence[str]) -> None:
    """Play, write, print what was written."""
    options = parser().read(arguments)
    from wavegym.cli.evaluate import policies

    ((name, source),) = one(policies(options.policy)).items()
    env_id, parameters = read_environment(options.env, options.set)
    from wavegym.integrations.minari import collect

    written = collect(
        env_id,
        source or name,
        options.episodes,
        out=options.out,
        name=options.name,
        exploration=options.exploration,
        would_choose=[other.strip() for other in options.would_choose.split(",") if other.strip()],
        all_returns=options.all_returns,
        seed=options.seed,
        **parameters,
    )
    print(f"{written.id}: {written.total_episodes} episodes, {written.total_steps} steps, written to {options.out}")


def one(policies: dict[str, Path | None]) -> dict[str, Path | None]:
    """The policies, of which there is one. InputError otherwise."""
    if len(policies) != 1:
        raise InputError(f"--policy is {','.join(policies)!r}, expected one policy")
    return policies
