"""Compiled validation gates and Poisson clutter; ``clutter.py`` has the public functions.

Gate t is the ellipse {z : |L_t^-1 (z - centre_t)| <= gate} with L_t (2, 2) the lower Cholesky factor of the innovation
covariance: centre (t, 2), L (t, 2, 2).

The measurement plane is divided into equal cells. A cell has a Poisson number of points, uniform in the cell: a Poisson
field of constant density. Counters make number and places from (key, column, row), so a point depends on the key and
the density alone. A larger gate finds the points of a smaller one, and all trackers meet the same clutter. Only cells
that overlap a gate are evaluated, each of them once: column by column, in runs of rows that the gates cover.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.array_kernels import copy_matrix
from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.core.kernels import batched, inlined, kernel


@kernel
def squared_distance(t, z0, z1, centre, L):
    """|L_t^-1 (z - centre_t)|^2, the squared Mahalanobis distance of z = (z0, z1); NaN if L_t is NaN."""
    w0 = (z0 - centre[t, 0]) / L[t, 0, 0]
    w1 = (z1 - centre[t, 1] - L[t, 1, 0] * w0) / L[t, 1, 1]
    return w0 * w0 + w1 * w1


@kernel
def in_gate(t, z0, z1, centre, L, gate):
    """Whether (z0, z1) lies in gate t; False if L_t is NaN."""
    return squared_distance(t, z0, z1, centre, L) <= gate * gate


@kernel
def in_a_gate(z0, z1, centre, L, present, gate):
    """Whether (z0, z1) lies in a present gate."""
    t = 0
    while t < len(present) and not (present[t] and in_gate(t, z0, z1, centre, L, gate)):
        t += 1
    return t < len(present)


@kernel
def gate_volume_one(t, L, gate):
    """Area of gate t, in the product of the measurement's units."""
    return np.pi * gate * gate * L[t, 0, 0] * L[t, 1, 1]


@inlined
def reach_one(t, L, gate):
    """Half of each side of the box around gate t."""
    return gate * L[t, 0, 0], gate * np.sqrt(L[t, 1, 0] * L[t, 1, 0] + L[t, 1, 1] * L[t, 1, 1])


@batched("(),(m,m)->()")
def volume(gate, L, area, mm):
    """gate_volume_one, element by element."""
    for e in range(area.shape[0]):
        area[e] = gate_volume_one(e, L, gate[e])


@batched("(m),(m),(m,m)->()")
def distance(z, centre, L, squared, mm):
    """squared_distance, element by element."""
    for e in range(squared.shape[0]):
        squared[e] = squared_distance(e, z[e, 0], z[e, 1], centre, L)


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

NOWHERE = -(2**62)
"""The number of a row or column beyond all cells."""
FIRST_ROOM = 1024
"""Points for which there is room at first."""


@kernel
def room(z, count):
    """z if it has at least ``count`` rows, else a larger array that begins with the rows of z."""
    if count <= len(z):
        return z
    larger = np.empty((2 * count, z.shape[1]))
    copy_matrix(z, larger[: len(z)])
    return larger


@inlined
def cell_sides(density):
    """Both sides of a cell. Its area is 1 / density, so its expected number of points is 1."""
    second = np.sqrt(1.0 / (ASPECT * max(density, THINNEST)))
    return ASPECT * second, second


@kernel
def gate_load(t, centre, L, gate, density):
    """Expected number of clutter points in gate t.

    Infinite if the centre is farther than FARTHEST cells or not a number, or if the gate spans more than LONGEST
    columns and rows. NaN or infinite if the volume is not finite.
    """
    sides, reach = cell_sides(density), reach_one(t, L, gate)
    if not (abs(centre[t, 0]) <= FARTHEST * sides[0] and abs(centre[t, 1]) <= FARTHEST * sides[1]):
        return np.inf
    if reach[0] / sides[0] + reach[1] / sides[1] > 0.5 * LONGEST:
        return np.inf
    return density * gate_volume_one(t, L, gate)


