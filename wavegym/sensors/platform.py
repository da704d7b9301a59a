"""Range, range-rate and azimuth of a moving target in the plane, measured by an RF/EO platform."""

from __future__ import annotations

from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_finite
from wavegym.core.arrays import Array
from wavegym.sensors import platform_kernels as kernels


def platform_measurement(state: ArrayLike, platform: ArrayLike, as_printed: bool = False) -> Array:
    """c(x) = (r, rdot, azimuth): eqs. (4) and (5) of O'Rourke and Swindlehurst, and the azimuth that follows them.

    Args:
        state: x = [x xdot y ydot] in m and m/s, (..., 4).
        platform: (x, y, look direction) in m, m and rad, (..., 3); the look direction is clockwise from +y. Leading
            axes broadcast with those of ``state``.
        as_printed: use the paper's range-rate, whose second term has the wrong sign, and its arcsin(dx / r), which does
            not distinguish a target behind the platform from one in front.

    Returns:
        (r in m, rdot in m/s, azimuth in rad from the look direction, wrapped to [-pi, pi]), (..., 3). rdot is positive
        when the target recedes; azimuth = atan2(dx, dy) - look. r is at least 1e-9 m; at the platform itself rdot is 0.

    Raises:
        InputError: shapes that do not fit, or numbers that are not finite.
    """
    return kernels.measure(check_finite("state", state, 4), check_finite("platform", platform, 3), float(as_printed))


def platform_jacobian(state: ArrayLike, platform: ArrayLike, as_printed: bool = False) -> Array:
    """C = dc/dx of ``platform_measurement``, (..., 3, 4): rows r, rdot, azimuth; columns x, xdot, y, ydot.

    The arguments are those of ``platform_measurement``.
    """
    return kernels.jacobian(check_finite("state", state, 4), check_finite("platform", platform, 3), float(as_printed))
