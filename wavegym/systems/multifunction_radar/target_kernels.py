"""True targets of the multifunction radar in compiled form: they come, manoeuvre, and leave.

Shapes: g targets. A target is [x xdot y ydot] (m, m/s); the radar stands at the origin. Azimuths count clockwise from
+y. Time advances in cells of a fixed length: within a cell a target flies straight on. In each of its two modes a
target has white acceleration of another density; a Markov chain switches the mode.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.counter_rng_kernels import normal, stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.platform_kernels import bearing

MODES = 2
MOTION = 0  # number of the stream of manoeuvres within a world's key
DRAWS = 5  # of a target in a cell: the mode's change, and two of noise for each axis


class Flight(NamedTuple):
    """How targets fly, and the region in which the radar has to find them."""

    cell: float  # s
    density: tuple[float, float]  # white acceleration of each mode, m^2/s^3
    leave: tuple[float, float]  # rate at which a target leaves each mode, 1/s
    nearest: float  # m
    farthest: float  # m
    half_sector: float  # rad


@inlined
def range_of(x, y):
    """Distance from the radar, m."""
    return np.sqrt(x * x + y * y)


@inlined
def in_region(x, y, flight):
    """Whether the place (x, y) lies in the region."""
    r = range_of(x, y)
    return flight.nearest <= r <= flight.farthest and abs(bearing(x, y)) <= flight.half_sector


@inlined
def fly_one(key, cell, g, x, mode, flight):
    """One cell of target g: changes x[g] (n,) and mode[g]; the draws belong to the key, the cell and the target."""
    own, h = stream(stream(stream(key, MOTION), cell), g), flight.cell
    if uniform(own, 0) < -np.expm1(-flight.leave[mode[g]] * h):
        mode[g] = 1 - mode[g]
    q = flight.density[mode[g]]
    a, b = np.sqrt(q * h * h * h / 3.0), np.sqrt(q * h / 4.0)  # Cholesky factor of the noise of one axis
    for axis in range(2):
        n0, n1 = normal(own, 1 + 2 * axis), normal(own, 2 + 2 * axis)
        x[g, 2 * axis] += h * x[g, 2 * axis + 1] + a * n0
        x[g, 2 * axis + 1] += np.sqrt(3.0) * b * n0 + b * n1


@kernel
def fly(key, arrival, cell, until, x, mode, here, flight):
    """Fly all targets of one environment from a cell's beginning to that of the cell ``until``.

    A target is here from the first cell that begins after its arrival until it is out of the region.
    """
    for k in range(cell, until):
        for g in range(len(here)):
            if not here[g] and k * flight.cell <= arrival[g] < (k + 1) * flight.cell:
                here[g] = True
            elif here[g]:
                fly_one(key, k, g, x, mode, flight)
                here[g] = in_region(x[g, 0], x[g, 2], flight)


@kernel
def fly_all(keys, arrival, cell, until, x, mode, here, flight):
    """``fly`` of every environment, from the same cell; arrays (e, ...)."""
    for e in range(len(x)):
        fly(keys[e], arrival[e], cell, until, x[e], mode[e], here[e], flight)
