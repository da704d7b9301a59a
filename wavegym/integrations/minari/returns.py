"""The return of every action: a simulator can play each alternative in the same world."""

from __future__ import annotations

import numpy as np

from wavegym.core import trees
from wavegym.core.action_sets import FiniteSet, ParameterBox
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.policy import Policy
from wavegym.core.system import State, System
from wavegym.core.worlds import word
from wavegym.envs.vector import endings
from wavegym.observations.observer import Observer
from wavegym.schedulers.rollout import allowed


class ReturnsOfAll:
    """The return of every action at a step, if a policy chooses from the next step on: minus the sum of the costs.

    All alternatives meet the same world: the same motion, noise and clutter. They are returns of this one episode, not
    their expectation.

    Args:
        system: the closed loop.
        policy: chooses after the first step. It begins anew at every step, so one with a memory starts empty.
        max_episode_steps: truncation before the system's own end, or None.

    Raises:
        InputError: the actions are points of a box, or every sensor has an action of its own.
    """

    def __init__(self, system: System, policy: Policy, max_episode_steps: int | None) -> None:
        actions: FiniteSet | ParameterBox = system.actions
        count = 0 if isinstance(actions, ParameterBox) else len(system.candidates())
        if count == 0 or system.candidates().ndim > 1:
            raise InputError(f"{type(system).__name__}'s action is no single index, expected one for `all_returns` "
                             "(nearest: a setting such as action='joint')")  # fmt: skip
        self._system, self._policy = system, policy
        self._count, self._observer, self._limit = count, Observer(system), max_episode_steps

    def __call__(self, state: State, world: object) -> Array:
        """Returns (env, action) from ``state`` on; NaN for a masked action."""
        system, envs = self._system, len(state.belief.step)
        mask = system.mask(state.belief)
        wanted = np.tile(np.arange(self._count), (envs, 1))
        tried = np.where(mask, wanted, mask.argmax(axis=1)[:, None]).ravel()  # a masked action is not played
        state, world = trees.repeated(state, self._count), trees.repeated(world, self._count)
        self._policy.begin(system, envs * self._count, np.random.default_rng(word("policy")))
        total = np.zeros(envs * self._count)
        action = tried
        while not (over := np.logical_or(*endings(system, state.belief, self._limit))).all():
            state = system.transition(state, action, world)
            total -= np.where(over, 0.0, system.cost(state.belief))
            observation, _ = self._observer(state.belief)
            action = self._policy.act(state.belief, observation, allowed(system, state.belief))
        return np.where(mask, total.reshape(envs, self._count), np.nan)
