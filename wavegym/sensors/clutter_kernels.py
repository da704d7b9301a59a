"""A field of Poisson clutter over the measurement plane, in compiled form; ``clutter.py`` has the public function.

The plane is divided into equal cells. A cell holds a Poisson number of points, uniform in the cell: a Poisson field of
constant density. Number and places come by counter from (key, column, row), so a point depends on the key and the
density alone. A larger gate finds the points of a smaller one, and all trackers meet the same clutter. Only cells that
overlap a gate are evaluated.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.gate_kernels import gate_volume_one, in_gate

ASPECT = 0.2
"""First side of a cell over its second one, s for range and range-rate: about that of a gate, which saves cells."""
THINNEST = 1e-20
"""Density below which cells do not grow any more and hold less than one expected point each."""
FARTHEST = 2.0**40
"""Greatest distance of a gate from the origin, in cells: a point's place keeps at least 12 bits within its cell."""
LONGEST = 1e8
"""Greatest number of columns and rows of cells that a gate spans."""
MOST_IN_CELL = 20
"""Most points of a cell: of a Poisson number with mean 1, more have probability 2e-20, below a draw's resolution."""
SLACK = 2.0**-10
"""Widens a gate by this share of a cell, more than the rounding of places, so that no cell at its border is lost."""


@kernel
def room(z, count):
    """Return z if it has at least ``count`` rows, else a larger array that begins with the rows of z."""
    if count <= len(z):
        return z
    larger = np.empty((2 * count, 2))
    for m in range(len(z)):
        larger[m, 0], larger[m, 1] = z[m, 0], z[m, 1]
    return larger


@inlined
def cell_sides(density):
    """Both sides of a cell; its area is 1 / density, so it expects one point."""
    second = np.sqrt(1.0 / (ASPECT * max(density, THINNEST)))
    return ASPECT * second, second


@inlined
def reach_one(t, L, gate):
    """Half the sides of the box around gate t."""
    return gate * L[t, 0, 0], gate * np.sqrt(L[t, 1, 0] * L[t, 1, 0] + L[t, 1, 1] * L[t, 1, 1])


@kernel
def gate_load(t, centre, L, gate, density):
    """The expected points of gate t; inf if its centre is beyond FARTHEST cells or no number, or if it spans more than
    LONGEST columns and rows; NaN or inf without a finite volume.
    """
    sides, reach = cell_sides(density), reach_one(t, L, gate)
    if not (abs(centre[t, 0]) <= FARTHEST * sides[0] and abs(centre[t, 1]) <= FARTHEST * sides[1]):
        return np.inf
    if reach[0] / sides[0] + reach[1] / sides[1] > 0.5 * LONGEST:
        return np.inf
    return density * gate_volume_one(t, L, gate)


@kernel
def most_load(present, centre, L, gate, density):
    """The greatest ``gate_load`` of a present gate; NaN if a gate's is NaN."""
    most = 0.0
    for t in range(len(present)):
        if present[t]:
            load = gate_load(t, centre, L, gate, density)
            most = load if load > most or np.isnan(load) else most
    return most


@inlined
def cell_of(place, side, slack):
    """The number of the cell that holds a coordinate, moved by ``slack`` cells."""
    return np.int64(np.floor(place / side + slack))


@inlined
def poisson(u, mean, none):
    """The Poisson number with mean <= 1 for the uniform draw ``u`` in (0, 1), by inversion; none: exp(-mean)."""
    count, chance = 0, none
    left = u - chance
    while left > 0.0 and count < MOST_IN_CELL:
        count += 1
        chance *= mean / count
        left -= chance
    return count


@inlined
def border_one(t, L, gate, w):
    """Whitened by L, a gate is a circle; the second coordinate of gate t's upper border where the first one is w."""
    return L[t, 1, 0] * w + L[t, 1, 1] * np.sqrt(max(gate * gate - w * w, 0.0))


@kernel
def in_earlier_gate(t, z0, z1, centre, L, present, gate):
    """Whether (z0, z1) lies in a present gate numbered below t."""
    covered = False
    for s in range(t):
        covered = covered or (present[s] and in_gate(s, z0, z1, centre, L, gate))
    return covered


@inlined
def add_cell(key, column, row, sides, mean, none, t, centre, L, present, gate, z, count):
    """``add_clutter`` for the points of one cell that lie in gate t and in none before it; key: that of the cell."""
    for n in range(poisson(uniform(key, 0), mean, none)):
        z0, z1 = (column + uniform(key, 2 * n + 1)) * sides[0], (row + uniform(key, 2 * n + 2)) * sides[1]
        if in_gate(t, z0, z1, centre, L, gate) and not in_earlier_gate(t, z0, z1, centre, L, present, gate):
            if count == len(z):
                z = room(z, count + 1)
            z[count, 0], z[count, 1] = z0, z1
            count += 1
    return z, count


@inlined
def add_gate(key, sides, mean, none, t, centre, L, present, gate, z, count):
    """``add_clutter`` for gate t: column by column, those rows of cells that overlap the gate.

    ``low`` and ``high`` are a column's borders, whitened; ``top`` is where the gate's upper border is highest. The
    lower border is the upper one turned by half a circle, so it is lowest at -top.
    """
    reach = reach_one(t, L, gate)
    top = gate * gate * L[t, 1, 0] / reach[1]
    first = cell_of(centre[t, 0] - reach[0], sides[0], -SLACK)
    for column in range(first, cell_of(centre[t, 0] + reach[0], sides[0], SLACK) + 1):
        low = max((column * sides[0] - centre[t, 0]) / L[t, 0, 0], -gate)
        high = min(((column + 1) * sides[0] - centre[t, 0]) / L[t, 0, 0], gate)
        below = border_one(t, L, gate, min(max(top, -high), -low))
        above = border_one(t, L, gate, min(max(top, low), high))
        bottom, own = cell_of(centre[t, 1] - below, sides[1], -SLACK), stream(key, column)
        for row in range(bottom, cell_of(centre[t, 1] + above, sides[1], SLACK) + 1):
            z, count = add_cell(stream(own, row), column, row, sides, mean, none, t, centre, L, present, gate, z, count)
    return z, count


@kernel
def add_clutter(key, centre, L, present, gate, density, z, count):
    """Append those points of the field of ``key`` that lie in a present gate to z from ``count``.

    centre (t, 2), L (t, 2, 2), present (t,) bool, z (capacity, 2). Returns z, or a larger copy, and the new count. A
    point in several gates is appended once, with the first of them. A gate without a finite load gets no points.
    """
    if density > 0.0:
        sides = cell_sides(density)
        mean = density * (sides[0] * sides[1])
        none = np.exp(-mean)
        for t in range(len(present)):
            if present[t] and gate_load(t, centre, L, gate, density) < np.inf:
                z, count = add_gate(key, sides, mean, none, t, centre, L, present, gate, z, count)
    return z, count
