"""The Gymnasium space of an action set, and the checks of an agent's actions."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from wavegym.core.action_sets import PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, WrongTypeError
from wavegym.core.parameter_box import ParameterBox
from wavegym.core.system import System
from wavegym.schedulers.rollout import allowed


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
        # In two's complement a negative index is huge: one comparison finds both. A batch of one takes no reduction.
        bits = array.view(np.uint64)
        if (max(bits.ravel().tolist()) if len(array) == 1 else np.maximum.reduce(bits, axis=None)) >= self.count:
            raise self._out_of_range(array, bits)
        mask = allowed(self.system, belief) if self.system.strict else None
        if mask is not None:
            _check_mask(array, mask, ignored)
        return array

    def transition_info(self, actions: Any, chosen: Array) -> dict[str, Array]:
        """The indices chosen, (env,) or (env, sensor)."""
        return {"waveform": chosen.copy()}  # a system or a film may keep ``chosen``

    def _out_of_range(self, array: Array, bits: Array) -> InputError:
        """The error that names the first index out of range."""
        first = np.argwhere(bits >= self.count)[0]
        wrong, last = int(array[tuple(first)]), self.count - 1
        sensor = "".join(f" of sensor {i + 1}" for i in first[1:])
        wanted = f"an index in [0, {last}] (nearest: {min(max(wrong, 0), last)})"
        return InputError(f"action{sensor} is {wrong}, expected {wanted}")


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
        finite = np.isfinite(array).all(axis=1)
        if not finite.all():
            raise InputError(f"action is {array[~finite][0].tolist()}, expected finite numbers in [-1, 1]")
        return np.minimum(np.maximum(array.astype(np.float64), -1.0), 1.0)

    def transition_info(self, actions: Any, chosen: Array) -> dict[str, Array]:
        """The physical parameters, (env, d), and whether the action was clipped, (env,)."""
        return {"parameters": self.box.decode(chosen), "action_clipped": (chosen != np.asarray(actions)).any(-1)}


def action_reader(system: System) -> ActionReader:
    """The reader for the system's action set.

    Raises:
        InputError: the system masks the actions of a PerSensorLibrary.
    """
    actions = system.actions
    if isinstance(actions, PerSensorLibrary) and type(system).mask is not System.mask:
        wanted = "none with a PerSensorLibrary: limits that couple sensors need the joint form, a JointLibrary"
        raise InputError(f"{type(system).__name__} has a mask of its own, expected {wanted}")
    return BoxReader(actions) if isinstance(actions, ParameterBox) else IndexReader(system)


def _check_mask(chosen: Array, mask: Array, ignored: Array | None) -> None:
    """Raise an InputError where ``mask`` (env, actions) forbids an action (env,) in a row that is not ``ignored``."""
    forbidden = ~mask[np.arange(len(chosen)), chosen]
    if ignored is not None:
        forbidden &= ~ignored
    if forbidden.any():
        i = int(forbidden.argmax())
        action, permitted = int(chosen[i]), np.flatnonzero(mask[i])
        nearest = int(permitted[np.abs(permitted - action).argmin()]) if permitted.size else "none"
        where = f"environment {i} does not allow" if len(chosen) > 1 else "is not allowed"
        raise InputError(f"action is {action}, which {where} now (nearest allowed: {nearest})")
