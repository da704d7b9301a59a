"""Multilateration: position and velocity of a new track from one scan of two receivers.

Barbosa et al., section 4.2.1, take differences of two scans. Range and range-rate at one receiver hold no direction, so
two receivers are needed. Two positions remain; the caller chooses by the road map.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_finite, check_last_axes, checked_copy, flatten_lead
from wavegym.core.arrays import FloatArray
from wavegym.core.covariance_checks import check_covariance
from wavegym.core.errors import InputError
from wavegym.trackers import multilateration_kernels as kernels


def multilaterate(
    measurements: ArrayLike, R: ArrayLike, transmitter: ArrayLike, receivers: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Both states that fit one target's measurements at two receivers, with covariances to first order.

    Args:
        measurements: z = (r in m, rdot in m/s) at each receiver: half the path transmitter, target, receiver, and its
            rate, (..., 2, 2).
        R: their error covariances, (..., 2, 2, 2).
        transmitter: (x, y) in m, (2,).
        receivers: (x, y) in m, (2, 2); not in one line with the transmitter.

    Returns:
        States (x, y, xdot, ydot) in m and m/s, (..., 2, 4), and covariances (..., 2, 4, 4); NaN where the range
        ellipses do not intersect. Receivers close together give a large error across the line of sight.

    Raises:
        InputError: shapes that do not fit, numbers that are not finite, an R that is not symmetric positive
            semidefinite, or antennas in one line.
    """
    z, errors = check_finite("measurements", measurements, 2, 2), check_last_axes("R", R, 2, 2, 2)
    check_covariance("R", errors)
    t, s = checked_copy("transmitter", transmitter, 2), checked_copy("receivers", receivers, 2, 2)
    check_triangle(t, s)
    try:
        lead = np.broadcast_shapes(z.shape[:-2], errors.shape[:-3])
    except ValueError:
        raise InputError(
            f"measurements and R have shapes {z.shape} and {errors.shape}, expected (..., 2, 2) and (..., 2, 2, 2) "
            "that broadcast"
        ) from None
    z, errors = flatten_lead(z, lead, 2, 2), flatten_lead(errors, lead, 2, 2, 2)
    x, P = np.empty((len(z), 2, 4)), np.empty((len(z), 2, 4, 4))
    kernels.multilaterate(z, errors, t, s, x, P)
    return x.reshape(*lead, 2, 4), P.reshape(*lead, 2, 4, 4)


def check_triangle(transmitter: FloatArray, receivers: FloatArray) -> None:
    """Raise an InputError if a transmitter (2,) and two receivers (2, 2) are not finite or stand in one line."""
    a, b = check_finite("receivers", receivers) - check_finite("transmitter", transmitter)
    if abs(a[0] * b[1] - a[1] * b[0]) <= 1e-9 * np.linalg.norm(a) * np.linalg.norm(b):
        raise InputError(
            f"transmitter {transmitter.tolist()} and receivers {receivers.tolist()} stand in one line, expected a"
            " triangle: in one line they cannot tell left from right"
        )
