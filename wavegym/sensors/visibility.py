"""Tables on a grid over an urban map: distance to roads, junctions, visible images of an antenna, joint sight.

Each table is computed once and shared by all callers: do not write to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from wavegym.core.array_checks import check_last_axes
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_non_negative, check_positive
from wavegym.sensors.multipath import Antenna
from wavegym.sensors.sight_kernels import SightTable
from wavegym.sensors.urban_map import UrbanMap

MOST_CELLS = 10_000_000
BEYOND = 10.0  # m, margin of a grid around everything on the map
FINE, MANY = 0.5, 1_000_000  # m, cells: a sight table has wider cells only where it would have more of them


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
