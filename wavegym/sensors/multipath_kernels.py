"""Kernels of ``multipath.py``: from which points each mirror image of an antenna is visible.

A wall is (x0, y0, x1, y1) with the outside on its right-hand side. A ray that reflects at one wall or two reaches a
point as if it came straight from the image of the antenna in these walls. The check follows the ray backwards: from the
point to the last wall, to the wall before it, and to the antenna. A sight table has the result for the cells of a grid.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wavegym.core.kernels import inlined, kernel

NONE = -1  # instead of a wall's number
MOST_WALLS = 2  # of a propagation path; with the reflection at the target, the three reflections of the paper


@inlined
def outside(x, y, wall):
    """Distance of (x, y) to the right of a wall, on its outside, times the length of the wall."""
    return (y - wall[1]) * (wall[0] - wall[2]) + (x - wall[0]) * (wall[3] - wall[1])


@inlined
def along(x, y, u, v, wall):
    """Where the line from (x, y) to (u, v) crosses a wall between them: 0 to 1 from end to end of the wall."""
    near, far = outside(x, y, wall), outside(u, v, wall)
    part = near / (near - far)
    px, py = x + part * (u - x), y + part * (v - y)
    dx, dy = wall[2] - wall[0], wall[3] - wall[1]
    return ((px - wall[0]) * dx + (py - wall[1]) * dy) / (dx * dx + dy * dy)


@inlined
def clear(x, y, u, v, walls, one, other):
    """Whether (x, y) sees (u, v); the walls ``one`` and ``other`` do not block. The end of a wall blocks."""
    dx, dy = u - x, v - y
    for w in range(len(walls)):
        if w != one and w != other:
            wall = walls[w]
            near, far = outside(x, y, wall), outside(u, v, wall)
            if (near < 0.0) != (far < 0.0):
                left = dx * (wall[1] - y) - dy * (wall[0] - x)
                right = dx * (wall[3] - y) - dy * (wall[2] - x)
                if left * right <= 0.0:
                    return False
    return True


@inlined
def bounce(x, y, u, v, wall):
    """Where a ray from (x, y) towards the image (u, v) meets a wall, and whether it meets the outside of the wall."""
    if outside(x, y, wall) <= 0.0 or outside(u, v, wall) >= 0.0:
        return 0.0, 0.0, False
    part = along(x, y, u, v, wall)
    return wall[0] + part * (wall[2] - wall[0]), wall[1] + part * (wall[3] - wall[1]), 0.0 < part < 1.0


@inlined
def reaches(x, y, antenna, image, first, one, other, walls):
    """Whether a ray from the antenna over the walls ``one`` and ``other`` reaches (x, y), and its reflection points.

    ``image`` is the image of the antenna in both walls, ``first`` the image in ``one`` alone.
    """
    ax, ay = antenna[0], antenna[1]
    if one == NONE:
        return clear(x, y, ax, ay, walls, NONE, NONE), 0.0, 0.0, 0.0, 0.0
    lx, ly, last = x, y, NONE
    px, py = 0.0, 0.0
    if other != NONE:
        lx, ly, met = bounce(x, y, image[0], image[1], walls[other])
        last = other
        if not met:
            return False, 0.0, 0.0, 0.0, 0.0
    px, py, met = bounce(lx, ly, first[0], first[1], walls[one])
    if not met or not clear(ax, ay, px, py, walls, one, NONE) or not clear(px, py, lx, ly, walls, one, last):
        return False, 0.0, 0.0, 0.0, 0.0
    if other == NONE:
        return True, px, py, 0.0, 0.0
    return clear(lx, ly, x, y, walls, other, NONE), px, py, lx, ly


@kernel
def directly_visible(points, place, walls):
    """Whether no wall stands between each of points (n, 2) and place (2,), (n,)."""
    out = np.empty(len(points), np.bool_)
    for n in range(len(points)):
        out[n] = clear(points[n, 0], points[n, 1], place[0], place[1], walls, NONE, NONE)
    return out


@kernel
def visible(points, antenna, images, firsts, via, walls):
    """Which images are visible from which points, (point, image)."""
    result = np.empty((len(points), len(images)), dtype=np.bool_)
    for p in range(len(points)):
        for i in range(len(images)):
            result[p, i] = reaches(
                points[p, 0], points[p, 1], antenna, images[i], firsts[i], via[i, 0], via[i, 1], walls
            )[0]
    return result


@kernel
def bounces(points, antenna, images, firsts, via, walls):
    """Reflection points of each ray, in order from the antenna, (point, image, 2, 2); NaN where there are none."""
    result = np.full((len(points), len(images), 2, 2), np.nan)
    for p in range(len(points)):
        for i in range(len(images)):
            one, other = via[i, 0], via[i, 1]
            met, ax, ay, bx, by = reaches(points[p, 0], points[p, 1], antenna, images[i], firsts[i], one, other, walls)
            if met and one != NONE:
                result[p, i, 0, 0], result[p, i, 0, 1] = ax, ay
            if met and other != NONE:
                result[p, i, 1, 0], result[p, i, 1, 1] = bx, by
    return result


class SightTable(NamedTuple):
    """Cells of a ``wavegym.sensors.multipath.Grid``; a point outside the grid counts as in the nearest cell."""

    west: float  # m
    south: float  # m
    per_metre: float  # cells
    clear: NDArray[np.bool_]  # (column, row); no columns if nothing can hide a target


@inlined
def is_clear(x, y, table):
    """Whether every antenna is visible from the centre of the cell of (x, y); not finite: of the first cell."""
    column = int((x - table.west) * table.per_metre)
    row = int((y - table.south) * table.per_metre)
    return table.clear[
        min(max(column, 0), table.clear.shape[0] - 1), min(max(row, 0), table.clear.shape[1] - 1)
    ]  # fmt: skip
