"""An urban map: buildings whose walls reflect, roads, junctions and small scatterers."""

from __future__ import annotations

import tomllib
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Self

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from pydantic import ConfigDict, FiniteFloat, field_validator, model_validator
from pydantic.dataclasses import dataclass

from wavegym.core.arrays import Array, check_finite
from wavegym.core.errors import InputError, check_choice, check_positive, check_within
from wavegym.core.parameters import in_one_line, make_checked

Point = tuple[FiniteFloat, FiniteFloat]
MAPS = Path(__file__).parent / "cities"
CLOSED = ConfigDict(extra="forbid")


@in_one_line
@dataclass(frozen=True, config=CLOSED)
class Building:
    """An opaque polygon whose walls reflect like mirrors.

    Args:
        corners: (x, y) in m, in order, clockwise or anticlockwise; the last wall leads back to the first corner.
        reflectivity: fraction of the power that a wall reflects, in [0, 1].

    Raises:
        InputError: fewer than three corners, walls that cross, no area, a reflectivity outside [0, 1].
    """

    corners: tuple[Point, ...]
    reflectivity: float = 0.4

    @field_validator("corners")
    @classmethod
    def _one_area(cls, corners: tuple[Point, ...]) -> tuple[Point, ...]:
        ring = corners[:-1] if len(corners) > 1 and corners[0] == corners[-1] else corners
        return _polygon("a building's corners", ring)

    @field_validator("reflectivity")
    @classmethod
    def _passive(cls, reflectivity: float) -> float:
        return check_within("reflectivity", reflectivity, 0.0, 1.0)


@in_one_line
@dataclass(frozen=True, config=CLOSED)
class Road:
    """A strip on which targets drive.

    Args:
        centre: (x, y) in m along the centre line, at least two points.
        width: m.

    Raises:
        InputError: fewer than two different points, a width that is not > 0.
    """

    centre: tuple[Point, ...]
    width: float

    @model_validator(mode="after")
    def _leads_somewhere(self) -> Self:
        check_positive("a road's width", self.width, "m")
        if not shapely.LineString(self.centre if len(self.centre) > 1 else self.centre * 2).length > 0.0:
            raise InputError(f"a road's centre is {self.centre}, expected at least two different points")
        return self


