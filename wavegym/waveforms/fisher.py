"""Fisher information of delay and Doppler in a factored form without cancellation, and the measurement covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import FloatArray, check_elements, check_finite
from wavegym.core.errors import check_positive

SPEED_OF_LIGHT = 299792458.0
"""Speed of light in vacuum, m/s."""

_TWO_PI = 2.0 * np.pi


@dataclass(frozen=True)
class FisherFactors:
    """Fisher information of (delay, angular Doppler) at SNR 1, as J = [[r + b^2 v, -b v], [-b v, v]].

    Let w(t) be the instantaneous angular frequency, with averages weighted by the pulse's energy. ``b`` is the slope of
    the regression of w on t, ``v`` the variance of t, and ``r`` the squared envelope bandwidth plus the residual
    variance of w. A long chirp has 1 - rho^2 of 1e-6 and less: J itself loses those digits by cancellation. Its
    determinant r v and its inverse [[1/r, b/r], [b/r, 1/v + b^2/r]] keep all digits, because they need no subtraction.
    Fields may be arrays of any (broadcasting) shape, one element per waveform.

    Attributes:
        residual: r, delay information that no Doppler shift can imitate, (rad/s)^2.
        slope: b, effective chirp rate (positive for an up-chirp), rad/s^2.
        spread: v, mean square duration, s^2.

    Raises:
        InputError: a residual or spread that is not a finite number > 0 (durations of 1e-150 s overflow), or a slope
            that is not finite.
    """

    residual: ArrayLike
    slope: ArrayLike
    spread: ArrayLike

    def __post_init__(self) -> None:
        check_elements(check_positive, "residual (delay information)", self.residual)
        check_finite("slope (chirp rate)", self.slope)
        check_elements(check_positive, "spread (mean square duration)", self.spread)

    def information(self) -> FloatArray:
        """Fisher information of (delay in s, Doppler in Hz) at SNR 1, shape (..., 2, 2)."""
        r, b, v = np.asarray(self.residual), np.asarray(self.slope), np.asarray(self.spread)
        coupling = b * v
        return _symmetric(r + b * coupling, -_TWO_PI * coupling, _TWO_PI * _TWO_PI * v)

    def measurement_covariance(self, carrier_hz: ArrayLike) -> FloatArray:
        """Cramer-Rao covariance R = Gamma J^-1 Gamma^T of (range in m, range-rate in m/s) at SNR 1, shape (..., 2, 2).

        Gamma = diag(c/2, -c/(2 fc)): range-rate is positive when receding, Doppler negative.
        InputError for a carrier_hz that is not a finite number > 0.
        """
        carrier = check_elements(check_positive, "carrier_hz", carrier_hz)
        r, b, v = np.asarray(self.residual), np.asarray(self.slope), np.asarray(self.spread)
        return unchecked_covariance(r, b, v, carrier)


def unchecked_covariance(r: FloatArray, b: FloatArray, v: FloatArray, carrier: FloatArray | float) -> FloatArray:
    """``FisherFactors.measurement_covariance`` of a residual, slope and spread without checks, for the systems' steps.

    An action is a point of a box whose bounds were checked when the system was made.
    """
    metres = 0.5 * SPEED_OF_LIGHT  # per second of delay
    rate = metres / (_TWO_PI * carrier)  # m/s per rad/s of Doppler
    delay = metres / r
    return _symmetric(metres * delay, -rate * (delay * b), rate * rate * (1.0 / v + b * b / r))


def _symmetric(first: FloatArray, off: FloatArray, second: FloatArray) -> FloatArray:
    matrix = np.empty((*np.broadcast_shapes(first.shape, off.shape, second.shape), 2, 2))
    matrix[..., 0, 0] = first
    matrix[..., 0, 1] = off
    matrix[..., 1, 0] = off
    matrix[..., 1, 1] = second
    return matrix
