"""What a decision takes: a learned one for a single environment, the best planner's in a batch."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter
from typing import Any

import numpy as np

from wavegym.envs.observer import Observer
from wavegym.evaluation.worlds import draw_worlds, world_seeds
from wavegym.schedulers.names import make_policy
from wavegym.schedulers.policy import Policy
from wavegym.schedulers.rollout import allowed
from wavegym.schedulers.settled import PLANNER
from wavegym.systems.contract import System
from wavegym.systems.trees import first

BATCH = 50  # environments for which the planner decides at once, as in ``make headroom``
STEPS = 6  # of the episodes that it plays
SINGLES = 100  # decisions of each agent in each of these steps


def decisions_us(system: System, agents: Mapping[str, tuple[System, Policy]], seed: int = 0) -> dict[str, float]:
    """Microseconds of one decision by name, the planner's among them; medians over the first steps of episodes.

    In turns, because a machine's speed changes from second to second and it is the ratio that counts.

    Args:
        system: that in which the planner plays.
        agents: each with its own system, which has other actions, perhaps; what they observe is included.
        seed: of the worlds, which are for tuning.
    """
    worlds = draw_worlds(system, world_seeds(seed, "tune", BATCH))
    state, planner = system.begin(worlds), make_policy(PLANNER, system, None)
    planner.begin(system, BATCH, np.random.default_rng(seed))
    observers = {name: Observer(own) for name, (own, _) in agents.items()}
    for own, policy in agents.values():
        policy.begin(own, 1, np.random.default_rng(seed))
    took: dict[str, list[float]] = {name: [] for name in (PLANNER, *agents)}
    for _ in range(min(STEPS, system.horizon)):
        mask, begun = allowed(system, state.public), perf_counter()
        action = planner.act(state.public, None, mask)
        took[PLANNER].append((perf_counter() - begun) / BATCH)
        for name, (_, policy) in agents.items():
            took[name].append(_single(policy, observers[name], first(state.public, 1)))
        state = system.advance(state, action, worlds)
    return {name: 1e6 * float(np.median(seconds)) for name, seconds in took.items()}


def _single(policy: Policy, observer: Observer, public: Any) -> float:
    """Seconds of a decision, the median of many."""
    took = []
    for _ in range(SINGLES):
        begun = perf_counter()
        policy.act(public, observer(public)[0], None)
        took.append(perf_counter() - begun)
    return float(np.median(took))
