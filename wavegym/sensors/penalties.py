"""Field of view as a penalty on the measurement variance, in smooth and in sharp forms."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_broadcast, check_elements
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_choice, check_non_negative, check_positive
from wavegym.sensors import platform_kernels as kernels

Penalty = Literal["logistic", "hard", "deadzone", "huber", "log-barrier"]
PENALTIES: tuple[str, ...] = get_args(Penalty)
KINDS = {
    "logistic": kernels.LOGISTIC,
    "hard": kernels.HARD,
    "deadzone": kernels.DEADZONE,
    "huber": kernels.HUBER,
    "log-barrier": kernels.LOG_BARRIER,
}
SHARPNESS = {"logistic": 100.0, "hard": 100.0, "deadzone": 100.0, "huber": 100.0, "log-barrier": 1e8}


def fov_penalty(
    kind: str, x: ArrayLike, low: ArrayLike, high: ArrayLike, sharpness: ArrayLike, height: ArrayLike
) -> Array:
    """phi(x, [low, high]): the increase of a measured quantity's variance near and outside the field of view.

    With nu = sharpness / high and gamma = height:

    * ``"logistic"`` gamma [expit(2 nu (x - high)) + expit(2 nu (low - x))]: eq. (13) of O'Rourke and Swindlehurst on
      both sides. gamma / 2 at the edge; less than p times the variance v only for
      |x| <= high (1 - ln(gamma / (p v)) / (2 sharpness)).
    * ``"hard"`` gamma outside, exactly 0 inside.
    * ``"deadzone"`` gamma nu times the distance outside, exactly 0 inside: gamma at high / sharpness beyond the edge.
    * ``"huber"`` the same with a round corner: gamma (nu d)^2 / 2 up to the distance d = 1 / nu outside, then
      gamma (nu d - 1/2). It has a gradient everywhere.
    * ``"log-barrier"`` -(gamma / sharpness) ln(1 - (x / high)^2), at most gamma; gamma outside. It is 0 at the centre
      only: choose a sharpness much greater than gamma over the variance.

    Args:
        kind: one of the above.
        x: the measured quantity, (...).
        low, high: the interval in the unit of x, high > 0, (...). low may be -inf; high = inf means no penalty at all.
        sharpness: relative to ``high``, (...).
        height: gamma, in the unit of x squared, (...).

    Returns:
        phi in the unit of x squared, (...).

    Raises:
        InputError: an unknown kind, or an invalid shape or value.
    """
    code = KINDS[check_choice("penalty", kind, PENALTIES)]
    check_elements(check_positive, "sharpness", sharpness)
    check_elements(check_positive, "high edge of the field of view", np.minimum(high, np.finfo(float).max))
    check_elements(check_non_negative, "height", height)
    if np.isnan(x).any():
        raise InputError("x is nan, expected numbers")
    lower, upper = check_broadcast(low=low, high=high)
    if not (lower < upper).all():
        raise InputError(f"field of view has the edges {low!r} and {high!r}, expected low < high")
    return kernels.penalty(code, x, low, high, sharpness, height)
