"""Any scheduler or agent in a user's own loop."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.core.policy import Clairvoyant, Policy
from wavegym.core.system import System
from wavegym.core.worlds import tuning_tapes, word
from wavegym.observations.observer import Observer
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.rollout import allowed


class PolicyInLoop:
    """A policy that follows an environment: called without arguments, it returns the actions for this moment.

    Episodes may begin and end at different steps. The clairvoyant ``optimum`` is shown the worlds.

    Args:
        envs: the native vector environment.
        policy: the name of a scheduler, as ``wavegym evaluate --policies`` takes it; or a Policy, such as
            ``wavegym.load_agent`` returns.
        seed: of the policy's own random numbers, and of the worlds on which a scheduler without recorded constants is
            tuned.
        is_single: whether the axis of the environments is left out of the actions.

    Raises:
        InputError: no such scheduler (nearest named), one that this system cannot have, or no Policy; an environment
            whose actions are ranks in a short list.
    """

    def __init__(self, envs: Any, policy: str | Policy, seed: int = 0, is_single: bool = False) -> None:
        if shortlist := envs.episodes.observer.shortlist:
            wanted = (
                "an environment without it: policies name actions, not ranks (nearest: rank 0 is the choice of myopic)"
            )
            raise InputError(f"candidates is {shortlist.count}, expected {wanted}")
        self._envs, self._is_single = envs, is_single
        self._given, self._seed = policy, check_int("seed", seed, 0)
        self._begin(envs.system)

    def _begin(self, system: System) -> None:
        """Take up the policy for this system."""
        policy = self._given
        if isinstance(policy, str):
            policy = make_policy(policy, system, tuning_tapes(system.belief_model, self._seed))
        if isinstance(policy, type) or not isinstance(policy, Policy):
            raise InputError(f"policy is {policy!r}, expected the name of a scheduler, or a Policy with begin and act")
        self._system, self._policy, self._observer = system, policy, Observer(system)
        policy.begin(system, self._envs.num_envs, np.random.default_rng([word("policy"), self._seed]))

    def __call__(self) -> Array:
        """Actions (env, ...), or one action of a single environment.

        Raises:
            InputError: before the first reset.
        """
        system, belief = self._envs.system, self._envs.belief
        if system is not self._system:  # new parameters since the last reset
            self._begin(system)
        if isinstance(self._policy, Clairvoyant) and (belief.step == 0).any():
            self._policy.reveal(self._envs.world)
        observation, _ = self._observer(belief)
        actions = self._policy.act(belief, observation, allowed(system, belief))
        return actions[0] if self._is_single else actions
