"""The agents' policies as one policy, to be played and compared with schedulers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.system import System
from wavegym.evaluation.adapters import FunctionPolicy, PredictPolicy, as_policy
from wavegym.integrations.pettingzoo.views import AgentViews
from wavegym.observations.observer import Observer


class TeamPolicy:
    """A ``Policy`` in which every agent chooses its part of the action from its part of the observation.

    Args:
        members: for each agent a function (observation) -> actions, of observations (env, own fields) float32 and
            actions (env,) or (env, own parameters); or an object with ``predict``, such as a model of
            Stable-Baselines3, which is asked for its deterministic actions.
        sees: the setting of the environment in which the agents were trained, "own" or "all".

    Raises:
        InputError: a member that is neither.
    """

    def __init__(self, members: Mapping[str, Callable[[Array], Any] | Any], *, sees: str = "own") -> None:
        self.sees = sees
        self.members = {name: _member(given, name) for name, given in members.items()}

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``.

        Raises:
            InputError: the system's agents have other names, or there are none; or ``sees`` is unknown.
        """
        self._views, self._observer = AgentViews(system, self.sees), Observer(system)
        if set(self.members) != set(self._views.names):
            raise InputError(f"members are {sorted(self.members)}, expected one for each of {self._views.names}")
        for member in self.members.values():
            member.forget()

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``.

        Raises:
            InputError: a member's actions have the wrong shape or type, or lie outside its library.
        """
        if observation is None:
            observation, _ = self._observer(belief)
        shares = self._views.shares(observation)
        actions = {name: member.answer(shares[name], belief, None) for name, member in self.members.items()}
        return self._views.joined(actions, len(observation))


def _member(given: Any, name: str) -> FunctionPolicy | PredictPolicy:
    """One agent's policy. InputError for anything that does not choose from observations."""
    member = as_policy(given, name=name) if callable(given) or hasattr(given, "predict") else None
    if not isinstance(member, (FunctionPolicy, PredictPolicy)):
        raise InputError(
            f"member {name!r} is {given!r}, expected a function of the observation or an object with predict"
        )
    return member
