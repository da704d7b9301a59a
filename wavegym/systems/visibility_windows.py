"""Windows of visibility: when each target can be seen, known from the beginning."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_ordered, check_within

Window = tuple[int, int, int]
LONGEST = 1_000_000  # steps


def window_draws(horizon: int, shown: tuple[int, int], hidden: tuple[int, int]) -> int:
    """How many uniform draws ``alternating_windows`` needs of each target, however short its windows turn out.

    Args:
        horizon: steps.
        shown: least and greatest number of steps in sight.
        hidden: the same out of sight.

    Raises:
        InputError: less than one step in sight, less than none out of sight, or bounds in the wrong order.
    """
    for name, (low, high), least in (("shown", shown, 1), ("hidden", hidden, 0)):
        check_ordered(name, low, high)
        check_within(name, low, least, LONGEST, "steps")
        check_within(name, high, least, LONGEST, "steps")
    cycles = 1 + -(-horizon // (shown[0] + hidden[0]))  # the first one may be nearly over
    return 1 + 2 * cycles


def alternating_windows(
    uniforms: ArrayLike, horizon: int, shown: tuple[int, int] = (6, 14), hidden: tuple[int, int] = (4, 10)
) -> Array:
    """When a target can be seen that is in sight and out of sight by turns.

    Each stay's length is uniform over its bounds; the episode begins anywhere in the first stay in sight and the one
    out of sight that follows it, all their steps being equally likely.

    Args:
        uniforms: draws in [0, 1], (..., n), n at least ``window_draws``.
        horizon: steps.
        shown: least and greatest number of steps in sight.
        hidden: the same out of sight.

    Returns:
        Whether the target can be seen in each step, bool (..., horizon).

    Raises:
        InputError: bounds that make no windows, or too few draws.
    """
    u, needed = np.asarray(uniforms, np.float64), window_draws(horizon, shown, hidden)
    if u.ndim < 1 or u.shape[-1] < needed:
        raise InputError(f"uniforms have shape {u.shape}, expected (..., n) with n >= {needed}")
    low, high = np.array([shown, hidden] * ((needed - 1) // 2)).T
    stays = low + _up_to(u[..., 1:needed], high - low + 1)
    gone = _up_to(u[..., 0], stays[..., 0] + stays[..., 1])  # steps of the first turn before the episode begins
    ends = np.cumsum(stays, axis=-1) - gone[..., None]
    over = (ends[..., None, :] <= np.arange(horizon)[:, None]).sum(axis=-1)
    visible: Array = over % 2 == 0
    return visible


def _up_to(uniform: Array, count: Array) -> Array:
    """Whole numbers 0 to count - 1, equally likely."""
    return np.minimum((uniform * count).astype(np.int64), count - 1)


def given_windows(windows: Sequence[Window], targets: int, horizon: int) -> Array:
    """Whether each target can be seen in each step, bool (horizon, target).

    Args:
        windows: (target, first, last): steps ``first`` to ``last``, both included, in which it cannot be seen.
        targets: how many there are.
        horizon: steps.

    Raises:
        InputError: a target that does not exist, or steps outside the episode or in the wrong order.
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
    """Whether each target can be seen in each step, (env, H, target): as given by ``windows``, or else as drawn.

    Args:
        system: has ``windows``, ``horizon``, ``shown`` and ``hidden``.
        draws: uniform, (env, target, n).
        targets: how many.
    """
    if system.windows:
        return np.tile(given_windows(system.windows, targets, system.horizon), (len(draws), 1, 1))
    drawn = alternating_windows(draws, system.horizon, system.shown, system.hidden)
    return np.ascontiguousarray(np.swapaxes(drawn, 1, 2))


def coming(visible: Array, step: Array, steps: int) -> Array:
    """``visible`` (env, H, target) in ``steps`` steps from ``step`` (env,) on, (env, steps, target); False beyond H."""
    when, horizon = step[:, None] + np.arange(steps), visible.shape[1]
    seen: Array = visible[np.arange(len(when))[:, None], np.minimum(when, horizon - 1)]
    return seen & (when < horizon)[..., None]
