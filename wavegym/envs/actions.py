"""The Gymnasium space of an action set, and the checks of an agent's actions."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from wavegym.core.action_sets import ParameterBox, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, WrongTypeError
from wavegym.core.system import System
from wavegym.envs import action_kernels
from wavegym.observations.shortlist import Shortlist

NOBODY = np.zeros(0, np.bool_)  # whose action is ignored


class ActionReader(Protocol):
    """Checks a batch of actions before a step changes any state."""

    @property
    def space(self) -> spaces.Space[Any]:
        """The Gymnasium space of one environment's action."""

    def read(self, actions: Any, belief: Any, ignored: Array | None) -> Array:
        """The actions as an array (env, ...). Rows in ``ignored`` (bool, env) may hold anything.

        Raises:
            InputError: wrong shape or type, index out of range or masked at ``belief``, NaN or infinity.
        """

    def transition_info(self, actions: Any, chosen: Array) -> dict[str, Array]:
        """Info on the ``actions`` given and ``chosen`` as ``read`` returns them; fresh arrays (env, ...)."""


class IndexReader:
    """One index of a finite action set, or one index for each sensor of a PerSensorLibrary (no masks)."""

    def __init__(self, system: System) -> None:
        actions = system.actions
        assert not isinstance(actions, ParameterBox)
        self.system, self.count = system, len(actions.labels)
        self._is_masked = system.strict and type(system).mask is not System.mask
        self.shape: tuple[int, ...] = ()
        self.space: spaces.Space[Any] = spaces.Discrete(self.count)
        if isinstance(actions, PerSensorLibrary):
            self.shape = (actions.sensors,)
            self.space = spaces.MultiDiscrete([self.count] * actions.sensors)

    def read(self, actions: Any, belief: Any, ignored: Array | None) -> Array:
        """See ``ActionReader``."""
        array, shape = np.asarray(actions), (len(belief.step), *self.shape)
        if array.dtype.kind not in "iu":
            raise WrongTypeError(f"action has the type {array.dtype}, expected integers in [0, {self.count - 1}]")
        if array.shape != shape:
            wanted = f"{shape}: one index for each sensor" if self.shape else f"{shape}"
            raise InputError(f"actions have the shape {array.shape}, expected {wanted}")
        if ignored is not None:
            array = np.where(ignored.reshape(-1, *[1] * len(self.shape)), 0, array)
        array = np.array(array, np.int64, order="C")
        if not action_kernels.are_indices(array.reshape(-1), self.count):
            raise self._out_of_range(array)
        if self._is_masked:
            _check_mask(array, self.system.mask(belief), ignored)
        return array

    def transition_info(self, actions: Any, chosen: Array) -> dict[str, Array]:
        """The indices chosen, (env,) or (env, sensor)."""
        return {"waveform": chosen.copy()}  # a system or a film may keep ``chosen``

    def _out_of_range(self, array: Array) -> InputError:
        """The error that names the first index out of range."""
        first = np.argwhere((array < 0) | (array >= self.count))[0]
        wrong, last = int(array[tuple(first)]), self.count - 1
        sensor = "".join(f" of sensor {i + 1}" for i in first[1:])
        wanted = f"an index in [0, {last}] (nearest: {min(max(wrong, 0), last)})"
        return InputError(f"action{sensor} is {wrong}, expected {wanted}")


class RankReader(IndexReader):
    """One rank in the ``Shortlist`` of the belief before the step, in place of an action."""

    def __init__(self, system: System, shortlist: Shortlist) -> None:
        self.system, self.count, self.shape = system, shortlist.count, ()
        self.space, self._is_masked, self._shortlist = spaces.Discrete(self.count), False, shortlist

    def read(self, actions: Any, belief: Any, ignored: Array | None) -> Array:
        """See ``ActionReader``."""
        ranks = super().read(actions, belief, ignored)
        if self.system.strict:
            _check_mask(ranks, self._shortlist(belief).allowed, ignored)
        return self._shortlist.taken(belief, ranks)

    def transition_info(self, actions: Any, chosen: Array) -> dict[str, Array]:
        """The actions of these ranks, (env, ...)."""
        return {"sent": chosen.copy()}


class BoxReader:
    """A point of [-1, 1]^d; finite values outside are clipped and flagged, for agents with unclipped Gaussians."""

    def __init__(self, box: ParameterBox) -> None:
        self.box, self.dimension = box, len(box)
        self.space = spaces.Box(-1.0, 1.0, (self.dimension,), np.float32)

    def read(self, actions: Any, belief: Any, ignored: Array | None) -> Array:
        """See ``ActionReader``; a box has no masks."""
        array, num_envs = np.asarray(actions), len(belief.step)
        if array.dtype.kind not in "fiu":
            raise WrongTypeError(f"action has the type {array.dtype}, expected numbers in [-1, 1]")
        if array.shape != (num_envs, self.dimension):
            raise InputError(f"actions have the shape {array.shape}, expected ({num_envs}, {self.dimension})")
        if ignored is not None:
            array = np.where(ignored[:, None], 0.0, array)
        points = np.array(array, np.float64, order="C")
        if not action_kernels.clip(points):
            given = array.astype(np.float64)
            wrong = given[~np.isfinite(given).all(axis=1)][0]
            raise InputError(f"action is {wrong.tolist()}, expected finite numbers in [-1, 1]")
        return points

    def transition_info(self, actions: Any, chosen: Array) -> dict[str, Array]:
        """The physical parameters, (env, d), and whether the action was clipped, (env,)."""
        clipped = np.empty(len(chosen), np.bool_)
        action_kernels.differ(chosen, np.array(actions, np.float64, order="C"), clipped)
        return {"parameters": self.box.decode(chosen), "action_clipped": clipped}


def action_reader(system: System, shortlist: Shortlist | None = None) -> ActionReader:
    """The reader for the system's action set, or for ranks in a list of its actions.

    Raises:
        InputError: the system masks the actions of a PerSensorLibrary.
    """
    actions = system.actions
    if shortlist is not None:
        return RankReader(system, shortlist)
    if isinstance(actions, PerSensorLibrary) and type(system).mask is not System.mask:
        wanted = "none with a PerSensorLibrary: limits that couple sensors need the joint form, a JointLibrary"
        raise InputError(f"{type(system).__name__} has a mask of its own, expected {wanted}")
    return BoxReader(actions) if isinstance(actions, ParameterBox) else IndexReader(system)


def _check_mask(chosen: Array, mask: Array, ignored: Array | None) -> None:
    """Raise an InputError where ``mask`` (env, actions) forbids an action (env,) in a row that is not ``ignored``."""
    i = action_kernels.first_forbidden(
        chosen, np.ascontiguousarray(mask, np.bool_), NOBODY if ignored is None else ignored
    )
    if i >= 0:
        action, permitted = int(chosen[i]), np.flatnonzero(mask[i])
        nearest = int(permitted[np.abs(permitted - action).argmin()]) if permitted.size else "none"
        where = f"environment {i} does not allow" if len(chosen) > 1 else "is not allowed"
        raise InputError(f"action is {action}, which {where} now (nearest allowed: {nearest})")
