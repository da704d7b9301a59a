"""Compiled RF/EO measurements and penalties, for ``platform.py``."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import batched, inlined, kernel
from wavegym.sensors.geometry_kernels import range_and_rate
from wavegym.waveforms.fisher import SPEED_OF_LIGHT

LOGISTIC, HARD, DEADZONE, LOG_BARRIER, HUBER = 0, 1, 2, 3, 4
NEGLIGIBLE = 90.0  # e^-90 is 1e-39: below the rounding of any variance at any height
CELL = 1.0 / 12.0  # variance of a uniform error in a cell of width 1
HALF_C = 0.5 * SPEED_OF_LIGHT
FULL_CIRCLE = np.pi * (1.0 - 1e-9)  # an image with at least this half angle covers the full circle, up to rounding


@inlined
def wrapped(angle):
    """``angle`` wrapped to [-pi, pi]."""
    return angle - 2.0 * np.pi * np.rint(angle / (2.0 * np.pi))


@inlined
def bearing(dx, dy):
    """atan2(dx, dy), the angle clockwise from +y, three times as fast as atan2; 0 for dx = dy = 0."""
    if abs(dx) > abs(dy):
        return np.copysign(0.5 * np.pi, dx) - np.arctan(dy / dx)
    if dy > 0.0:
        return np.arctan(dx / dy)
    return np.arctan(dx / dy) + np.copysign(np.pi, dx) if dy < 0.0 else 0.0


@inlined
def polar(x, vx, y, vy, sx, sy, look, printed):
    """(r, rdot, azimuth from ``look``); ``printed``: eq. (5) with the wrong sign, and the arcsine."""
    if not printed:
        r, rdot = range_and_rate(x, y, vx, vy, sx, sy)
        return r, rdot, wrapped(bearing(x - sx, y - sy) - look)
    r, rdot = range_and_rate(x, y, vx, -vy, sx, sy)
    return r, rdot, wrapped(np.arcsin((x - sx) / r) - look)


@inlined
def polar_rows(x, vx, y, vy, sx, sy, r, rdot, printed, a, H):
    """Rows a, a + 1, a + 2 of H: gradients of (r, rdot, azimuth) with respect to [x xdot y ydot]."""
    inverse = 1.0 / r
    ux, uy = (x - sx) * inverse, (y - sy) * inverse
    sign = -1.0 if printed else 1.0
    H[a, 0], H[a, 1], H[a, 2], H[a, 3] = ux, 0.0, uy, 0.0
    H[a + 1, 0], H[a + 1, 1] = (vx - rdot * ux) * inverse, ux
    H[a + 1, 2], H[a + 1, 3] = (sign * vy - rdot * uy) * inverse, sign * uy
    front = -1.0 if printed and uy < 0.0 else 1.0  # the arcsine decreases behind the platform
    H[a + 2, 0], H[a + 2, 1], H[a + 2, 2], H[a + 2, 3] = front * uy * inverse, 0.0, -front * ux * inverse, 0.0


@kernel
def penalty_one(kind, x, low, high, sharpness, height):
    """phi(x, [low, high]) of ``fov_penalty``, eq. (13) for the logistic kind."""
    if high == np.inf:
        return 0.0
    if kind == HARD:
        return height if x > high or x < low else 0.0
    nu = sharpness / high
    if kind in (DEADZONE, HUBER):
        outside = nu * (max(x - high, 0.0) + max(low - x, 0.0))
        if kind == HUBER:
            outside = 0.5 * outside * outside if outside < 1.0 else outside - 0.5
        return height * outside
    if kind == LOG_BARRIER:
        inside = 1.0 - x / high * (x / high)
        if x < low or inside <= 0.0:
            return height
        return min(height, -height / sharpness * np.log(inside))
    upper, lower = 2.0 * nu * (high - x), 2.0 * nu * (x - low)
    total = 0.0
    if upper < NEGLIGIBLE:
        total += height / (1.0 + np.exp(upper))
    if lower < NEGLIGIBLE:
        total += height / (1.0 + np.exp(lower))
    return total


@inlined
def view_one(prf, bandwidth, pixel_angle, wavelength, fft_length, pixels, printed, j, variance, low, high):
    """Fill row j of variance, low and high (p, 3) from a platform's settings."""
    r, rdot = HALF_C / bandwidth, 0.5 * wavelength * prf / fft_length
    variance[j, 0], variance[j, 1], variance[j, 2] = r * r * CELL, rdot * rdot * CELL, pixel_angle * pixel_angle * CELL
    farthest, fastest, edge = HALF_C / prf, 0.25 * wavelength * prf, 0.5 * pixels * pixel_angle
    low[j, 0], low[j, 1], low[j, 2] = -np.inf, -fastest, -edge
    high[j, 0], high[j, 1], high[j, 2] = farthest, fastest, edge
    if edge >= FULL_CIRCLE:
        low[j, 2], high[j, 2] = -np.inf, np.inf
    if printed:
        low[j, 1] = 0.0
        high[j, 0], high[j, 1] = 0.5 * wavelength * prf, HALF_C / prf


@batched("(m),(),(),(),()->(m),(m),(m)")
def view(settings, wavelength, fft_length, pixels, printed, variance, low, high, mm):
    """``view_one`` for a batch of settings (PRF, B, alpha)."""
    for e in range(settings.shape[0]):
        view_one(
            settings[e, 0], settings[e, 1], settings[e, 2], wavelength[e], fft_length[e], pixels[e], printed[e] > 0.0,
            e, variance, low, high
        )  # fmt: skip


@batched("(n),(m),()->(m)")
def measure(state, platform, printed, z, nn, mm):
    """z = (r, rdot, azimuth) of x = [x xdot y ydot] seen from (x, y, look)."""
    for e in range(state.shape[0]):
        x, vx, y, vy = state[e, 0], state[e, 1], state[e, 2], state[e, 3]
        sx, sy, look = platform[e, 0], platform[e, 1], platform[e, 2]
        z[e, 0], z[e, 1], z[e, 2] = polar(x, vx, y, vy, sx, sy, look, printed[e] > 0.0)


@batched("(n),(m),()->(m,n)")
def jacobian(state, platform, printed, H, nn, mm):
    """H = d(r, rdot, azimuth) / d[x xdot y ydot]; at the platform itself the row of the azimuth is 0."""
    for e in range(state.shape[0]):
        x, vx, y, vy = state[e, 0], state[e, 1], state[e, 2], state[e, 3]
        sx, sy, look = platform[e, 0], platform[e, 1], platform[e, 2]
        r, rdot, _ = polar(x, vx, y, vy, sx, sy, look, printed[e] > 0.0)
        polar_rows(x, vx, y, vy, sx, sy, r, rdot, printed[e] > 0.0, 0, H[e])


@batched("(),(),(),(),(),()->()")
def penalty(kind, x, low, high, sharpness, height, out):
    """phi, element by element."""
    for e in range(x.shape[0]):
        out[e] = penalty_one(kind[e], x[e], low[e], high[e], sharpness[e], height[e])