@kernel
def most_load(present, centre, L, gate, density):
    """The greatest ``gate_load`` of the present gates; NaN if one of them is NaN."""
    most = 0.0
    for t in range(len(present)):
        if present[t]:
            load = gate_load(t, centre, L, gate, density)
            most = load if load > most or np.isnan(load) else most
    return most


@inlined
def cell_of(place, side, slack):
    """The number of the cell that contains a coordinate, which is first moved by ``slack`` cells."""
    return np.int64(np.floor(place / side + slack))


@inlined
def poisson_terms(mean):
    """The probabilities of 0 to MOST_IN_CELL under a Poisson law with mean <= 1."""
    terms = np.empty(MOST_IN_CELL + 1)
    terms[0] = np.exp(-mean)
    for count in range(1, MOST_IN_CELL + 1):
        terms[count] = terms[count - 1] * (mean / count)
    return terms


@inlined
def poisson(u, terms):
    """The Poisson number for the uniform draw ``u`` in (0, 1), by inversion; terms: ``poisson_terms``."""
    count = 0
    left = u - terms[0]
    while left > 0.0 and count < MOST_IN_CELL:
        count += 1
        left -= terms[count]
    return count


@inlined
def border_one(t, L, gate, w):
    """Second coordinate of gate t's upper border at first coordinate w. Whitened by L, the gate is a circle."""
    return L[t, 1, 0] * w + L[t, 1, 1] * np.sqrt(max(gate * gate - w * w, 0.0))


@inlined
def rows_of(t, column, sides, centre, L, gate, top):
    """The first and the last row of those cells of a column that overlap gate t.

    ``low`` and ``high`` are the column's borders, whitened; ``top`` is where the gate's upper border is highest. The
    lower border is the upper one turned by half a circle, so it is lowest at -top.
    """
    low = max((column * sides[0] - centre[t, 0]) / L[t, 0, 0], -gate)
    high = min(((column + 1) * sides[0] - centre[t, 0]) / L[t, 0, 0], gate)
    below = border_one(t, L, gate, min(max(top, -high), -low))
    above = border_one(t, L, gate, min(max(top, low), high))
    return cell_of(centre[t, 1] - below, sides[1], -SLACK), cell_of(centre[t, 1] + above, sides[1], SLACK)


@inlined
def columns_of(t, sides, centre, L, gate):
    """The first and the last column of cells that overlaps gate t."""
    reach = reach_one(t, L, gate)[0]
    return cell_of(centre[t, 0] - reach, sides[0], -SLACK), cell_of(centre[t, 0] + reach, sides[0], SLACK)


@inlined
def run_after(ranges, count, done):
    """(first, last): the least number above ``done`` in ranges[: count], and the end of a range that contains it.

    last < first if there is none. A row of ``ranges`` begins with the first and the last number of a range.
    """
    first, last = -NOWHERE, NOWHERE
    for t in range(count):
        if ranges[t, 1] > done:
            first = min(first, max(ranges[t, 0], done + 1))
    for t in range(count):
        if ranges[t, 0] <= first:
            last = max(last, ranges[t, 1])
    return first, last


@inlined
def first_gate(row, z0, z1, rows, count, centre, L, gate):
    """The first gate of rows[: count] that contains (z0, z1), a point of a cell in ``row``; -1 if none does."""
    for j in range(count):
        if rows[j, 0] <= row <= rows[j, 1] and in_gate(rows[j, 2], z0, z1, centre, L, gate):
            return rows[j, 2]
    return -1


@inlined
def gates_of(column, sides, columns, top, centre, L, gate, rows):
    """Fill ``rows`` with (first row, last row, gate) of the gates that overlap a column; returns their number."""
    count = 0
    for t in range(len(columns)):
        if columns[t, 0] <= column <= columns[t, 1]:
            rows[count, 0], rows[count, 1] = rows_of(t, column, sides, centre, L, gate, top[t])
            rows[count, 2] = t
            count += 1
    return count


