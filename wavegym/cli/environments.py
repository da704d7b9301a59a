"""The subcommands ``list``, ``describe`` and ``check``."""

from __future__ import annotations

from collections.abc import Sequence

from wavegym.core.command_line import Parser, settings
from wavegym.registration import full_id, list_envs


def parser(name: str, description: str, takes_environment: bool = True) -> Parser:
    """The options of one of these subcommands."""
    options = Parser(prog=f"wavegym {name}", description=description)
    if takes_environment:
        options.add_argument("env", metavar="ENV", help="id of the environment, with or without wavegym/")
        help = "parameters of the environment other than its defaults"
        options.add_argument("--set", nargs="+", action="extend", default=[], metavar="KEY=VALUE", help=help)
    return options


def list_ids(arguments: Sequence[str]) -> None:
    """Print every id, one a line."""
    parser("list", "List the ids of all environments.", takes_environment=False).read(arguments)
    print("\n".join(list_envs()))


def describe(arguments: Sequence[str]) -> None:
    """Print the page of an environment, Markdown."""
    options = parser("describe", "Show actions, observations and parameters of an environment.").read(arguments)
    from wavegym.envs.describe import describe as page

    print(page(options.env, **settings(options.set)))


def check(arguments: Sequence[str]) -> None:
    """Check an environment; the first defect is an error."""
    text = "Check that the native vector environment does exactly what Gymnasium's SyncVectorEnv does."
    options = parser("check", text).read(arguments)
    from wavegym.testing import check_vector_env

    env_id = full_id(options.env)
    check_vector_env(env_id, **settings(options.set))
    print(f"{env_id} passed all checks")
