"""Windows of visibility: when each target is visible, known from the start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import Array, for_kernel
from wavegym.core.errors import InputError, check_ordered, check_within
from wavegym.core.system import ObservationField
from wavegym.systems import visibility_windows_kernels

Window = tuple[int, int, int]
LONGEST = 1_000_000  # steps
SOON = 10  # steps of visibility that are observed


def window_draws(horizon: int, shown: tuple[int, int], hidden: tuple[int, int]) -> int:
    """Number of uniform draws per target that ``alternating_windows`` needs, for the shortest windows too.

    Args:
        horizon: steps.
        shown: least and greatest number of steps for which a target stays visible.
        hidden: the same for hidden steps.

    Raises:
        InputError: shown below 1, hidden below 0, or bounds in the wrong order.
    """
    for name, (low, high), least in (("shown", shown, 1), ("hidden", hidden, 0)):
        check_ordered(name, low, high)
        check_within(name, low, least, LONGEST, "steps")
        check_within(name, high, least, LONGEST, "steps")
    cycles = 1 + -(-horizon // (shown[0] + hidden[0]))  # the first cycle may be nearly over
    return 1 + 2 * cycles


def alternating_windows(
    uniforms: ArrayLike, horizon: int, shown: tuple[int, int] = (6, 14), hidden: tuple[int, int] = (4, 10)
) -> Array:
    """When a target is visible that is visible and hidden in turn.

    The length of each stay is uniform over its bounds. The episode starts at a uniformly drawn step of the first
    visible stay and the hidden stay that follows.

    Args:
        uniforms: draws in [0, 1], (..., n), n at least ``window_draws``.
        horizon: steps.
        shown: least and greatest number of steps for which a target stays visible.
        hidden: the same for hidden steps.

    Returns:
        Whether the target is visible in each step, bool (..., horizon).

    Raises:
        InputError: invalid bounds, or too few draws.
    """
    u, needed = np.asarray(uniforms, np.float64), window_draws(horizon, shown, hidden)
    if u.ndim < 1 or u.shape[-1] < needed:
        raise InputError(f"uniforms have shape {u.shape}, expected (..., n) with n >= {needed}")
    low, high = np.array([shown, hidden] * ((needed - 1) // 2)).T
    stays = low + _up_to(u[..., 1:needed], high - low + 1)
    gone = _up_to(u[..., 0], stays[..., 0] + stays[..., 1])  # steps of the first cycle before the episode starts
    ends = np.cumsum(stays, axis=-1) - gone[..., None]
    # The number of stays that are over at each step, without an array of steps times stays.
    last = np.clip(ends, 0, horizon).reshape(-1, needed - 1)
    ended = np.zeros((len(last), horizon + 1), np.int64)
    np.add.at(ended, (np.arange(len(last))[:, None], last), 1)
    visible: Array = np.cumsum(ended[:, :horizon], axis=1) % 2 == 0
    return visible.reshape(*u.shape[:-1], horizon)


def _up_to(uniform: Array, count: Array) -> Array:
    """Integers 0 to count - 1, equally likely."""
    return np.minimum((uniform * count).astype(np.int64), count - 1)


def given_windows(windows: Sequence[Window], targets: int, horizon: int) -> Array:
    """Whether each target is visible in each step, bool (horizon, target).

    Args:
        windows: (target, first, last): the target is hidden in steps ``first`` to ``last``, both included.
        targets: number of targets.
        horizon: steps.

    Raises:
        InputError: no such target, or steps outside the episode or in the wrong order.
    """
    visible = np.ones((horizon, targets), np.bool_)
    for target, first, last in windows:
        of = f"of hidden window {(target, first, last)}"
        check_within(f"target {of}", target, 0, targets - 1)
        check_within(f"first step {of}", first, 0, horizon - 1)
        check_within(f"last step {of}", last, first, horizon - 1)
        visible[first : last + 1, target] = False
    return visible


def visibility(system: Any, draws: Array, targets: int) -> Array:
    """Whether each target is visible in each step, (env, H, target): from ``windows`` if given, otherwise drawn.

    Args:
        system: has ``windows``, ``horizon``, ``shown`` and ``hidden``.
        draws: uniform, (env, target, n).
        targets: number of targets.
    """
    if system.windows:
        return np.tile(given_windows(system.windows, targets, system.horizon), (len(draws), 1, 1))
    drawn = alternating_windows(draws, system.horizon, system.shown, system.hidden)
    return np.ascontiguousarray(np.swapaxes(drawn, 1, 2))


def window_fields(target: int) -> tuple[ObservationField, ...]:
    """What is observed of the windows of a target, numbered from 1: the fields of ``Coming`` over ``SOON`` steps."""
    t, half = target, 0.5 * SOON
    share = f"fraction of the next {SOON} steps in which it is visible"
    return (
        ObservationField(f"visible_{t}", "1", 0.5, 0.5, f"whether target {t} is visible in the next step"),
        ObservationField(f"changes_{t}", "step", half, half, f"steps until its visibility changes, at most {SOON}"),
        ObservationField(f"soon_visible_{t}", "1", 0.5, 0.3, share),
    )


class Coming(NamedTuple):
    """What is known from the windows about the next steps, (env, target) each."""

    now: Array  # bool: visible in the next step
    changes: Array  # int: steps until that changes, at most ``most``
    share: Array  # of the next ``most`` steps in which the target is visible


def coming(visible: Array, step: Array, most: int) -> Coming:
    """See ``Coming``: ``visible`` (env, H, target) from ``step`` (env,) on; nothing is visible beyond H."""
    shape = len(step), visible.shape[2]
    found = Coming(np.empty(shape, np.bool_), np.empty(shape, np.int64), np.empty(shape))
    visibility_windows_kernels.coming(for_kernel(visible), for_kernel(step), most, *found)
    return found
