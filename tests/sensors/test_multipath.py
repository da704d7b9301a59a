"""Rays over walls: mirror images against a search on the walls for the shortest path; tables on a grid."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.optimize import minimize

from wavegym.core.errors import InputError
from wavegym.sensors.multipath import Antenna, Grid, in_junctions, metres_to_road, mirrored, sight_table, visibility_map
from wavegym.sensors.multipath_kernels import is_clear
from wavegym.sensors.urban_map import Building, Road, UrbanMap

CROSSING = UrbanMap.load("intersection")
SLANTED = UrbanMap(
    buildings=(
        Building(((0.0, 0.0), (40.0, 10.0), (35.0, 40.0), (5.0, 35.0)), 0.3),
        Building(((60.0, 0.0), (100.0, -5.0), (90.0, 45.0), (70.0, 30.0), (62.0, 20.0)), 0.5),  # one corner inwards
        Building(((0.0, 60.0), (50.0, 62.0), (80.0, 55.0), (60.0, 90.0))),
    )
)
SCENES = [(CROSSING, (2085.0, 1470.5), (1900, 2200, 1300, 1750)), (SLANTED, (50.0, 50.0), (-20, 120, -20, 100))]


def outdoors(urban_map: UrbanMap, box: tuple[int, int, int, int], count: int, seed: int) -> np.ndarray:
    low, high = np.array([box[::2], box[1::2]], np.float64)
    points = np.random.default_rng(seed).uniform(low, high, (20 * count, 2))
    return points[~urban_map.indoors(points)][:count]


def searched(
    urban_map: UrbanMap, start: tuple[float, float], end: np.ndarray, walls: list[np.ndarray]
) -> np.ndarray | None:
    """Reflection points of the shortest path from start to end that touches the lines of the walls in turn, or None.

    The length is convex in the positions on the lines: wherever a search ends, it is the minimum. Angles of incidence
    and reflection are equal there (Fermat) if the path does not pass through a wall.
    """
    if behind(start, walls[0]) or behind(end, walls[-1]):
        return None
    a, d = np.array([w[:2] for w in walls]), np.array([w[2:] - w[:2] for w in walls])

    def length(t: np.ndarray) -> float:
        path = np.vstack([start, a + t[:, None] * d, end])
        return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())

    t = np.full(len(walls), 0.5)
    t = minimize(length, t, method="Nelder-Mead", options={"xatol": 1e-3}).x  # the length has kinks where walls meet
    t = minimize(length, t, method="BFGS", options={"gtol": 1e-9}).x
    points = a + t[:, None] * d
    return points if ((t > 0.0) & (t < 1.0)).all() and is_ray(urban_map, start, points, end, d) else None


def behind(point, wall: np.ndarray) -> bool:
    return bool(shapely.is_ccw(shapely.LinearRing([wall[:2], wall[2:], point])))


def is_ray(urban_map: UrbanMap, start: tuple[float, float], points: np.ndarray, end: np.ndarray, d: np.ndarray) -> bool:
    """Whether the path reflects at every point as at a mirror, and no building blocks it."""
    path = np.vstack([start, points, end])
    for i, along in enumerate(d / np.linalg.norm(d, axis=1)[:, None], start=1):
        come, go = (step / max(np.linalg.norm(step), 1e-12) for step in (path[i] - path[i - 1], path[i + 1] - path[i]))
        across = np.array([along[1], -along[0]])  # to the right, away from the building
        if not (come @ across < 0.0 and abs(come @ across + go @ across) < 1e-4):
            return False
    solid = shapely.union_all([shapely.Polygon(b.corners) for b in urban_map.buildings])
    return shapely.LineString(path).intersection(solid).length < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(("urban_map", "position", "box"), SCENES)
def test_rays_by_one_wall_and_two_are_those_a_search_on_the_walls_finds(urban_map, position, box) -> None:
    antenna, found = Antenna(urban_map, position), 0
    for point in outdoors(urban_map, box, 7, seed=1):
        seen, bounces = antenna.visible(point), antenna.bounces(point)
        rays = {tuple(via): at for via, at, reached in zip(antenna.via.tolist(), bounces, seen, strict=True) if reached}
        for one in range(len(urban_map.walls)):
            for other in (-1, *(w for w in range(len(urban_map.walls)) if w != one)):
                walls = [urban_map.walls[w] for w in (one, other) if w >= 0]
                points = searched(urban_map, position, point, walls)
                assert ((one, other) in rays) == (points is not None), (point, one, other)
                if points is not None:
                    found += 1
                    np.testing.assert_allclose(rays[one, other][: len(walls)], points, atol=1e-3)
    assert found > 3


@pytest.mark.parametrize(("urban_map", "position", "box"), SCENES)
def test_the_straight_line_is_free_where_no_building_is_in_it(urban_map, position, box) -> None:
    points = outdoors(urban_map, box, 500, seed=2)
    solid = shapely.union_all([shapely.Polygon(b.corners) for b in urban_map.buildings])
    lines = shapely.linestrings(np.stack([np.broadcast_to(position, points.shape), points], axis=1))
    free = Antenna(urban_map, position).visible(points)[:, 0]
    np.testing.assert_array_equal(free, shapely.length(shapely.intersection(lines, solid)) < 1e-9)
    assert 0.1 < free.mean() < 0.9


@pytest.mark.parametrize(("urban_map", "position", "box"), SCENES)
def test_an_image_is_as_far_as_the_ray_is_long_and_the_path_back_is_the_same(urban_map, position, box) -> None:
    here = Antenna(urban_map, position)
    for point in outdoors(urban_map, box, 40, seed=3):
        there = Antenna(urban_map, tuple(point))
        paths = {tuple(via): d for via, d in zip(here.via.tolist(), distances(here, point), strict=True) if d}
        back = {tuple(via): d for via, d in zip(there.via.tolist(), distances(there, position), strict=True) if d}
        turned = {(b, a) if b >= 0 else (a, b): d for (a, b), d in back.items()}
        assert paths == pytest.approx(turned)
        for image, at, seen in zip(here.images, here.bounces(point), here.visible(point), strict=True):
            if seen:
                path = np.vstack([position, at[~np.isnan(at).any(axis=1)], point])
                length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
                assert np.linalg.norm(point - image) == pytest.approx(length, rel=1e-12)


def distances(antenna: Antenna, point) -> np.ndarray:
    """Distances from a point to the images visible from it; 0 for the others."""
    return np.where(antenna.visible(point), np.linalg.norm(np.asarray(point) - antenna.images, axis=1), 0.0)


def test_one_wall_reflects_where_the_papers_equation_puts_it() -> None:
    """Both distances from the wall's line, over those from the point: the squared equation, and its true root."""
    wall = Building(((10.0, 12.0), (-10.0, 8.0), (-10.0, 30.0), (10.0, 30.0)))
    antenna = Antenna(UrbanMap(buildings=(wall,)), (-4.0, 0.0))
    (r, k), m, c = ((-4.0, 0.0), (5.0, 3.0)), 0.2, 10.0
    (which,) = np.flatnonzero(antenna.visible(k) & (antenna.order == 1))
    xc, yc = antenna.bounces(k)[which, 0]
    assert yc == pytest.approx(m * xc + c)
    sides = [(-m * (x - xc) + y - yc) ** 2 / ((x - xc) ** 2 + (y - yc) ** 2) for x, y in (r, k)]
    assert sides[0] == pytest.approx(sides[1])


