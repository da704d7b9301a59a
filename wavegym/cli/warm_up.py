"""The subcommand ``warm-up``: compile the numerical kernels of environments before they are first needed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from wavegym.core.command_line import Parser
from wavegym.core.errors import InputError
from wavegym.registration import full_id, list_envs, registered_system

POLICIES = ("random", "myopic")
PLANNER = "dwell-rollout:1"  # others call what the policies and ``prediction_defect`` call
STEPS = 3


def parser() -> Parser:
    """The options."""
    options = Parser(
        prog="wavegym warm-up",
        description="Compile the numerical kernels of environments, once for an installation, so that later the first "
        "steps, and the first decisions of planners, take no longer than others.",
    )
    options.add_argument("ids", nargs="*", metavar="ENV", help="environments (default: all)")
    options.add_argument("--jobs", type=int, default=-1, metavar="J", help="processes (default: one for each core)")
    return options


def warm_up(arguments: Sequence[str]) -> None:
    """Play a few steps of each environment, and print the seconds that it took."""
    options = parser().read(arguments)
    ids = [full_id(name) for name in options.ids] or list_envs()
    from tqdm import tqdm

    from wavegym.core.work import Call, run_all

    begun, families = time.monotonic(), _families(ids)
    with tqdm(total=len(families), desc="compiling", unit="package", disable=None) as bar:
        taken = run_all([Call(warmed, (family,)) for family in families], options.jobs, bar.update)
    for family, times in zip(families, taken, strict=True):
        for env_id, seconds in zip(family, times, strict=True):
            print(f"{env_id}: {seconds:.1f} s")
    print(f"all: {time.monotonic() - begun:.1f} s")


def _families(ids: Sequence[str]) -> list[list[str]]:
    """The environments of each package together: they share kernels, which one process then compiles once."""
    families: dict[str, list[str]] = {}
    for env_id in ids:
        system, _ = registered_system(env_id)
        module = system if isinstance(system, str) else system.__module__
        families.setdefault(module.partition(":")[0].rpartition(".")[0], []).append(env_id)
    return list(families.values())


def warmed(ids: Sequence[str]) -> list[float]:
    """Step environments one after another; the seconds that each takes until all its kernels are compiled."""
    times = []
    for env_id in ids:
        begun = time.monotonic()
        _step(env_id)
        times.append(time.monotonic() - begun)
    return times


def _step(env_id: str) -> None:
    """Step an environment single and in a batch, decide as the common policies do, and call what planners call."""
    import gymnasium as gym

    from wavegym.schedulers.tuned_constants import SIMPLE, recorded
    from wavegym.testing.check import prediction_defect

    single: Any = gym.make(env_id, disable_env_checker=True)
    envs: Any = gym.make_vec(env_id, num_envs=2)
    is_tuned = SIMPLE in recorded(single.unwrapped.system)  # otherwise it would be tuned now, which may take hours
    names = (*POLICIES, SIMPLE, PLANNER) if is_tuned else POLICIES
    for each in (single, envs):
        each.reset(seed=0)
        for name in names:
            try:
                policy = each.unwrapped.policy(name)
            except (InputError, NotImplementedError):  # no such policy for this system
                continue
            each.reset(seed=0)
            for _ in range(STEPS):
                each.step(policy())
        each.close()
    with suppress(Exception):  # steps work; a defect in what planners call is for `wavegym check` to report
        prediction_defect(single.unwrapped.system)
