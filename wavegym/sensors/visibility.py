"""What is where in a city, looked up on a grid: roads, junctions, and which images of an antenna are seen.

Tables are computed once for a city, an antenna and a grid, and kept for whoever asks again: they are not to be written.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_positive
from wavegym.sensors.checks import shaped
from wavegym.sensors.multipath import Antenna
from wavegym.sensors.urban_map import City

MOST_CELLS = 10_000_000
BEYOND = 10.0  # metres that a grid reaches past whatever stands in the city


@dataclass(frozen=True)
class Grid:
    """Square cells over a city, numbered by column and row from the south-west.

    Args:
        corner: (x, y) of the south-western corner in m.
        cell: width in m, > 0.
        shape: columns and rows.
    """

    corner: tuple[float, float]
    cell: float
    shape: tuple[int, int]

    @classmethod
    def over(cls, city: City, antennas: tuple[tuple[float, float], ...] = (), cell: float = 1.0) -> Grid:
        """Cells over all that stands in the city and all antennas. InputError: a cell not > 0, or too many."""
        check_positive("cell", cell, "m")
        roads = shapely.get_coordinates(city.paved)
        every = np.concatenate([city.walls.reshape(-1, 2), roads, np.array(antennas, np.float64).reshape(-1, 2)])
        low, high = (every.min(axis=0), every.max(axis=0)) if len(every) else (np.zeros(2), np.zeros(2))
        low, high = np.floor(low - BEYOND), np.ceil(high + BEYOND)
        columns, rows = np.ceil((high - low) / cell).astype(int)
        if columns * rows > MOST_CELLS:
            span = f"{high[0] - low[0]:g} m by {high[1] - low[1]:g} m"
            raise InputError(f"city and antennas span {span} in cells of {cell:g} m, expected {MOST_CELLS:.0e} at most")
        return cls((float(low[0]), float(low[1])), cell, (int(columns), int(rows)))

    @cached_property
    def centres(self) -> Array:
        """(x, y) of every cell's centre in m, (column, row, 2)."""
        x, y = (low + self.cell * (np.arange(n) + 0.5) for low, n in zip(self.corner, self.shape, strict=True))
        return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)

    def at(self, points: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Column and row (..., 2) of points (..., 2) in m, the nearest of those beyond the edge, and whether inside."""
        place = np.floor((shaped("points", points, 2) - self.corner) / self.cell).astype(np.int64)
        inside = ((place >= 0) & (place < self.shape)).all(axis=-1)
        return np.clip(place, 0, np.array(self.shape) - 1), np.asarray(inside)


@dataclass(frozen=True)
class SightMap:
    """The images of an antenna that are seen from anywhere on a grid, and from where.

    Looked up at the nearest cell's centre.
    """

    grid: Grid
    which: NDArray[np.int64]  # (image,), their numbers among the antenna's
    images: Array  # (image, 2), m
    order: NDArray[np.int64]  # (image,), walls
    reflected: Array  # (image,), part of the power that is left
    seen: NDArray[np.bool_]  # (column, row, image)

    def at(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Which images are seen from points (..., 2) in m, (..., image); none beyond the edge of the grid."""
        place, inside = self.grid.at(points)
        return np.asarray(self.seen[place[..., 0], place[..., 1]] & inside[..., None])


@lru_cache(maxsize=16)
def sight_map(antenna: Antenna, grid: Grid) -> SightMap:
    """See ``SightMap``. The antenna itself comes first, whether it is seen from anywhere or not."""
    open_air = np.asarray(~antenna.city.indoors(grid.centres))
    seen = np.zeros((*grid.shape, len(antenna.images)), dtype=np.bool_)
    seen[open_air] = antenna.seen(grid.centres[open_air])
    kept = np.flatnonzero(seen.any(axis=(0, 1)) | (antenna.order == 0))
    return SightMap(grid, kept, antenna.images[kept], antenna.order[kept], antenna.reflected[kept], seen[..., kept])


@lru_cache(maxsize=16)
def metres_to_road(city: City, grid: Grid) -> Array:
    """From every cell's centre to the nearest road, 0 on one, (column, row); m, infinite without roads."""
    far = shapely.distance(city.paved, shapely.points(grid.centres))
    return np.asarray(np.nan_to_num(far, nan=np.inf))


@lru_cache(maxsize=16)
def in_junctions(city: City, grid: Grid) -> NDArray[np.bool_]:
    """Which cells lie in a junction, (column, row)."""
    whole = shapely.union_all([shapely.Polygon(corners) for corners in city.junctions])
    return np.asarray(shapely.contains_xy(whole, grid.centres[..., 0], grid.centres[..., 1]))
