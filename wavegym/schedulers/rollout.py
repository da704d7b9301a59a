"""Play a policy on given worlds without an environment: for references, tuning and bounds."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.policy import Clairvoyant, Policy
from wavegym.core.system import System
from wavegym.core.traits import UnequalSteps


class Rollout(NamedTuple):
    """Costs, lengths and actions of the episodes played."""

    cost: Array  # (env, H) cost after each step; 0 after an early end
    steps: Array  # (env,) steps to the episode's end
    span: Array  # (env,) the divisor of the mean cost: steps, or seconds if steps differ in length
    actions: Array  # (env, H, ...)

    @property
    def mean_cost(self) -> Array:
        """Mean cost per step, or per second where steps differ in length, (env,)."""
        return self.cost.sum(axis=1) / self.span


def allowed(system: System, belief: Any) -> Array | None:
    """The mask as policies take it: None where every action is allowed."""
    if type(system).mask is System.mask:
        return None
    return system.mask(belief)


def rollout(system: System, policy: Policy, world: Any, rng: np.random.Generator | None = None) -> Rollout:
    """Play ``policy`` to the end on ``world`` (axis 0 = environment).

    For policies that read the belief: the observation is None.
    """
    state = system.initial(world)
    policy.begin(system, len(state.belief.step), rng or np.random.default_rng(0))
    if isinstance(policy, Clairvoyant):
        policy.reveal(world)
    costs, actions, steps = [], [], np.zeros(len(state.belief.step), np.int64)
    span = np.zeros(len(steps))
    for _ in range(system.horizon):
        over = system.terminal(state.belief)
        if over.all():
            break
        steps += ~over
        action = policy.act(state.belief, None, allowed(system, state.belief))
        state = system.transition(state, action, world)
        costs.append(np.where(over, 0.0, system.cost(state.belief)))
        span += np.where(over, 0.0, step_lengths(system, state.belief))
        actions.append(action)
    return Rollout(np.stack(costs, axis=1), steps, span, np.stack(actions, axis=1))


def check_equal_steps(what: str, system: System) -> None:
    """Raise an InputError unless all steps have the same length, for ``what`` compares costs of numbers of steps."""
    if isinstance(system, UnequalSteps):
        raise InputError(f"{what} counts steps, expected steps of one length (nearest: 'gain-per-second')")


def step_lengths(system: System, belief: Any) -> Array:
    """How much the last step counts in a mean over an episode, (env,): 1, or its seconds where steps differ."""
    if isinstance(system, UnequalSteps):
        lengths: Array = system.duration(belief)
        return lengths
    return np.ones(len(belief.step))
