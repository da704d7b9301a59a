"""Compiled flight of the multifunction radar's targets.

Shapes: e environments, g targets. A true target is [x xdot y ydot] (m, m/s); the radar is at the origin. Azimuths are
clockwise from +y. Time advances in cells of a fixed length. Within a cell a target has one acceleration, uniform in a
disc whose radius depends on the target's mode; a Markov chain switches between the two modes. An acceleration that
would take the speed out of its limits is replaced by straight flight. So velocities that are uniform between the two
limits stay uniform, and places that are uniform in the plane do too.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.platform_kernels import bearing

MOTION = 0  # number of the stream of manoeuvres within a world's key


class Flight(NamedTuple):
    """How targets fly, and the region in which the radar has to find them."""

    cell: float  # s
    acceleration: tuple[float, float]  # maximum of each mode, m/s^2
    leave: tuple[float, float]  # rate at which a target leaves each mode, 1/s
    slowest: float  # m/s
    fastest: float  # m/s
    nearest: float  # m
    farthest: float  # m
    half_sector: float  # rad


class Flying(NamedTuple):
    """The true targets of one environment, or with a leading axis of all."""

    x: np.ndarray  # (g, n) at the beginning of the cell
    acceleration: np.ndarray  # (g, 2) in the cell, m/s^2
    mode: np.ndarray  # (g,) int
    here: np.ndarray  # (g,) bool


@inlined
def in_region(x, y, flight):
    """Whether the place (x, y) lies in the region."""
    r = np.sqrt(x * x + y * y)
    return flight.nearest <= r <= flight.farthest and abs(bearing(x, y)) <= flight.half_sector


@inlined
def begin_cell(key, cell, g, flying, flight):
    """Draw target g's mode and acceleration in a cell; the draws depend on the key, the cell and the target."""
    own, h, x = stream(stream(stream(key, MOTION), cell), g), flight.cell, flying.x
    if uniform(own, 0) < -np.expm1(-flight.leave[flying.mode[g]] * h):
        flying.mode[g] = 1 - flying.mode[g]
    size, turn = flight.acceleration[flying.mode[g]] * np.sqrt(uniform(own, 1)), 2.0 * np.pi * uniform(own, 2)
    ax, ay = size * np.cos(turn), size * np.sin(turn)
    speed = np.hypot(x[g, 1] + h * ax, x[g, 3] + h * ay)
    allowed = flight.slowest <= speed <= flight.fastest
    flying.acceleration[g, 0], flying.acceleration[g, 1] = (ax, ay) if allowed else (0.0, 0.0)


@inlined
def moved(flying, g, seconds):
    """State (4,) of target g so many seconds after the cell began."""
    x, ax, ay = flying.x, flying.acceleration[g, 0], flying.acceleration[g, 1]
    px = x[g, 0] + seconds * (x[g, 1] + 0.5 * seconds * ax)
    py = x[g, 2] + seconds * (x[g, 3] + 0.5 * seconds * ay)
    return px, x[g, 1] + seconds * ax, py, x[g, 3] + seconds * ay


@inlined
def end_cell(g, flying, flight):
    """Fly target g to the end of its cell."""
    x = flying.x
    x[g, 0], x[g, 1], x[g, 2], x[g, 3] = moved(flying, g, flight.cell)


@kernel
def fly(key, arrival, cell, until, flying, flight):
    """Fly all targets of one environment from a cell, which has begun, to the beginning of the cell ``until``.

    A target is here from the first cell that begins after its arrival until it leaves the region.
    """
    x, here = flying.x, flying.here
    for k in range(cell + 1, until + 1):
        for g in range(len(here)):
            if here[g]:
                end_cell(g, flying, flight)
                here[g] = in_region(x[g, 0], x[g, 2], flight)
            elif (k - 1) * flight.cell <= arrival[g] < k * flight.cell:
                here[g] = True
            if here[g]:
                begin_cell(key, k, g, flying, flight)


@inlined
def flying_of(e, flying):
    """The targets of environment e, as views."""
    return Flying(flying.x[e], flying.acceleration[e], flying.mode[e], flying.here[e])


@kernel
def begin_all(keys, cell, flying, flight):
    """``begin_cell`` of every target that is here, in every environment; cell (e,)."""
    for e in range(len(keys)):
        for g in range(flying.here.shape[1]):
            if flying.here[e, g]:
                begin_cell(keys[e], cell[e], g, flying_of(e, flying), flight)


@kernel
def fly_all(keys, arrival, cell, until, flying, flight):
    """``fly`` of every environment, from the same cell; arrays (e, ...)."""
    for e in range(len(keys)):
        fly(keys[e], arrival[e], cell, until, flying_of(e, flying), flight)
