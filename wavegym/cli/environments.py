"""The subcommands ``list``, ``describe`` and ``check``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from wavegym.core.command_line import Parser, named_values
from wavegym.core.errors import InputError
from wavegym.registration import full_id, list_envs

ENVIRONMENT = "id of the environment, with or without wavegym/; or a scenario file, FILE.toml, that names its id"


def read_environment(env: str, pairs: Sequence[str]) -> tuple[str, dict[str, Any]]:
    """The full id, and the parameters from the scenario file ``env``, if it is one, and from ``NAME=VALUE`` pairs.

    Raises:
        InputError: no such environment (nearest named), a pair that is none, or a file without an id.
    """
    given = named_values(pairs)
    if not env.endswith(".toml"):
        return full_id(env), given
    from wavegym.envs.scenario import read_scenario

    named = read_scenario(env).id
    if named is None:
        raise InputError(f'scenario {env!r} names no id, expected id = "..." in it, or ID --set scenario={env}')
    return named, {"scenario": env, **given}


def add_environment(options: Parser) -> None:
    """Add the environment and --set, its parameters."""
    options.add_argument("env", metavar="ENV", help=ENVIRONMENT)
    text = "parameters of the environment that replace its defaults"
    options.add_argument("--set", nargs="+", action="extend", default=[], metavar="NAME=VALUE", help=text)


def parser(name: str, description: str, takes_environment: bool = True) -> Parser:
    """The options of one of these subcommands."""
    options = Parser(prog=f"wavegym {name}", description=description)
    if takes_environment:
        add_environment(options)
    return options


def list_ids(arguments: Sequence[str]) -> None:
    """Print every id, one a line."""
    parser("list", "List the ids of all environments.", takes_environment=False).read(arguments)
    print("\n".join(list_envs()))


def describe(arguments: Sequence[str]) -> None:
    """Print the page of an environment, Markdown, or its scenario file, TOML."""
    read = parser("describe", "Show actions, observations and parameters of an environment.")
    read.add_argument("--toml", action="store_true", help="write all parameters as a scenario file instead")
    options = read.read(arguments)
    env_id, given = read_environment(options.env, options.set)
    if options.toml:
        from wavegym.envs.scenario import scenario_toml

        print(scenario_toml(env_id, **given), end="")
        return
    from wavegym.envs.describe import describe as page

    print(page(env_id, **given))


def check(arguments: Sequence[str]) -> None:
    """Check an environment; the first defect is an error."""
    text = "Check that the native vector environment does exactly what Gymnasium's SyncVectorEnv does."
    options = parser("check", text).read(arguments)
    from wavegym.testing import check_vector_env

    env_id, given = read_environment(options.env, options.set)
    check_vector_env(env_id, **given)
    print(f"{env_id} passed all checks")