def test_what_is_left_of_the_power() -> None:
    antenna = Antenna(SLANTED, (50.0, 50.0))
    for via, left in zip(antenna.via, antenna.reflected, strict=True):
        assert left == pytest.approx(np.prod([SLANTED.reflectivity[w] for w in via if w >= 0]))
    assert antenna.order.tolist() == sorted(antenna.order)
    assert set(antenna.order) == {0, 1, 2}


def test_an_empty_map_has_nothing_but_the_antenna() -> None:
    antenna = Antenna(UrbanMap(), (1.0, 2.0))
    assert antenna.visible(np.zeros((3, 4, 2))).tolist() == [[[True]] * 4] * 3
    assert antenna.bounces([[0.0, 0.0]]).shape == (1, 1, 2, 2)


def test_a_mirror_image_of_an_image_is_the_point() -> None:
    wall = [1.0, 2.0, 5.0, -3.0]
    points = np.random.default_rng(0).normal(size=(5, 2))
    np.testing.assert_allclose(mirrored(mirrored(points, wall), wall), points, atol=1e-12)
    np.testing.assert_allclose(mirrored([[1.0, 2.0], [5.0, -3.0]], wall), [[1.0, 2.0], [5.0, -3.0]], atol=1e-12)


def test_mistakes() -> None:
    with pytest.raises(
        InputError, match=r"position is \(2000\.0, 1600\.0\) m, inside a building.*nearest wall: \(2045"
    ):
        Antenna(CROSSING, (2000.0, 1600.0))
    with pytest.raises(InputError, match=r"points has shape \(3,\), expected \(\.\.\., 2\)"):
        Antenna(CROSSING, (2085.0, 1470.5)).visible([1.0, 2.0, 3.0])


ANTENNA = Antenna(CROSSING, (2085.0, 1470.5))
GRID = Grid.over(CROSSING, (ANTENNA.position,), cell=5.0)


