"""A compiled Gaussian belief in polar coordinates about a sensor.

Range and range-rate do not measure the cross-range, so the true posterior bends along a circle. A Gaussian in Cartesian
coordinates cannot bend. It treats the bend as an error that averages out from step to step, and becomes overconfident.
In p = [r, rdot, azimuth, v], with v the velocity across the line of sight (clockwise, m/s), the three measurements are
linear and the motion is nearly linear.

``i`` is the entry of a batch of beliefs: p (i, n) and S (i, n, n) polar, x (i, n) and P (i, n, n) Cartesian with
x = [x xdot y ydot]. The azimuth is clockwise from +y. Sizes as in ``kernels.py``.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import math

import numpy as np

from wavegym.core.array_kernels import copy_vector
from wavegym.core.kernels import batched, inlined, kernel
from wavegym.sensors.platform_kernels import bearing, wrapped
from wavegym.trackers.sigma_point_kernels import moments_one, sigma_points_one

NEAREST = 1e-9  # m: a smaller range counts as this much
RANGE, RATE, AZIMUTH, ACROSS = 0, 1, 2, 3
HALF_ROOT, DENSITY = math.sqrt(0.5), 1.0 / math.sqrt(2.0 * math.pi)
UNLIKELY = 1e-9  # a less probable miss contradicts the model and changes nothing


@inlined
def polar_point(x, vx, y, vy):
    """(r, rdot, azimuth, v) of a state relative to the sensor."""
    r = max(np.sqrt(x * x + y * y), NEAREST)
    return r, (x * vx + y * vy) / r, bearing(x, y), (y * vx - x * vy) / r


@inlined
def add_noise_one(i, p, S, Q, density, J, T, nn):
    """S[i] += density J Q J', J (n, n) the gradient of p at p[i] in the state along and across the line of sight.

    Q (n, n) is the same in every direction.
    """
    n = len(nn)
    inverse = 1.0 / max(p[i, RANGE], NEAREST)
    J[:] = 0.0
    J[RANGE, 2], J[RATE, 3], J[AZIMUTH, 0], J[ACROSS, 1] = 1.0, 1.0, inverse, 1.0
    J[RATE, 0], J[ACROSS, 0] = p[i, ACROSS] * inverse, -p[i, RATE] * inverse
    for a in range(n):
        for b in range(n):
            total = 0.0
            for k in range(n):
                total += J[a, k] * Q[k, b]
            T[a, b] = total
    for a in range(n):
        for b in range(a + 1):
            total = 0.0
            for k in range(n):
                total += T[a, k] * J[b, k]
            S[i, a, b] += density * total
            S[i, b, a] = S[i, a, b]


@inlined
def predict_polar_one(i, p, S, F, Q, density, p_out, S_out, points, A, T, nn):
    """One step of a motion F, Q (n, n) that is the same in every direction; Q is for a density of 1.

    2 n sigma points (Julier & Uhlmann 1997, kappa = 0) move in the frame whose y axis points at each of them.
    points (2 n, n), A and T (n, n) are scratch space.
    """
    sigma_points_one(i, p, S, A, points, nn)
    for k in range(points.shape[0]):
        r, rdot, azimuth, v = points[k, RANGE], points[k, RATE], points[k, AZIMUTH], points[k, ACROSS]
        x = F[0, 1] * v + F[0, 2] * r + F[0, 3] * rdot
        vx = F[1, 1] * v + F[1, 2] * r + F[1, 3] * rdot
        y = F[2, 1] * v + F[2, 2] * r + F[2, 3] * rdot
        vy = F[3, 1] * v + F[3, 2] * r + F[3, 3] * rdot
        r, rdot, turn, v = polar_point(x, vx, y, vy)
        points[k, RANGE], points[k, RATE], points[k, AZIMUTH], points[k, ACROSS] = r, rdot, azimuth + turn, v
    moments_one(i, points, p_out, S_out, nn)
    add_noise_one(i, p_out, S_out, Q, density, A, T, nn)


@batched("(n),(n,n),(m)->(n),(n,n)")
def to_polar(x, P, sensor, p, S, nn, mm):
    """Polar mean and covariance of Cartesian beliefs, by sigma points; sensor (x, y, ...)."""
    n = len(nn)
    A, points, centred = np.empty((n, n)), np.empty((2 * n, n)), np.empty((1, n))
    for e in range(x.shape[0]):
        copy_vector(x[e], centred[0])
        centred[0, 0] -= sensor[e, 0]
        centred[0, 2] -= sensor[e, 1]
        middle = bearing(centred[0, 0], centred[0, 2])
        sigma_points_one(0, centred, P[e : e + 1], A, points, nn)
        for k in range(2 * n):
            r, rdot, azimuth, v = polar_point(points[k, 0], points[k, 1], points[k, 2], points[k, 3])
            points[k, RANGE], points[k, RATE], points[k, ACROSS] = r, rdot, v
            points[k, AZIMUTH] = middle + wrapped(azimuth - middle)
        moments_one(e, points, p, S, nn)


@inlined
def state_point(r, rdot, azimuth, v):
    """(x, vx, y, vy) relative to the sensor."""
    s, c = np.sin(azimuth), np.cos(azimuth)
    return r * s, rdot * s + v * c, r * c, rdot * c - v * s


@inlined
def state_gradient(i, p, D):
    """D (n, n) = d[x xdot y ydot] / dp at p[i]."""
    s, c = np.sin(p[i, AZIMUTH]), np.cos(p[i, AZIMUTH])
    r, rdot, v = p[i, RANGE], p[i, RATE], p[i, ACROSS]
    D[0, 0], D[0, 1], D[0, 2], D[0, 3] = s, 0.0, r * c, 0.0
    D[1, 0], D[1, 1], D[1, 2], D[1, 3] = 0.0, s, rdot * c - v * s, c
    D[2, 0], D[2, 1], D[2, 2], D[2, 3] = c, 0.0, -r * s, 0.0
    D[3, 0], D[3, 1], D[3, 2], D[3, 3] = 0.0, c, -rdot * s - v * c, -s


@inlined
def place_pair(i, s, twist, a, b, ca, cb, conjugate, plain, P, ax, ay, bx, by):
    """Fill P[i] with the covariances of A e^(i azimuth) and B e^(i azimuth): real parts are y, imaginary parts x.

    a, b: means of A and B; ca, cb: their covariances with the azimuth, whose variance is s; ``conjugate``: cov(A, B*);
    ``plain``: cov(A, B); ``twist``: e^(2i azimuth) of the mean; ax, ay, bx, by: elements of the Cartesian state.
    Differences of nearly equal moments are written with expm1, so that nothing cancels if s is small.
    """
    fade, rest = np.exp(-s), -np.expm1(-s)
    K = conjugate + rest * a * np.conj(b) - fade * (1j * (ca * np.conj(b) - a * np.conj(cb)) + ca * np.conj(cb))
    cross = 1j * (a * cb + b * ca)
    J = fade * twist * (ca * cb - rest * a * b - cross + fade * (plain + 2.0 * cross - 4.0 * ca * cb))
    P[i, ay, by], P[i, ax, bx] = 0.5 * (K + J).real, 0.5 * (K - J).real
    P[i, ay, bx], P[i, ax, by] = 0.5 * (J - K).imag, 0.5 * (J + K).imag


@kernel
def to_cartesian_one(i, p, S, sx, sy, x, P, nn):
    """Mean x[i] and covariance P[i] of the Cartesian state: exact for a Gaussian p[i], S[i].

    The position y + i x is r e^(i azimuth), the velocity (rdot + i v) e^(i azimuth): a Gaussian times e^(i azimuth).
    """
    s, c = np.sin(p[i, AZIMUTH]), np.cos(p[i, AZIMUTH])
    turn, spread = complex(c, s), S[i, AZIMUTH, AZIMUTH]
    r, w = complex(p[i, RANGE], 0.0), complex(p[i, RATE], p[i, ACROSS])
    cr = complex(S[i, RANGE, AZIMUTH], 0.0)
    cw = complex(S[i, RATE, AZIMUTH], S[i, ACROSS, AZIMUTH])
    fade = np.exp(-0.5 * spread)
    position, velocity = fade * turn * (r + 1j * cr), fade * turn * (w + 1j * cw)
    x[i, 0], x[i, 2] = sx + position.imag, sy + position.real
    x[i, 1], x[i, 3] = velocity.imag, velocity.real
    rr, rw, rv = S[i, RANGE, RANGE], S[i, RANGE, RATE], S[i, RANGE, ACROSS]
    ww, vv, wv = S[i, RATE, RATE], S[i, ACROSS, ACROSS], S[i, RATE, ACROSS]
    twist = turn * turn
    place_pair(i, spread, twist, r, r, cr, cr, complex(rr, 0.0), complex(rr, 0.0), P, 0, 2, 0, 2)
    place_pair(i, spread, twist, r, w, cr, cw, complex(rw, -rv), complex(rw, rv), P, 0, 2, 1, 3)
    place_pair(i, spread, twist, w, w, cw, cw, complex(ww + vv, 0.0), complex(ww - vv, 2.0 * wv), P, 1, 3, 1, 3)
    P[i, 1, 0], P[i, 1, 2], P[i, 3, 0], P[i, 3, 2] = P[i, 0, 1], P[i, 2, 1], P[i, 0, 3], P[i, 2, 3]
    P[i, 2, 0], P[i, 3, 1] = P[i, 0, 2], P[i, 1, 3]


@batched("(n),(n,n),(m)->(n),(n,n)")
def to_cartesian(p, S, sensor, x, P, nn, mm):
    """Cartesian mean and covariance of polar beliefs; sensor (x, y, ...)."""
    for e in range(p.shape[0]):
        to_cartesian_one(e, p, S, sensor[e, 0], sensor[e, 1], x, P, nn)


@inlined
def normal_mass(low, high):
    """Probability of [low, high] under a standard normal distribution."""
    return 0.5 * (math.erf(high * HALF_ROOT) - math.erf(low * HALF_ROOT))


@inlined
def miss_one(i, p, S, low, high, detection, g, nn):
    """Update with a miss: a look at azimuths from ``low`` to ``high``, relative to the mean, without a detection.

    The posterior of the azimuth is the prior times (1 - detection probability inside the image). Its mean and variance
    are exact. The other elements follow by regression on the azimuth. g (n,) is scratch space.
    """
    spread = S[i, AZIMUTH, AZIMUTH]
    sigma = np.sqrt(spread)
    a, b = low / sigma, high / sigma
    da, db = DENSITY * np.exp(-0.5 * a * a), DENSITY * np.exp(-0.5 * b * b)
    mass = normal_mass(a, b)
    left = 1.0 - detection * mass
    if not left > UNLIKELY:
        return
    shift = detection * (db - da) / left
    grow = (1.0 - detection * (mass + a * da - b * db)) / left - shift * shift - 1.0
    for j in range(len(nn)):
        g[j] = S[i, j, AZIMUTH] / sigma
        p[i, j] += g[j] * shift
    for j in range(len(nn)):
        for k in range(j + 1):
            S[i, j, k] += g[j] * g[k] * grow
            S[i, k, j] = S[i, j, k]
