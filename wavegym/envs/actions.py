"""From a system's action set to a Gymnasium space, and from what an agent sends to checked arrays."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from wavegym.core.action_sets import PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.parameter_box import ParameterBox
from wavegym.core.system import System
from wavegym.schedulers.rollout import allowed


class ActionReader(Protocol):
    """Checks a batch of actions before anything changes."""

    @property
    def space(self) -> spaces.Space[Any]:
        """The Gymnasium space of one environment's action."""

    def read(self, actions: Any, belief: Any, ignored: Array | None) -> Array:
        """The actions as an array (env, ...). Rows in ``ignored`` (bool, env) may hold anything.

        Raises:
            InputError: wrong shape or type, index out of range or masked in the state ``belief``, NaN or infinity.
        """

    def state_info(self, system: System, actions: Any, chosen: Array) -> dict[str, Array]:
        """What info says of the actions taken, each a fresh array (env, ...)."""


class IndexReader:
    """Index of a finite action set."""

    def __init__(self, system: System, count: int) -> None:
        self.space = spaces.Discrete(count)
        self.system, self.count = system, count

    def read(self, actions: Any, belief: Any, ignored: Array | None) -> Array:
        """See ``ActionReader``."""
        array, num_envs = np.asarray(actions), len(belief.step)
        if array.dtype.kind not in "iu":
            raise InputError(f"action has the type {array.dtype}, expected integers in [0, {self.count - 1}]")
        if array.shape != (num_envs,):
            raise InputError(f"actions have the shape {array.shape}, expected ({num_envs},)")
        if ignored is not None:
            array = np.where(ignored, 0, array)
        array = np.array(array, np.int64)
        # In two's complement a negative index is a huge one, so one comparison does; a batch of one needs no reduction.
        bits = array.view(np.uint64)
        if (bits.item() if num_envs == 1 else np.maximum.reduce(bits)) >= self.count:
            wrong = array[(array < 0) | (array >= self.count)][0]
            nearest = min(max(int(wrong), 0), self.count - 1)
            raise InputError(f"action is {wrong}, expected an index in [0, {self.count - 1}] (nearest: {nearest})")
        mask = allowed(self.system, belief) if self.system.strict else None
        if mask is not None:
            _check_mask(array, mask, ignored)
        return array

    def state_info(self, system: System, actions: Any, chosen: Array) -> dict[str, Array]:
        """The index chosen."""
        return {"waveform": chosen.copy()}  # a system or a film may keep ``chosen``


class PerSensorReader:
    """One index for each sensor, (env, sensor). Knows no masks."""

    def __init__(self, actions: PerSensorLibrary) -> None:
        self.count, self.sensors = len(actions), actions.sensors
        self.space = spaces.MultiDiscrete([self.count] * self.sensors)

    def read(self, actions: Any, belief: Any, ignored: Array | None) -> Array:
        """See ``ActionReader``."""
        array, num_envs = np.asarray(actions), len(belief.step)
        if array.dtype.kind not in "iu":
            raise InputError(f"action has the type {array.dtype}, expected integers in [0, {self.count - 1}]")
        if array.shape != (num_envs, self.sensors):
            wanted = f"({num_envs}, {self.sensors}): one index for each sensor"
            raise InputError(f"actions have the shape {array.shape}, expected {wanted}")
        if ignored is not None:
            array = np.where(ignored[:, None], 0, array)
        array = np.array(array, np.int64, order="C")
        bits = array.view(np.uint64)  # see IndexReader
        if (max(bits.tolist()[0]) if num_envs == 1 else np.maximum.reduce(bits, axis=None)) >= self.count:
            row, sensor = np.argwhere(bits >= self.count)[0]
            wrong, last = int(array[row, sensor]), self.count - 1
            wanted = f"an index in [0, {last}] (nearest: {min(max(wrong, 0), last)})"
            raise InputError(f"action of sensor {sensor + 1} is {wrong}, expected {wanted}")
        return array

    def state_info(self, system: System, actions: Any, chosen: Array) -> dict[str, Array]:
        """The indices chosen, (env, sensor)."""
        return {"waveform": chosen.copy()}


class BoxReader:
    """Point of [-1, 1]^d; finite values outside are clipped and flagged, as agents with unclipped Gaussians expect."""

    def __init__(self, box: ParameterBox) -> None:
        self.dimension = len(box.parameters)
        self.space = spaces.Box(-1.0, 1.0, (self.dimension,), np.float32)

    def read(self, actions: Any, belief: Any, ignored: Array | None) -> Array:
        """See ``ActionReader``; masks are for finite action sets."""
        array, num_envs = np.asarray(actions), len(belief.step)
        if array.dtype.kind not in "fiu":
            raise InputError(f"action has the type {array.dtype}, expected numbers in [-1, 1]")
        if array.shape != (num_envs, self.dimension):
            raise InputError(f"actions have the shape {array.shape}, expected ({num_envs}, {self.dimension})")
        if ignored is not None:
            array = np.where(ignored[:, None], 0.0, array)
        finite = np.isfinite(array).all(axis=1)
        if not finite.all():
            raise InputError(f"action is {array[~finite][0].tolist()}, expected finite numbers in [-1, 1]")
        return np.minimum(np.maximum(array.astype(np.float64), -1.0), 1.0)

    def state_info(self, system: System, actions: Any, chosen: Array) -> dict[str, Array]:
        """The physical parameters, and whether the action had to be clipped."""
        assert isinstance(system.actions, ParameterBox)
        return {"parameters": system.actions.decode(chosen), "action_clipped": (chosen != np.asarray(actions)).any(-1)}


def action_reader(system: System) -> ActionReader:
    """The reader that fits the system's action set.

    Raises:
        InputError: the system masks the actions of a PerSensor.
    """
    actions = system.actions
    if isinstance(actions, PerSensorLibrary):
        if type(system).mask is not System.mask:
            wanted = "none with a PerSensor: what couples sensors goes into the joint form, a JointLibrary"
            raise InputError(f"{type(system).__name__} has a mask of its own, expected {wanted}")
        return PerSensorReader(actions)
    return BoxReader(actions) if isinstance(actions, ParameterBox) else IndexReader(system, len(actions.labels))


def _check_mask(chosen: Array, mask: Array, ignored: Array | None) -> None:
    """InputError where an action (env,) is forbidden by ``mask`` (env, actions) and not in a row to be ignored."""
    forbidden = ~mask[np.arange(len(chosen)), chosen]
    if ignored is not None:
        forbidden &= ~ignored
    if forbidden.any():
        i = int(forbidden.argmax())
        action, open_ones = int(chosen[i]), np.flatnonzero(mask[i])
        nearest = int(open_ones[np.abs(open_ones - action).argmin()]) if open_ones.size else "none"
        where = f"environment {i} does not allow" if len(chosen) > 1 else "is not allowed"
        raise InputError(f"action is {action}, which {where} now (nearest allowed: {nearest})")