def test_the_grid_covers_the_map() -> None:
    corners = np.concatenate([CROSSING.walls.reshape(-1, 2), [ANTENNA.position]])
    assert GRID.at(corners)[1].all()
    place, inside = GRID.at(GRID.centres)
    assert inside.all()
    np.testing.assert_array_equal(place, np.stack(np.indices(GRID.shape), axis=-1))
    far, inside = GRID.at([[-1e4, 1e4]])
    assert (far.tolist(), inside.tolist()) == ([[0, GRID.shape[1] - 1]], [False])


def test_a_cell_has_the_visibility_of_its_centre() -> None:
    table = visibility_map(ANTENNA, GRID)
    rng = np.random.default_rng(0)
    place = rng.integers(GRID.shape, size=(400, 2))
    centres = GRID.centres[place[:, 0], place[:, 1]]
    centres = centres[~CROSSING.indoors(centres)]
    kept = table.which
    exact = ANTENNA.visible(centres)
    np.testing.assert_array_equal(table.at(centres), exact[:, kept])
    assert not np.delete(exact, kept, axis=1).any()
    np.testing.assert_array_equal(table.images, ANTENNA.images[kept])
    np.testing.assert_array_equal(table.order, ANTENNA.order[kept])
    np.testing.assert_array_equal(table.reflected, ANTENNA.reflected[kept])
    assert not table.at([[2000.0, 1600.0], [0.0, 0.0]]).any()  # indoors; off the grid
    assert visibility_map(ANTENNA, GRID) is table


def test_roads_and_junctions() -> None:
    far = metres_to_road(CROSSING, GRID)
    np.testing.assert_array_equal(far == 0.0, CROSSING.on_road(GRID.centres))
    (place,), _ = GRID.at([[2120.0, 1440.0]])
    x, y = GRID.centres[tuple(place)]  # in a building, between a road that ends at x = 2090 and one at y = 1490
    assert far[tuple(place)] == pytest.approx(min(x - 2090.0, 1490.0 - y))
    (corners,) = CROSSING.junctions
    inside = shapely.contains_xy(shapely.Polygon(corners), *np.moveaxis(GRID.centres, -1, 0))
    np.testing.assert_array_equal(in_junctions(CROSSING, GRID), inside)
    assert not in_junctions(UrbanMap(), Grid.over(UrbanMap())).any()
    strip = UrbanMap(roads=(Road(((0.0, 0.0), (9.0, 0.0)), 4.0),))
    assert metres_to_road(strip, Grid((0.0, 0.0), 1.0, (3, 4))).tolist() == [[0.0, 0.0, 0.5, 1.5]] * 3
    assert np.isinf(metres_to_road(UrbanMap(), Grid.over(UrbanMap()))).all()


def test_mistakes_in_a_grid() -> None:
    with pytest.raises(InputError, match=r"cell is 0\.0 m"):
        Grid.over(CROSSING, cell=0.0)


@pytest.mark.slow
def test_a_sight_table_has_the_visibility_of_the_centres_of_its_cells() -> None:
    """Half a metre wide where that is possible; roads are prolonged by the reach, and what lies beyond is clamped."""
    urban_map = UrbanMap.load("promenade")
    antennas = tuple(Antenna(urban_map, place) for place in ((0.0, 0.0), (-80.0, 0.0)))
    table, rng = sight_table(antennas, 100.0, 20.0), np.random.default_rng(0)
    assert table.per_metre == 2.0
    assert table.west == -150.0 - 100.0 - 30.0
    assert table.clear.shape[0] == 2 * 560
    place = rng.integers(table.clear.shape, size=(4000, 2))
    centres = np.array([table.west, table.south]) + (place + 0.5) / 2.0
    exact = np.logical_and.reduce([antenna.directly_visible(centres) for antenna in antennas])
    assert 0.2 < exact.mean() < 0.9
    np.testing.assert_array_equal(table.clear[place[:, 0], place[:, 1]], exact)
    points = centres + rng.uniform(-0.24, 0.24, centres.shape)
    np.testing.assert_array_equal([is_clear(x, y, table) for x, y in points], exact)
    assert is_clear(-1e9, 1e9, table) == table.clear[0, -1]
    assert is_clear(np.nan, np.inf, table) in (True, False)
    assert sight_table(antennas, 100.0, 20.0) is table
    assert sight_table(antennas, 1e7, 20.0).clear.size < 2e6


@pytest.mark.parametrize(("reach", "margin"), [(-1.0, 0.0), (np.inf, 0.0), (1.0, np.nan)])
def test_a_sight_table_of_no_size_is_refused(reach: float, margin: float) -> None:
    antennas = (Antenna(UrbanMap.load("promenade"), (0.0, 0.0)),)
    with pytest.raises(InputError, match=r"reach|margin"):
        sight_table(antennas, reach, margin)