@inlined
def add_cell(key, column, row, sides, terms, rows, gates, centre, L, gate, found, count):
    """Append a cell's points in a gate of rows[: gates] to ``found`` from ``count``: place and first gate.

    ``key`` is the key of the cell.
    """
    for n in range(poisson(uniform(key, 0), terms)):
        z0, z1 = (column + uniform(key, 2 * n + 1)) * sides[0], (row + uniform(key, 2 * n + 2)) * sides[1]
        t = first_gate(row, z0, z1, rows, gates, centre, L, gate)
        if t >= 0:
            found[count, 0], found[count, 1], found[count, 2] = z0, z1, t
            count += 1
    return count


@kernel
def add_columns(key, column, last, sides, terms, columns, top, rows, centre, L, gate, found, count):
    """``add_cell`` for all cells in columns up to ``last`` that overlap a gate; returns the next column and the count.

    Stops before a column whose points do not fit in found (capacity, 3). columns (t, 2): the gates' first and last
    columns; rows (t, 3) is scratch space.
    """
    while column <= last:
        own, begin, gates = stream(key, column), count, gates_of(column, sides, columns, top, centre, L, gate, rows)
        row, end = run_after(rows, gates, NOWHERE)
        while row <= end:
            if count + MOST_IN_CELL > len(found):
                return column, begin
            count = add_cell(
                stream(own, row), column, row, sides, terms, rows, gates, centre, L, gate, found, count
            )  # fmt: skip
            row += 1
            if row > end:
                row, end = run_after(rows, gates, end)
        column += 1
    return column, count


@kernel
def append_by_gate(found, many, gates, z, count):
    """Append the places of found[: many] to z from ``count``, ordered by gate; within a gate the order stays."""
    at = np.zeros(gates + 1, np.int64)
    at[0] = count
    for m in range(many):
        at[np.int64(found[m, 2]) + 1] += 1
    for t in range(gates):
        at[t + 1] += at[t]
    for m in range(many):
        t = np.int64(found[m, 2])
        z[at[t], 0], z[at[t], 1] = found[m, 0], found[m, 1]
        at[t] += 1


@kernel
def add_clutter(key, centre, L, present, gate, density, z, count):
    """Append the points of the field of ``key`` that lie in a present gate to z from ``count``.

    centre (t, 2), L (t, 2, 2), present (t,) bool, z (capacity, 2). Returns z, or a larger copy, and the new count. A
    point in several gates is appended once, with the first of them. The points of a gate are ordered by column and row.
    A gate without a finite load gets no points. Each cell is evaluated once, however many gates overlap it.
    """
    if not density > 0.0:
        return z, count
    sides = cell_sides(density)
    terms, gates, many, top = poisson_terms(density * (sides[0] * sides[1])), len(present), 0, np.empty(len(present))
    columns, rows, found = np.empty((gates, 2), np.int64), np.empty((gates, 3), np.int64), np.empty((FIRST_ROOM, 3))
    for t in range(gates):
        columns[t, 0] = columns[t, 1] = NOWHERE
        if present[t] and gate_load(t, centre, L, gate, density) < np.inf:
            columns[t, 0], columns[t, 1] = columns_of(t, sides, centre, L, gate)
            top[t] = gate * gate * L[t, 1, 0] / reach_one(t, L, gate)[1]
    column, last = run_after(columns, gates, NOWHERE)
    while column <= last:
        column, many = add_columns(
            key, column, last, sides, terms, columns, top, rows, centre, L, gate, found, many
        )  # fmt: skip
        if column <= last:
            found = room(found, len(found) + 1)
        else:
            column, last = run_after(columns, gates, last)
    z = room(z, count + many)
    append_by_gate(found, many, gates, z, count)
    return z, count + many
