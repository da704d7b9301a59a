"""Time per decision: of an agent for a single environment, of the best planner for one and for a batch."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.core.trees import first
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.observations.observer import Observer
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.rollout import allowed
from wavegym.schedulers.tuned_constants import PLANNER

BATCH = 50  # environments for which the planner decides together, as in ``make headroom``
STEPS = 6  # of the timed episodes
SINGLES = 100  # decisions of each agent in each of these steps
PLANS = 3  # single decisions of the planner in each of these steps
ALONE = f"{PLANNER} alone"


def decisions_us(system: System, agents: Mapping[str, tuple[System, Policy]], seed: int = 0) -> dict[str, float]:
    """Microseconds per decision by name; medians over the first steps of episodes.

    ``PLANNER`` is the planner's time in a batch, divided by the number of environments. ``ALONE`` is its time for a
    single environment, as for the agents. All policies take turns, because the speed of a machine changes from second
    to second and the ratio counts.

    Args:
        system: the planner's system.
        agents: each with its own system, which may have other actions. Their times include the observation.
        seed: of the tuning worlds.
    """
    worlds = draw_worlds(system, world_seeds(seed, "tune", BATCH))
    state, (planner, alone) = system.initial(worlds), (make_policy(PLANNER, system, None) for _ in range(2))
    planner.begin(system, BATCH, np.random.default_rng(seed))
    observers = {name: Observer(own) for name, (own, _) in agents.items()}
    for own, policy in ((system, alone), *agents.values()):
        policy.begin(own, 1, np.random.default_rng(seed))
    took: dict[str, list[float]] = {name: [] for name in (PLANNER, ALONE, *agents)}
    for _ in range(min(STEPS, system.horizon)):
        mask, one, begun = allowed(system, state.belief), first(state.belief, 1), perf_counter()
        action = planner.act(state.belief, None, mask)
        took[PLANNER].append((perf_counter() - begun) / BATCH)
        took[ALONE].append(_median(PLANS, partial(alone.act, one, None, allowed(system, one))))
        for name, (own, policy) in agents.items():
            decide = partial(_observe_and_act, policy, observers[name], one, allowed(own, one))
            took[name].append(_median(SINGLES, decide))
        state = system.transition(state, action, worlds)
    return {name: 1e6 * float(np.median(seconds)) for name, seconds in took.items()}


def _observe_and_act(policy: Policy, observer: Observer, belief: Any, mask: Array | None) -> None:
    policy.act(belief, observer(belief)[0], mask)


def _median(times: int, decide: Callable[[], Any]) -> float:
    """Median seconds of ``times`` calls."""
    took = []
    for _ in range(times):
        begun = perf_counter()
        decide()
        took.append(perf_counter() - begun)
    return float(np.median(took))
