"""The part of the observation that each agent of a system sees, and the part of the action that it chooses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from wavegym.core.action_sets import JointLibrary, ParameterBox, waveform_labels
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_choice
from wavegym.core.policy import decision_makers
from wavegym.core.system import ObservationField, System
from wavegym.observations.scaling import LIMIT

SEES = ("own", "all")


class AgentViews:
    """Splits observations among the decision makers of a system, and joins their actions.

    Args:
        system: a system with several decision makers; see ``wavegym.core.policy``.
        sees: "own" (an agent observes the fields of its own sensor, and the fields that belong to no sensor) or "all".

    Attributes:
        names: of the agents, in the order of the system's sensors.
        fields: the observation fields of each agent, in order.
        observation_spaces, action_spaces: of each agent: a Box; Discrete, or a Box of the agent's own parameters.

    Raises:
        InputError: a system with a single decision maker, or one that forbids joint actions; another ``sees``.
    """

    def __init__(self, system: System, sees: str = "own") -> None:
        self.system, self.sees = system, check_choice("sees", sees, SEES)
        makers, kind = decision_makers(system), type(system).__name__
        if len(makers) < 2:
            wanted = (
                "several, by a PerSensorLibrary, a JointLibrary, a ParameterBox of several sensors, or DecisionMakers"
            )
            raise InputError(f"{kind} has one decision maker, expected {wanted} (nearest: gym.make)")
        if system.strict and type(system).mask is not System.mask:
            wanted = "no mask, or strict = False: an agent cannot keep a limit on the actions of all"
            raise InputError(f"{kind} forbids joint actions by a mask, expected {wanted}")
        self.names = [maker.name for maker in makers]
        owner = {field: maker.name for maker in makers for field in maker.fields}
        listed = system.observation_fields
        seen = {
            name: [k for k, e in enumerate(listed) if sees == "all" or owner.get(e.name, name) == name]
            for name in self.names
        }
        self._columns = {name: np.array(columns) for name, columns in seen.items()}
        self.fields: dict[str, tuple[ObservationField, ...]] = {
            name: tuple(listed[k] for k in columns) for name, columns in seen.items()
        }
        self.observation_spaces = {
            name: spaces.Box(-LIMIT, LIMIT, (len(columns),), np.float32) for name, columns in seen.items()
        }
        self._parameters: dict[str, Array] = {}
        actions = system.actions
        if isinstance(actions, ParameterBox):
            self._parameters = {m.name: np.array([actions.names.index(p) for p in m.parameters]) for m in makers}
            self.action_spaces: dict[str, spaces.Space[Any]] = {
                name: spaces.Box(-1.0, 1.0, own.shape, np.float32) for name, own in self._parameters.items()
            }
        else:
            self._count = len(waveform_labels(actions))
            self.action_spaces = {name: spaces.Discrete(self._count) for name in self.names}

    def check_observation(self, space: spaces.Space[Any]) -> None:
        """Raise an InputError for an environment whose observations hold more than the system's fields: forecasts."""
        if space.shape != (len(self.system.observation_fields),):
            wanted = "False: a forecast is of one candidate for all sensors, which is no agent's own"
            raise InputError(f"forecasts is True, expected {wanted}")

    def shares(self, observation: Array) -> dict[str, Array]:
        """Each agent's fields (..., own fields) of observations (..., fields); fresh arrays."""
        return {name: observation.take(columns, axis=-1) for name, columns in self._columns.items()}

    def joined(self, actions: Mapping[str, Any], count: int, ignored: Array | None = None) -> Array:
        """The system's actions, (env, ...), of the actions of every agent.

        Args:
            actions: for each agent indices (env,), or points of its part of the box (env, parameters).
            count: number of environments.
            ignored: environments (env,) bool whose actions may be anything, because they begin a new episode.

        Raises:
            InputError: an agent that is missing or unknown, a wrong shape or type, an index out of range. The
                environment checks that points are finite.
        """
        if not isinstance(actions, Mapping) or set(actions) != set(self.names):
            given = sorted(map(str, actions)) if isinstance(actions, Mapping) else repr(actions)
            raise InputError(f"actions are of {given}, expected a dictionary with one for each of {self.names}")
        if self._parameters:
            return self._point(actions, count)
        choices = np.stack([self._indices(name, actions[name], count, ignored) for name in self.names], axis=1)
        library = self.system.actions
        return library.encode(choices) if isinstance(library, JointLibrary) else choices

    def _indices(self, name: str, given: Any, count: int, ignored: Array | None) -> Array:
        """One agent's indices (env,), checked; 0 where they are ignored."""
        array, last = np.asarray(given), self._count - 1
        if array.dtype.kind not in "iu":
            raise InputError(f"action of {name} has the type {array.dtype}, expected integers in [0, {last}]")
        if array.shape != (count,):
            raise InputError(
                f"action of {name} has the shape {array.shape}, expected {(count,)}: one for each environment"
            )
        if ignored is not None:
            array = np.where(ignored, 0, array)
        outside = (array < 0) | (array > last)
        if outside.any():
            wrong = int(array[outside][0])
            wanted = f"an index in [0, {last}] (nearest: {min(max(wrong, 0), last)})"
            raise InputError(f"action of {name} is {wrong}, expected {wanted}")
        return array.astype(np.int64)

    def _point(self, actions: Mapping[str, Any], count: int) -> Array:
        """Points of the box (env, d)."""
        arrays = {name: np.asarray(actions[name]) for name in self.names}
        for name, array in arrays.items():
            shape = (count, len(self._parameters[name]))
            if array.dtype.kind not in "fiu":
                raise InputError(f"action of {name} has the type {array.dtype}, expected numbers in [-1, 1]")
            if array.shape != shape:
                raise InputError(f"action of {name} has the shape {array.shape}, expected {shape}")
        kind = np.result_type(*arrays.values())
        point = np.empty((count, sum(map(len, self._parameters.values()))), kind)
        for name, array in arrays.items():
            point[:, self._parameters[name]] = array
        return point
