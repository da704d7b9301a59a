"""Range, range-rate and direction in compiled form, with SNR and variances over a path; see ``multistatic.py``."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import batched, inlined, kernel

NEAREST = 1e-9
"""Least range r in m: at the sensor itself rdot is then 0 instead of 0 / 0, and |rdot| <= speed everywhere."""


@kernel
def range_and_rate(px, py, vx, vy, sx, sy):
    """(r, rdot) of a target at (px, py) with velocity (vx, vy) seen from (sx, sy); receding is positive."""
    dx, dy = px - sx, py - sy
    r = max(np.sqrt(dx * dx + dy * dy), NEAREST)
    return r, (dx * vx + dy * vy) / r


@inlined
def multistatic_range_and_rate(px, py, vx, vy, tx, ty, sx, sy):
    """Half the path (tx, ty), target, (sx, sy), and its rate; equals ``range_and_rate`` for equal positions."""
    out, out_rate = range_and_rate(px, py, vx, vy, tx, ty)
    back, back_rate = range_and_rate(px, py, vx, vy, sx, sy)
    return 0.5 * (out + back), 0.5 * (out_rate + back_rate)


@batched("(n),(m)->(m)")
def measure(x, sensor, z, nn, mm):
    """z = (r, rdot) of x = (x, y, xdot, ydot)."""
    for e in range(x.shape[0]):
        z[e, 0], z[e, 1] = range_and_rate(x[e, 0], x[e, 1], x[e, 2], x[e, 3], sensor[e, 0], sensor[e, 1])


@batched("(n),(m)->(m,n)")
def jacobian(x, sensor, H, nn, mm):
    """H = d(r, rdot) / d(x, y, xdot, ydot); u is the unit vector from sensor to target."""
    for e in range(x.shape[0]):
        r, rdot = range_and_rate(x[e, 0], x[e, 1], x[e, 2], x[e, 3], sensor[e, 0], sensor[e, 1])
        for i in range(2):
            u = (x[e, i] - sensor[e, i]) / r
            H[e, 0, i], H[e, 0, i + 2] = u, 0.0
            H[e, 1, i], H[e, 1, i + 2] = (x[e, i + 2] - rdot * u) / r, u


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
