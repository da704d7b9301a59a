"""Range and range-rate in compiled form; ``geometry.py`` holds the public functions."""

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
