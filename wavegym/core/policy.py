"""Who chooses: the protocol of policies, and the decision makers that a system declares or its action set shows."""

from __future__ import annotations

import re
from typing import Any, Protocol, runtime_checkable

import numpy as np

from wavegym.core.action_sets import ActionSet, ParameterBox, sensor_count
from wavegym.core.arrays import Array
from wavegym.core.system import System
from wavegym.core.traits import DecisionMaker, DecisionMakers


@runtime_checkable
class Policy(Protocol):
    """Chooses the actions of a batch of environments."""

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """Prepare for a batch of new episodes; ``rng`` is the source of a policy's own randomness, if any."""

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
    """A policy with the range of its observations in training."""

    def is_outside_training(self) -> Array | None:
        """Whether the observations of its last decision were outside that range, (env,) bool; None: no record."""


def decision_makers(system: System) -> tuple[DecisionMaker, ...]:
    """Who chooses which part of the action; a single one where no action set of several sensors shows more.

    A system that does not declare ``DecisionMakers`` has those of ``makers_by_form``, and every observation field is
    shared.
    """
    return system.decision_makers if isinstance(system, DecisionMakers) else makers_by_form(system.actions)


def makers_by_form(actions: ActionSet, kind: str = "sensor") -> tuple[DecisionMaker, ...]:
    """The decision makers that the form of an action set shows, without observation fields of their own.

    A PerSensorLibrary and a JointLibrary have one for each sensor. So has a ParameterBox if the name of every parameter
    ends in the number of its sensor: ``duration_1``, ``sweep_1``, ``duration_2``, ``sweep_2``.

    Args:
        actions: the action set.
        kind: prefix of their names: ``"platform"`` gives platform_1, platform_2 and so on.
    """
    owned = _numbered(actions) if isinstance(actions, ParameterBox) else [()] * sensor_count(actions)
    return tuple(DecisionMaker(f"{kind}_{i}", parameters=names) for i, names in enumerate(owned, 1))


def _numbered(box: ParameterBox) -> list[tuple[str, ...]]:
    """The parameters of sensors 1, 2, ... by the number in which a name ends; all of one where a number is missing."""
    found: dict[int, list[str]] = {}
    for name in box.names:
        ends = re.search(r"_([1-9][0-9]*)$", name)
        found.setdefault(int(ends[1]) if ends else 0, []).append(name)
    if sorted(found) != list(range(1, len(found) + 1)):
        return [box.names]
    return [tuple(found[number]) for number in sorted(found)]