@in_one_line
@dataclass(frozen=True, config=CLOSED)
class UrbanMap:
    """The map of an urban scene that a radar uses (Barbosa et al., figure 3).

    Args:
        buildings: they must not overlap.
        roads: where targets are expected.
        junctions: polygons, corners (x, y) in m, inside which targets are expected to turn.
        discretes: (x, y) in m of small scatterers such as trees.

    Raises:
        InputError: two buildings overlap, or a polygon is invalid.
    """

    buildings: tuple[Building, ...] = ()
    roads: tuple[Road, ...] = ()
    junctions: tuple[tuple[Point, ...], ...] = ()
    discretes: tuple[Point, ...] = ()

    @model_validator(mode="after")
    def _apart(self) -> Self:
        for junction in self.junctions:
            _polygon("a junction's corners", junction)
        for one, other in combinations(self.buildings, 2):
            shared = shapely.Polygon(one.corners).intersection(shapely.Polygon(other.corners)).area
            if shared > 0.0:
                raise InputError(
                    f"the buildings with corners {one.corners[0]} and {other.corners[0]} overlap by {shared:g} m²,"
                    " expected buildings that stand apart"
                )
        return self

    @classmethod
    def load(cls, source: str | Path) -> UrbanMap:
        """An urban map from a TOML file whose tables are the fields of this class, or a map of wavegym by its name.

        >>> len(UrbanMap.load("intersection").walls)
        16

        Raises:
            InputError: no such map or file, or the file holds no map, or an empty one.
        """
        own = {file.stem: file for file in sorted(MAPS.glob("*.toml"))}
        file = own.get(str(source), Path(source))
        if not file.suffix:
            check_choice("city", str(source), own)
        try:
            table = tomllib.loads(file.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise InputError(f"the map file {file} cannot be read: {error}") from None
        made = make_checked(cls, table, f" in {file}")
        if not made.buildings and not made.roads:
            raise InputError(f"the map file {file} has no buildings and no roads, expected a city")
        return made

    @cached_property
    def walls(self) -> Array:
        """Ends of each wall, x0, y0, x1, y1 in m, (wall, 4); the outside is on the right-hand side."""
        rows = [(*a, *b) for each in self.buildings for a, b in _sides(each.corners)]
        return np.array(rows, dtype=np.float64).reshape(-1, 4)

    @cached_property
    def reflectivity(self) -> Array:
        """Fraction of the power that each wall reflects, (wall,)."""
        return np.array([each.reflectivity for each in self.buildings for _ in each.corners], dtype=np.float64)

    def indoors(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether points (x, y) in m, (..., 2), lie inside a building, (...); InputError for a wrong shape."""
        points = check_finite("points", points, 2)
        return np.asarray(shapely.contains_xy(self._built, points[..., 0], points[..., 1]))

    def on_road(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether points (x, y) in m, (..., 2), lie on a road, (...); InputError for a wrong shape."""
        points = check_finite("points", points, 2)
        return np.asarray(shapely.contains_xy(self.paved, points[..., 0], points[..., 1]))

    def check_outdoors(self, name: str, point: Point) -> None:
        """InputError if an antenna stands inside a building; the error names the nearest point outside."""
        if self.indoors(point):
            wall = self._built.boundary
            out = wall.interpolate(wall.project(shapely.Point(point)))
            raise InputError(
                f"{name} is {tuple(point)} m, inside a building, expected a place outside all buildings"
                f" (nearest wall: ({out.x:g}, {out.y:g}))"
            )

    def check_drivable(self, name: str, points: ArrayLike) -> None:
        """InputError if the route through points (x, y) in m, (time, 2), enters a building; the error says where."""
        crossed = shapely.LineString(check_finite(name, points, 2)).intersection(self._built)
        if crossed.length > 0.0:
            x, y = shapely.get_coordinates(crossed)[0]
            raise InputError(
                f"{name} leads into a building at ({x:g}, {y:g}) m, expected a route outside all buildings"
            )

    def check_roads(self) -> None:
        """InputError if a road enters a building."""
        for road, strip in zip(self.roads, self._strips, strict=True):
            if strip.intersection(self._built).area > 0.0:
                raise InputError(
                    f"the road along {road.centre} leads into a building, expected roads outside all buildings"
                )

    @cached_property
    def _built(self) -> shapely.Geometry:
        return _prepared([shapely.Polygon(each.corners) for each in self.buildings])

    @cached_property
    def paved(self) -> shapely.Geometry:
        """All roads as one area."""
        return _prepared(self._strips)

    @property
    def _strips(self) -> list[shapely.Geometry]:
        return [
            shapely.LineString(r.centre).buffer(r.width / 2, cap_style="flat", join_style="mitre") for r in self.roads
        ]


def _polygon(name: str, corners: tuple[Point, ...]) -> tuple[Point, ...]:
    """The corners anticlockwise; InputError unless they bound one area."""
    if len(set(corners)) < 3:
        raise InputError(f"{name} are {corners}, expected at least three different ones")
    polygon = shapely.Polygon(corners)
    if not polygon.is_valid or not polygon.area > 0.0:
        reason = shapely.is_valid_reason(polygon)
        raise InputError(f"{name} are {corners}, expected walls that do not cross and bound an area ({reason})")
    return corners if shapely.is_ccw(polygon.exterior) else corners[::-1]


def _sides(corners: tuple[Point, ...]) -> list[tuple[Point, Point]]:
    return list(zip(corners, (*corners[1:], corners[0]), strict=True))


def _prepared(parts: list[shapely.Geometry]) -> shapely.Geometry:
    whole = shapely.union_all(parts)
    shapely.prepare(whole)
    return whole
