"""The subcommands ``list``, ``describe``, ``check`` and ``policies``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from wavegym.core.command_line import Parser, named_values
from wavegym.core.errors import InputError
from wavegym.registration import full_id, list_envs

if TYPE_CHECKING:
    from wavegym.core.system import System
    from wavegym.evaluation.play import Task

ENVIRONMENT = "id of the environment, with or without wavegym/; or a scenario file, FILE.toml, that names its id"
EXAMPLES = {"K": "0", "H": "2", "L": "2", "W": "2", "N": "1", "M": "1"}  # for the capital letters of the names
TUNED = ("best-fixed", "tuned-constant", "tuned-cycle")  # on tuning worlds, as soon as they are made
WHY = re.compile(
    r"policy '\S+' (?:cannot be computed|is not) for \w+(?: in this form| with action=\S+)?[:,] (.*)"
    r"|.* (?:counts steps|cannot score the actions of \w+), (expected .*)"
)
SETTING = re.compile(r"nearest: the settings? (.*) of its training")
BESIDE = """A planner takes another base policy after an @: rollout:20@myopic. Further policies: the folder of a trained
run (or of several runs, one for each seed); an ONNX file (FILE.onnx); with --trust, a model of Stable-Baselines3
(FILE.zip) or package.module:factory."""


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


def environment_parser(name: str, description: str, takes_environment: bool = True) -> Parser:
    """The options of a subcommand of one environment."""
    options = Parser(prog=f"wavegym {name}", description=description)
    if takes_environment:
        options.add_argument("env", metavar="ENV", help=ENVIRONMENT)
        text = "parameters of the environment that replace its defaults"
        options.add_argument("--set", nargs="+", action="extend", default=[], metavar="NAME=VALUE", help=text)
    return options


def list_ids(arguments: Sequence[str]) -> None:
    """Print every id, one a line."""
    environment_parser("list", "List the ids of all environments.", takes_environment=False).read(arguments)
    print("\n".join(list_envs()))


def describe(arguments: Sequence[str]) -> None:
    """Print the page of an environment, Markdown, or its scenario file, TOML."""
    read = environment_parser("describe", "Show actions, observations and parameters of an environment.")
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
    text = (
        "Check that the vector environment does exactly what Gymnasium's SyncVectorEnv does, "
        "and that the predictions, the cost and the shortcuts of its system agree."
    )
    options = environment_parser("check", text).read(arguments)
    from wavegym.testing import check_vector_env

    env_id, given = read_environment(options.env, options.set)
    check_vector_env(env_id, **given)
    print(f"{env_id} passed all checks")


def policies(arguments: Sequence[str]) -> None:
    """Print the policies of an environment: name, meaning, and whether it applies."""
    text = "List the policies that evaluate and play take in an environment."
    read = environment_parser("policies", text).read(arguments)
    from wavegym.evaluation import make_task

    task = make_task(*read_environment(read.env, read.set))
    rows = [(name, meaning, f"no: {why}" if why else "yes") for name, meaning, why in listed(task)]
    rows.insert(0, ("policy", "meaning", f"applies to {task.env_id}"))
    names, meanings = (max(len(row[column]) for row in rows) for column in (0, 1))
    print("\n".join(f"{name:<{names}}  {meaning:<{meanings}}  {applies}" for name, meaning, applies in rows))
    print(f"\n{BESIDE}")


def listed(task: Task) -> Iterator[tuple[str, str, str]]:
    """Every name with its meaning, and why it does not apply; "" where it does. Nothing is tuned."""
    from wavegym.core import shortcuts
    from wavegym.evaluation.adapters import AGENTS
    from wavegym.schedulers.registry import MEANINGS, SCHEDULERS

    for name, meaning in MEANINGS.items():
        yield name, meaning, why_not(name, task.system)
    for name, (scheduler, changed) in shortcuts.baselines(task.system).items():
        yield name, f"{scheduler} with {', '.join(f'{key}={value!r}' for key, value in changed.items())}", ""
    for name in AGENTS:
        yield name, "the trained agent that comes with the environment", _no_agent(name, task)
    for name in SCHEDULERS.names():
        if name not in SCHEDULERS.own:
            yield name, "registered by a package", ""


def why_not(name: str, system: System) -> str:
    """Why a scheduler cannot be had for this system, in a few words; "" if it can.

    It is made, begun and, unless it plans, asked for one action, in one tuning world.

    Args:
        name: one of ``MEANINGS``.
        system: the closed loop.
    """
    from wavegym.core.worlds import draw_worlds, world_seeds

    try:
        _try(name, system, draw_worlds(system, world_seeds(0, "tune", 1)))
    except (InputError, NotImplementedError) as error:
        return _reason(str(error) or "the system does not implement it")
    return ""


def _reason(text: str) -> str:
    """An error in a few words: without the policy's name, the system's and the nearest choice."""
    if needed := SETTING.search(text):
        return f"needs {needed[1]}"
    found = WHY.fullmatch(text)
    why = found[1] or found[2] if found else text
    return re.sub(r"^expected ", "needs ", re.sub(r"[;,]? \(?nearest: .*$", "", why))


def _try(name: str, system: System, tape: Any) -> None:
    """Raise an InputError or NotImplementedError where the scheduler cannot be had."""
    import numpy as np

    from wavegym.core import shortcuts
    from wavegym.core.policy import Clairvoyant
    from wavegym.schedulers.heuristics.grids import HEURISTICS
    from wavegym.schedulers.myopic import Myopic
    from wavegym.schedulers.registry import PLANNERS, PLANS, make_policy
    from wavegym.schedulers.rollout import allowed
    from wavegym.schedulers.tuned_constants import PLANNER, SIMPLE, check, planner_name

    name = planner_name(system) if name == PLANNER else name
    family, _, letter = name.partition(":")
    if name == "fixed:NAME":
        if not shortcuts.named_constants(system):
            raise InputError("it names no constants")
        return
    if name in TUNED:
        shortcuts.constants(system)
    elif name in HEURISTICS:
        check(name, system, tape)
    elif name != SIMPLE:
        heuristic = HEURISTICS["searched-dwell"]
        base = heuristic.make(**heuristic.start) if family == "dwell-rollout" else Myopic()
        policy = make_policy(f"{family}:{EXAMPLES[letter]}" if letter in EXAMPLES else name, system, tape, base)
        policy.begin(system, 1, np.random.default_rng(0))
        if family not in (*PLANNERS, *PLANS) and not isinstance(policy, Clairvoyant):
            belief = system.initial(tape).belief
            policy.act(belief, None, allowed(system, belief))


def _no_agent(name: str, task: Task) -> str:
    """Why the environment's trained agent cannot play here; "" if it can."""
    from wavegym.evaluation.adapters import as_policies

    try:
        as_policies(name, task, name)
    except InputError as error:
        return "none comes with it" if "of which none is saved" in str(error) else _reason(str(error))
    return ""
