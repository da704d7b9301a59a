"""The subcommand ``warm-up``: compile the numerical kernels of environments before they are first needed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from wavegym.core.command_line import Parser
from wavegym.core.errors import InputError
from wavegym.registration import full_id, list_envs

POLICIES = ("random", "myopic", "best-simple")
STEPS = 3


def parser() -> Parser:
    """The options."""
    options = Parser(
        prog="wavegym warm-up",
        description="Compile the numerical kernels of environments, once for an installation, so that later the first "
        "steps take no longer than others.",
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

    begun = time.monotonic()
    with tqdm(total=len(ids), desc="compiling", unit="environment", disable=None) as bar:
        taken = run_all([Call(warmed, (env_id,)) for env_id in ids], options.jobs, bar.update)
    for env_id, seconds in zip(ids, taken, strict=True):
        print(f"{env_id}: {seconds:.1f} s")
    print(f"all: {time.monotonic() - begun:.1f} s")


def warmed(env_id: str) -> float:
    """Step an environment single and in a batch, and decide as the common policies do; the seconds until then."""
    import gymnasium as gym

    begun = time.monotonic()
    single: Any = gym.make(env_id, disable_env_checker=True)
    envs: Any = gym.make_vec(env_id, num_envs=2)
    for each in (single, envs):
        each.reset(seed=0)
        for name in POLICIES:
            try:
                policy = each.unwrapped.policy(name)
            except (InputError, NotImplementedError):  # no such policy for this system
                continue
            each.reset(seed=0)
            for _ in range(STEPS):
                each.step(policy())
        each.close()
    return time.monotonic() - begun
