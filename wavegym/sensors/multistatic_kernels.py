"""Kernels of multistatic measurements: SNR over a propagation path, direction of arrival, and variances."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined

REFERENCE_RANGE = 100.0  # m, the half path length for which the SNR of a waveform is given


@inlined
def snr_at(r, reference, reflected):
    """eta at half path length r [m]; reference: eta at 100 m; reflected: fraction of the power left after walls."""
    near = REFERENCE_RANGE / r
    return reference * reflected * (near * near) * (near * near)


@inlined
def noise(wave, eta, rate_floor):
    """(R00, R01, R11) of range and range-rate; wave (2, 2): covariance at unit SNR; rate_floor: a deviation, m/s."""
    return wave[0, 0] / eta, wave[0, 1] / eta, wave[1, 1] / eta + rate_floor * rate_floor


@inlined
def direction_cosine(x, y, sx, sy, ax, ay):
    """Cosine of the angle between the axis (ax, ay) of an array at (sx, sy) and the direction to (x, y)."""
    dx, dy = x - sx, y - sy
    return (ax * dx + ay * dy) / np.sqrt(dx * dx + dy * dy)


@inlined
def direction_variance(eta, elements):
    """Error variance of the direction cosine: the inverse of its Fisher information eta pi^2 (L^2 - 1) / 12.

    The phase from element to element is pi times the cosine, because elements are half a wavelength apart. The phases
    of L elements about the centre have a mean square of (L^2 - 1) / 12 steps. Range and range-rate are uncorrelated
    with the direction (Van Trees, "Optimum Array Processing", 2002, chapter 8). Infinite for one element.
    """
    return 12.0 / (np.pi * np.pi * (elements * elements - 1.0) * eta)


@inlined
def folded(value, limit):
    """A value that is measured up to multiples of 2 ``limit``, folded into [-limit, limit].

    Range-rate of a pulse train, limit lambda / (4 interval); direction cosine of an array with elements half a
    wavelength apart, limit 1.
    """
    return value - 2.0 * limit * np.rint(value / (2.0 * limit))
