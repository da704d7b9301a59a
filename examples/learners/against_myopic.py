"""The command of every example: train, then play on test worlds against the one-step scheduler."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from time import perf_counter
from typing import Any

from wavegym.evaluation import compare, summarise

DEFAULT = "wavegym/KershawEvansPosition-v0"


def percent_over_myopic(env_id: str, policy: Any, worlds: int = 200, **settings: Any) -> float:
    """Mean cost of a policy relative to ``myopic`` on the same worlds, in percent; below 0 is better."""
    summary = summarise(compare(env_id, {"learner": policy}, worlds=worlds, jobs=1, progress=False, **settings))
    cost = {name: entry["cost"]["mean"] for name, entry in summary["policies"].items()}
    return 100.0 * (cost["learner"] / cost["myopic"] - 1.0)


def main(train: Callable[[str, int, int], Any], steps: int, **settings: Any) -> None:
    """Read the options, train, compare, print.

    Args:
        train: a function of the environment's id, the number of steps and the seed; returns anything that
            ``wavegym.evaluation.as_policy`` takes.
        steps: default number of environment steps.
        **settings: of the environment in which the policies play.
    """
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--env", default=DEFAULT)
    options.add_argument("--steps", type=int, default=steps)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--worlds", type=int, default=200)
    given = options.parse_args()
    start = perf_counter()
    policy = train(given.env, given.steps, given.seed)
    seconds = perf_counter() - start
    percent = percent_over_myopic(given.env, policy, given.worlds, **settings)
    print(f"{given.env}: {percent:+.1f} % of the cost of myopic after {given.steps} steps in {seconds:.0f} s")
