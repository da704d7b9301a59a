"""Range and range-rate of a moving target in the plane, measured by a monostatic sensor."""

from __future__ import annotations

from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_finite
from wavegym.core.arrays import Array
from wavegym.sensors import geometry_kernels as kernels


def range_and_rate(state: ArrayLike, sensor: ArrayLike) -> Array:
    """h(x) = (r, rdot): r = |p - s| and rdot = v'(p - s) / r, positive when the target recedes.

    Args:
        state: x = (x, y, xdot, ydot) in m and m/s, (..., 4).
        sensor: position s = (x, y) in m, (..., 2); leading axes broadcast with those of ``state``.

    Returns:
        (r in m, rdot in m/s), (..., 2). r is at least 1e-9 m. At the sensor itself, where no direction is defined, rdot
        is 0.

    Raises:
        InputError: shapes that do not fit, or numbers that are not finite.
    """
    return kernels.measure(check_finite("state", state, 4), check_finite("sensor", sensor, 2))


def range_and_rate_jacobian(state: ArrayLike, sensor: ArrayLike) -> Array:
    """H = dh/dx of ``range_and_rate``, (..., 2, 4): rows r, rdot; columns x, y, xdot, ydot. Same arguments."""
    return kernels.jacobian(check_finite("state", state, 4), check_finite("sensor", sensor, 2))
