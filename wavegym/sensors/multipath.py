"""Multipath in an urban map: an antenna and its mirror images in one wall or in two successive walls.

Tables on a grid over the map hold the distance to roads, the junctions, the visible images of an antenna, and what all
antennas see. Each table is computed once and shared by all callers: do not write to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import Array, check_finite, check_last_axes, check_shape
from wavegym.core.errors import InputError, check_non_negative, check_positive
from wavegym.sensors import multipath_kernels as kernels
from wavegym.sensors.multipath_kernels import SightTable
from wavegym.sensors.urban_map import Point, UrbanMap

MOST_CELLS = 10_000_000
BEYOND = 10.0  # m, margin of a grid around everything on the map
FINE, MANY = 0.5, 1_000_000  # m, cells: a sight table has wider cells only where it would have more of them


@dataclass(frozen=True)
class Antenna:
    """An antenna in an urban map, and its mirror images.

    A ray from the antenna to a point over up to two walls is as long as the straight line from an image to the point,
    and arrives from the same direction. So each image acts as an antenna for delay, Doppler shift and direction.

    Args:
        urban_map: the map whose walls reflect.
        position: (x, y) in m, outside the buildings; for an array, its centre.
        axis: direction of the line of array elements, a unit vector.

    Raises:
        InputError: a position that is not finite or inside a building, an axis of another length than 1.
    """

    urban_map: UrbanMap
    position: Point
    axis: Point = (1.0, 0.0)

    def __post_init__(self) -> None:
        check_shape("the antenna's position", check_finite("the antenna's position", self.position), (2,))
        self.urban_map.check_outdoors("the antenna's position", self.position)
        check_shape("the antenna's axis", np.asarray(self.axis), (2,))
        if not abs(np.hypot(*self.axis) - 1.0) <= 1e-9:
            raise InputError(f"the antenna's axis is {self.axis}, expected a unit vector such as (1.0, 0.0)")

    @cached_property
    def via(self) -> NDArray[np.int64]:
        """Indices of the walls that form each image, in order from the antenna, (image, 2); -1 for none."""
        return self._all[0]

    @cached_property
    def images(self) -> Array:
        """Positions (x, y) in m, (image, 2): the antenna itself, then images in one wall, then images in two."""
        return self._all[1]

    @cached_property
    def axes(self) -> Array:
        """Axis of the array in each image, (image, 2): a wall reflects it."""
        ends = np.array(self.position) + np.array(self.axis)
        seen = []
        for image, walls in zip(self.images, self.via, strict=True):
            end = ends
            for wall in walls[walls >= 0]:
                end = mirrored(end, self.urban_map.walls[wall])
            seen.append(end - image)
        return np.array(seen)

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """Number of walls that form each image, (image,)."""
        return np.asarray((self.via >= 0).sum(axis=1))

    @cached_property
    def reflected(self) -> Array:
        """Fraction of the power left after these walls, (image,)."""
        factors = np.append(self.urban_map.reflectivity, 1.0)  # the last for no wall, whose number is -1
        return np.asarray(factors[self.via].prod(axis=1))

    def visible(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Which images are visible from points (x, y) in m, (..., 2): (..., image).

        Walls are opaque, their ends included. InputError for a wrong shape.
        """
        points, lead = _flat(points)
        return np.asarray(kernels.visible(points, *self._rays)).reshape(*lead, len(self.images))

    def directly_visible(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether no wall hides the antenna from points (x, y) in m, (..., 2): the first image of ``visible``."""
        points, lead = _flat(points)
        return np.asarray(
            kernels.directly_visible(points, np.array(self.position, np.float64), self.urban_map.walls)
        ).reshape(lead)

    def bounces(self, points: ArrayLike) -> Array:
        """Reflection points of the rays to points (..., 2), in order from the antenna, (x, y) in m, (..., image, 2, 2).

        NaN where there is no reflection. InputError for a wrong shape.
        """
        points, lead = _flat(points)
        return np.asarray(kernels.bounces(points, *self._rays)).reshape(*lead, len(self.images), 2, 2)

    @property
    def _rays(self) -> tuple[NDArray[Any], ...]:
        return np.array(self.position, np.float64), self.images, self._all[2], self.via, self.urban_map.walls

    @cached_property
    def _all(self) -> tuple[NDArray[np.int64], Array, Array]:
        """``via``, ``images``, and for each image the image in its first wall alone."""
        walls, position = self.urban_map.walls, np.array(self.position, np.float64)
        via, images, firsts = [(-1, -1)], [position], [position]
        ones = [w for w in range(len(walls)) if kernels.outside(*position, walls[w]) > 0.0]
        once = {w: mirrored(position, walls[w]) for w in ones}
        for w in ones:
            via.append((w, -1))
            images.append(once[w])
            firsts.append(once[w])
        for w in ones:
            for other in range(len(walls)):
                if other != w and kernels.outside(*once[w], walls[other]) > 0.0:
                    via.append((w, other))
                    images.append(mirrored(once[w], walls[other]))
                    firsts.append(once[w])
        return np.array(via, np.int64), np.array(images), np.array(firsts)


def mirrored(points: ArrayLike, wall: ArrayLike) -> Array:
    """Mirror images of points (..., 2) in the line through a wall (x0, y0, x1, y1)."""
    points, wall = check_last_axes("points", points, 2), check_last_axes("wall", wall, 4)
    x, y = points[..., 0] - wall[0], points[..., 1] - wall[1]
    dx, dy = wall[2] - wall[0], wall[3] - wall[1]
    twice = 2.0 * (x * dy - y * dx) / (dx * dx + dy * dy)
    return np.stack([points[..., 0] - twice * dy, points[..., 1] + twice * dx], axis=-1)


def _flat(points: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    points = check_finite("points", points, 2)
    return np.array(points.reshape(-1, 2), order="C"), points.shape[:-1]


@dataclass(frozen=True)
class Grid:
    """Square cells over an urban map, numbered by column and row from the south-west.

    Args:
        corner: (x, y) of the south-western corner, m.
        cell: width of a cell, m, > 0.
        shape: columns and rows.
    """

    corner: tuple[float, float]
    cell: float
    shape: tuple[int, int]

    @classmethod
    def over(cls, urban_map: UrbanMap, antennas: tuple[tuple[float, float], ...] = (), cell: float = 1.0) -> Grid:
        """A grid over the whole map and all antennas. InputError: a cell not > 0, or too many cells."""
        check_positive("cell", cell, "m")
        roads = shapely.get_coordinates(urban_map.paved)
        every = np.concatenate([urban_map.walls.reshape(-1, 2), roads, np.array(antennas, np.float64).reshape(-1, 2)])
        low, high = (every.min(axis=0), every.max(axis=0)) if len(every) else (np.zeros(2), np.zeros(2))
        low, high = np.floor(low - BEYOND), np.ceil(high + BEYOND)
        columns, rows = np.ceil((high - low) / cell).astype(int)
        if columns * rows > MOST_CELLS:
            span = f"{high[0] - low[0]:g} m by {high[1] - low[1]:g} m"
            raise InputError(f"map and antennas span {span} in cells of {cell:g} m, expected {MOST_CELLS:.0e} at most")
        return cls((float(low[0]), float(low[1])), cell, (int(columns), int(rows)))

    @cached_property
    def centres(self) -> Array:
        """Centre (x, y) of every cell in m, (column, row, 2)."""
        x, y = (low + self.cell * (np.arange(n) + 0.5) for low, n in zip(self.corner, self.shape, strict=True))
        return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)

    def at(self, points: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Column and row (..., 2) of the cells nearest to points (..., 2) in m, and whether the points are inside."""
        place = np.floor((check_last_axes("points", points, 2) - self.corner) / self.cell).astype(np.int64)
        inside = ((place >= 0) & (place < self.shape)).all(axis=-1)
        return np.clip(place, 0, np.array(self.shape) - 1), np.asarray(inside)


@dataclass(frozen=True)
class VisibilityMap:
    """From which cells of a grid each image of an antenna is visible; images visible from no cell are left out.

    A point has the visibility of the centre of its cell.
    """

    grid: Grid
    which: NDArray[np.int64]  # (image,), index among the images of the antenna
    images: Array  # (image, 2), m
    axes: Array  # (image, 2), axis of the array in each image
    order: NDArray[np.int64]  # (image,), number of walls
    reflected: Array  # (image,), fraction of the power left after the walls
    visible: NDArray[np.bool_]  # (column, row, image)

    def at(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Which images are visible from points (..., 2) in m, (..., image); none beyond the edge of the grid."""
        place, inside = self.grid.at(points)
        return np.asarray(self.visible[place[..., 0], place[..., 1]] & inside[..., None])


@lru_cache(maxsize=16)
def visibility_map(antenna: Antenna, grid: Grid) -> VisibilityMap:
    """See ``VisibilityMap``. The antenna itself always comes first, even if visible from no cell."""
    outdoors = np.asarray(~antenna.urban_map.indoors(grid.centres))
    visible = np.zeros((*grid.shape, len(antenna.images)), dtype=np.bool_)
    visible[outdoors] = antenna.visible(grid.centres[outdoors])
    kept = np.flatnonzero(visible.any(axis=(0, 1)) | (antenna.order == 0))
    return VisibilityMap(
        grid,
        kept,
        antenna.images[kept],
        antenna.axes[kept],
        antenna.order[kept],
        antenna.reflected[kept],
        visible[..., kept],
    )


@lru_cache(maxsize=16)
def metres_to_road(urban_map: UrbanMap, grid: Grid) -> Array:
    """Distance from the centre of each cell to the nearest road in m, (column, row); infinite without roads."""
    far = shapely.distance(urban_map.paved, shapely.points(grid.centres))
    return np.asarray(np.nan_to_num(far, nan=np.inf))


@lru_cache(maxsize=16)
def in_junctions(urban_map: UrbanMap, grid: Grid) -> NDArray[np.bool_]:
    """Whether the centre of each cell lies in a junction, (column, row)."""
    whole = shapely.union_all([shapely.Polygon(corners) for corners in urban_map.junctions])
    return np.asarray(shapely.contains_xy(whole, grid.centres[..., 0], grid.centres[..., 1]))


@lru_cache(maxsize=16)
def sight_table(antennas: tuple[Antenna, ...], reach: float, margin: float) -> SightTable:
    """From where all antennas on one map with roads are directly visible.

    The table covers all roads, prolonged by ``reach``, and ``margin`` around them (m).

    Raises:
        InputError: a reach or margin that is negative or not finite.
    """
    check_non_negative("reach", reach), check_non_negative("margin", margin)
    ends = []
    for road in antennas[0].urban_map.roads:
        centre = np.array(road.centre, np.float64)
        for a, b in ((centre[1:], centre[:-1]), (centre[:-1], centre[1:])):
            length = np.linalg.norm(b - a, axis=1, keepdims=True)
            ends.append(b + reach * np.divide(b - a, length, out=np.zeros_like(a), where=length > 0.0))
    every = np.concatenate(ends)
    low, high = every.min(axis=0) - margin - BEYOND, every.max(axis=0) + margin + BEYOND
    cell = max(FINE, float(np.sqrt(np.prod(high - low) / MANY)))
    columns, rows = np.ceil((high - low) / cell).astype(int)
    grid = Grid((float(low[0]), float(low[1])), cell, (int(columns), int(rows)))
    clear = np.logical_and.reduce([antenna.directly_visible(grid.centres) for antenna in antennas])
    return SightTable(*grid.corner, 1.0 / cell, clear)
