"""What all rules share: constants settled once, then a choice that planners may make for thousands of beliefs."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.capabilities import Capability
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.schedulers.myopic import require


class Heuristic:
    """The allowed candidate of the greatest value.

    A planner that follows a rule in simulated futures calls ``settle`` once, at the belief it starts from, and
    ``choose`` at every simulated one.

    Attributes:
        name: what it is called on command lines.
        needs: what the system must offer.
    """

    name: str = "rule"
    needs: tuple[type[Capability], ...] = ()

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError where the system lacks what the rule needs."""
        for kind in self.needs:
            require(self.name, system, kind)
        self.system: Any = system
        self.candidates = system.candidates()

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        return self.choose(belief, mask, self.settle(belief))

    def settle(self, belief: Any) -> Array | None:
        """What is settled at a belief and held in the futures simulated from it, (env, ...); None for nothing."""
        return None

    def choose(self, belief: Any, mask: Array | None, settled: Array | None) -> Array:
        """Actions (env, ...).

        Args:
            belief: beliefs, axis 0 = environment.
            mask: allowed actions (env, candidate), or None.
            settled: what ``settle`` returned, a row for each environment.
        """
        raise NotImplementedError


class Held(Heuristic):
    """Any policy that reads nothing but the belief, with the two methods of a rule.

    Args:
        policy: whose choices are taken.
    """

    def __init__(self, policy: Policy) -> None:
        self.policy = policy

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self.policy.begin(system, num_envs, rng)

    def choose(self, belief: Any, mask: Array | None, settled: Array | None) -> Array:
        """See ``Heuristic``."""
        return self.policy.act(belief, None, mask)


def greatest(values: Array, mask: Array | None, burden: Array) -> Array:
    """Index (env,) of the greatest value allowed; of equal ones that of least ``burden``, of those the first.

    Args:
        values: (env, candidate).
        mask: (env, candidate) bool, or None.
        burden: (env, candidate) or (candidate,), such as the delay: where nothing gains anything, nothing is changed.
    """
    if mask is not None:
        values = np.where(mask, values, -np.inf)
    is_best = values == values.max(axis=1, keepdims=True)
    if mask is not None:
        is_best = is_best & mask
    return np.argmin(np.where(is_best, burden, np.inf), axis=1)
