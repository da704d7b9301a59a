"""The protocol of all policies: schedulers, planners, learned policies."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import System


@runtime_checkable
class Policy(Protocol):
    """Chooses the actions of a batch of environments."""

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """Prepare for a batch of new episodes; a policy's own randomness, if any, comes from ``rng``."""

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """Actions (env, ...).

        Args:
            belief: the belief, for schedulers.
            observation: scaled observations (env, fields), for learned policies. None without an environment.
            mask: allowed actions (env, actions), or None where every action is allowed.
        """


@runtime_checkable
class Clairvoyant(Policy, Protocol):
    """A policy that knows the world before it acts: a bound for other policies, never a scheduler."""

    def reveal(self, world: Any) -> None:
        """Receive the worlds that will be played (axis 0 = environment); called once after ``begin``."""


@runtime_checkable
class Trained(Policy, Protocol):
    """A policy that knows the range of what it observed in its training."""

    def is_outside_training(self) -> Array | None:
        """Whether the observations of its last decision were outside that range, (env,) bool; None: no record."""
