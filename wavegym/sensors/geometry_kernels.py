"""Compiled range, range-rate, direction and multilateration, with SNR and variances over a path.

``multistatic.py`` holds the public functions.
"""

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
    """Half the path from (tx, ty) over the target to (sx, sy), and its rate; ``range_and_rate`` for equal positions."""
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
def multistatic_acceleration(x, y, u, v, a, b, tx, ty, sx, sy):
    """Second derivative of half the path length of a target at (x, y) with velocity (u, v) and acceleration (a, b)."""
    total = 0.0
    for cx, cy in ((tx, ty), (sx, sy)):
        r, rate = range_and_rate(x, y, u, v, cx, cy)
        total += 0.5 * (a * (x - cx) + b * (y - cy) + u * u + v * v - rate * rate) / r
    return total


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

    The limit is lambda / (4 interval) for the range-rate of a pulse train, and 1 for the direction cosine of an array
    with elements half a wavelength apart.
    """
    return value - 2.0 * limit * np.rint(value / (2.0 * limit))


@inlined
def half_ellipse_crossing(r0, r1, tx, ty, ax, ay, bx, by, root):
    """A point p = (x, y) with |p - t| + |p - a| = 2 r0 and |p - t| + |p - b| = 2 r1; NaN if there is none.

    Relative to the transmitter, with d = |p|: 2 p'a = |a|^2 - 4 r0^2 + 4 r0 d. Hence p is linear in d, and |p|^2 = d^2
    is a quadratic equation in d. ``root`` is -1 for the smaller solution and 1 for the larger.
    """
    ax, ay, bx, by = ax - tx, ay - ty, bx - tx, by - ty
    determinant = 2.0 * (ax * by - ay * bx)
    u, v = ax * ax + ay * ay - 4.0 * r0 * r0, bx * bx + by * by - 4.0 * r1 * r1
    fx, fy = (u * by - v * ay) / determinant, (v * ax - u * bx) / determinant  # p = f + g d
    gx, gy = 4.0 * (r0 * by - r1 * ay) / determinant, 4.0 * (r1 * ax - r0 * bx) / determinant
    square, cross, constant = gx * gx + gy * gy - 1.0, fx * gx + fy * gy, fx * fx + fy * fy
    rest = cross * cross - square * constant
    if not rest >= 0.0:
        return np.nan, np.nan
    far = -cross - np.copysign(np.sqrt(rest), cross)  # the solution without cancellation
    one, other = far / square, constant / far
    d = min(one, other) if root < 0 else max(one, other)
    if not (d >= 0.0 and d <= 2.0 * r0 and d <= 2.0 * r1):
        return np.nan, np.nan
    return tx + fx + gx * d, ty + fy + gy * d


@inlined
def directions(x, y, tx, ty, sx, sy):
    """Gradient and second derivatives xx, xy, yy of half the path (tx, ty), (x, y), (sx, sy)."""
    out, back = np.hypot(x - tx, y - ty), np.hypot(x - sx, y - sy)
    ox, oy, bx, by = (x - tx) / out, (y - ty) / out, (x - sx) / back, (y - sy) / back
    xx, xy, yy = oy * oy / out + by * by / back, -ox * oy / out - bx * by / back, ox * ox / out + bx * bx / back
    return 0.5 * (ox + bx), 0.5 * (oy + by), 0.5 * xx, 0.5 * xy, 0.5 * yy


@inlined
def locate_one(z0, z1, R0, R1, tx, ty, ax, ay, bx, by, root, row, x, P, J):
    """State x[row] = (x, y, xdot, ydot) and its covariance P[row] from z = (r, rdot) and R at both receivers.

    P is exact to first order: J (4, 4), scratch space, is the inverse of the Jacobian of the four measured numbers.
    Both are NaN if the two range ellipses do not intersect.
    """
    x[row, 0], x[row, 1] = half_ellipse_crossing(z0[0], z1[0], tx, ty, ax, ay, bx, by, root)
    px, qx, axx, axy, ayy = directions(x[row, 0], x[row, 1], tx, ty, ax, ay)
    py, qy, bxx, bxy, byy = directions(x[row, 0], x[row, 1], tx, ty, bx, by)
    determinant = px * qy - py * qx
    i00, i01, i10, i11 = qy / determinant, -qx / determinant, -py / determinant, px / determinant
    vx, vy = i00 * z0[1] + i01 * z1[1], i10 * z0[1] + i11 * z1[1]
    x[row, 2], x[row, 3] = vx, vy
    # rates depend also on the position: d rdot / d p = v' d2 r
    c00, c01, c10, c11 = axx * vx + axy * vy, axy * vx + ayy * vy, bxx * vx + bxy * vy, bxy * vx + byy * vy
    m00, m01, m10, m11 = c00 * i00 + c01 * i10, c00 * i01 + c01 * i11, c10 * i00 + c11 * i10, c10 * i01 + c11 * i11
    J[0, 0], J[0, 1], J[0, 2], J[0, 3] = i00, 0.0, i01, 0.0
    J[1, 0], J[1, 1], J[1, 2], J[1, 3] = i10, 0.0, i11, 0.0
    J[2, 0], J[2, 1], J[2, 2], J[2, 3] = -(i00 * m00 + i01 * m10), i00, -(i00 * m01 + i01 * m11), i01
    J[3, 0], J[3, 1], J[3, 2], J[3, 3] = -(i10 * m00 + i11 * m10), i10, -(i10 * m01 + i11 * m11), i11
    for i in range(4):
        for j in range(i + 1):
            total = 0.0
            for k in range(2):
                for m in range(2):
                    total += J[i, k] * R0[k, m] * J[j, m] + J[i, 2 + k] * R1[k, m] * J[j, 2 + m]
            P[row, i, j] = P[row, j, i] = total


@kernel
def multilaterate(z, R, transmitter, receivers, x, P):
    """Both solutions of each pair: z (pair, 2, 2), R (pair, 2, 2, 2) to x (pair, 2, 4), P (pair, 2, 4, 4)."""
    J = np.empty((4, 4))
    for e in range(len(z)):
        for k in range(2):
            locate_one(
                z[e, 0], z[e, 1], R[e, 0], R[e, 1], transmitter[0], transmitter[1],
                receivers[0, 0], receivers[0, 1], receivers[1, 0], receivers[1, 1], 2.0 * k - 1.0, k, x[e], P[e], J,
            )  # fmt: skip
