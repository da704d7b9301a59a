"""The base class of heuristics: a choice that planners may make for thousands of beliefs."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.policy import Policy
from wavegym.core.shortcuts import Shortcut
from wavegym.core.system import System
from wavegym.schedulers.myopic import require


class Heuristic:
    """Base class: a heuristic chooses the allowed candidate of the greatest value.

    A planner that follows a heuristic in simulated futures calls ``prepare`` once, at the root belief, and ``choose``
    at every simulated belief.

    Attributes:
        name: the name on command lines.
        needs: the shortcuts and traits that the system must have.
    """

    name: str = "heuristic"
    needs: tuple[Shortcut[..., Any] | type, ...] = ()

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError where the system lacks one of ``needs``."""
        for kind in self.needs:
            require(self.name, system, kind)
        self.system: Any = system
        self.candidates = system.candidates()

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        return self.choose(belief, mask, self.prepare(belief))

    def prepare(self, belief: Any) -> Array | None:
        """Values computed at a belief and kept in all futures simulated from it, (env, ...); None without any."""
        return None

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """Actions (env, ...).

        Args:
            belief: beliefs, axis 0 = environment.
            mask: allowed actions (env, candidate), or None.
            prepared: the result of ``prepare``, a row for each environment.
        """
        raise NotImplementedError


class PolicyAsHeuristic(Heuristic):
    """A policy that reads only the belief, as a heuristic.

    Args:
        policy: makes the choices.
    """

    def __init__(self, policy: Policy) -> None:
        self.policy = policy

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self.policy.begin(system, num_envs, rng)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        return self.policy.act(belief, None, mask)


def greatest(values: Array, mask: Array | None, burden: Array) -> Array:
    """Index (env,) of the greatest allowed value; among equals the one of least ``burden``, then the first.

    Args:
        values: (env, candidate).
        mask: (env, candidate) bool, or None.
        burden: (env, candidate) or (candidate,), such as the delay: without any gain the set-up stays.
    """
    if mask is not None:
        values = np.where(mask, values, -np.inf)
    is_best = values == values.max(axis=1, keepdims=True)
    if mask is not None:
        is_best = is_best & mask
    return np.argmin(np.where(is_best, burden, np.inf), axis=1)
