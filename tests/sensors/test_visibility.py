"""Tables on a grid hold the values at the centres of its cells."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from wavegym.core.errors import InputError
from wavegym.sensors.multipath import Antenna
from wavegym.sensors.sight_kernels import is_clear
from wavegym.sensors.urban_map import Road, UrbanMap
from wavegym.sensors.visibility import Grid, in_junctions, metres_to_road, sight_table, visibility_map

CROSSING = UrbanMap.load("intersection")
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


def test_mistakes() -> None:
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
