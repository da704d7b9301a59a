"""The one protocol of everything that chooses: schedulers, planners, learned policies."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import System


@runtime_checkable
class Policy(Protocol):
    """Chooses for a batch of environments at once."""

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """Get ready for a batch of fresh episodes; a policy's own randomness, if any, comes from ``rng``."""

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """Actions (env, ...).

        Args:
            belief: the belief; a scheduler reads this.
            observation: what agents see, (env, elements); a learned policy reads this. None where there is no shell.
            mask: allowed actions (env, actions), or None where every action is allowed.
        """


@runtime_checkable
class Clairvoyant(Policy, Protocol):
    """A policy that is shown the world before it acts: a bound for others, never a scheduler."""

    def reveal(self, world: Any) -> None:
        """Take notice of the tapes that will be played (axis 0 = environment); called once after ``begin``."""
