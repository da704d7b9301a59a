"""Urban maps: accepted data, positions of walls and roads, and errors for mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from wavegym.core.errors import InputError
from wavegym.core.parameters import make_checked
from wavegym.sensors.urban_map import Building, Road, UrbanMap
from wavegym.targets import ScriptedPath, Segment

SQUARE = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
CROSSING = UrbanMap.load("intersection")


@pytest.mark.parametrize("corners", [SQUARE, SQUARE[::-1], (*SQUARE, SQUARE[0])])
def test_the_outside_is_on_the_right_of_every_wall(corners) -> None:
    urban_map = UrbanMap(buildings=(Building(corners),))
    assert {frozenset([tuple(w[:2]), tuple(w[2:])]) for w in urban_map.walls.tolist()} == {
        frozenset([SQUARE[i - 1], SQUARE[i]]) for i in range(4)
    }
    for x0, y0, x1, y1 in urban_map.walls:
        step = 0.01 * np.array([y1 - y0, x0 - x1])
        middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
        assert urban_map.indoors([middle + step, middle - step]).tolist() == [False, True]


def test_the_papers_crossing() -> None:
    """Antennas and both ends of the route are as printed; its corners are where the data of the route put them."""
    for antenna in [(2085.0, 1470.5), (2088.0, 1475.0), (2078.0, 1467.0)]:
        CROSSING.check_outdoors("antenna", antenna)
    turn = Segment(10.0, turn_rate=np.pi / 20)
    path = ScriptedPath((1950.0, 1500.0), (10.0, 0.0), [Segment(5.0), Segment(5.0, -1.0), turn, Segment(5.0, 1.0)])
    positions = path.sample(0.25 * np.arange(141)).positions
    np.testing.assert_allclose(positions[-1], [2069.33, 1669.33], atol=0.01)
    CROSSING.check_drivable("the route", positions)
    assert CROSSING.on_road(positions).all()
    assert not CROSSING.indoors(positions).any()
    (junction,) = CROSSING.junctions
    inside = shapely.contains_xy(shapely.Polygon(junction), positions[:, 0], positions[:, 1])
    assert np.flatnonzero(inside)[[0, -1]].tolist() == pytest.approx([20, 100], abs=1)
    assert len(CROSSING.discretes) == 20
    assert not CROSSING.indoors(CROSSING.discretes).any()
    assert set(CROSSING.reflectivity) == {0.4}


def test_a_map_comes_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("buildings = [{ corners = [[0, 0], [10, 0], [10, 10], [0, 10]], reflectivity = 0.2 }]\n")
    urban_map = UrbanMap.load(file)
    assert urban_map == UrbanMap(buildings=(Building(SQUARE, 0.2),))
    assert hash(urban_map) == hash(UrbanMap.load(str(file)))
    assert urban_map.reflectivity.tolist() == [0.2] * 4


def test_nothing_stands_on_an_empty_map() -> None:
    urban_map = UrbanMap()
    assert urban_map.walls.shape == (0, 4)
    assert not urban_map.indoors([[0.0, 0.0]]).any()
    assert not urban_map.on_road([[0.0, 0.0]]).any()
    urban_map.check_drivable("path", [[0.0, 0.0], [1.0, 1.0]])


BOW = ((0.0, 0.0), (10.0, 10.0), (10.0, 0.0), (0.0, 10.0))


@pytest.mark.parametrize(
    ("make", "values", "message"),
    [
        (Building, {"corners": BOW}, r"expected walls that do not cross and bound an area \(Self-intersection"),
        (Building, {"corners": SQUARE[:2]}, "expected at least three different ones"),
        (Building, {"corners": (SQUARE[0], SQUARE[1], SQUARE[0])}, "expected at least three different ones"),
        (Building, {"corners": ((0.0, 0.0), (1.0, 1.0), (2.0, 2.0))}, "bound an area"),
        (Building, {"corners": (*SQUARE[:3], (0.0, np.inf))}, "corners.3.1 is inf, expected a finite number"),
        (Building, {"corners": SQUARE, "reflectivity": 1.5}, r"reflectivity is 1\.5, expected .* \(nearest: 1\)"),
        (Road, {"centre": (SQUARE[0], SQUARE[0]), "width": 3.0}, "expected at least two different points"),
        (Road, {"centre": (), "width": 3.0}, "expected at least two different points"),
        (Road, {"centre": SQUARE[:2], "width": 0.0}, "a road's width is 0"),
        (UrbanMap, {"junctions": (BOW,)}, "a junction's corners"),
        (UrbanMap, {"buildings": (Building(SQUARE), Building(((5.0, 5.0), (20.0, 5.0), (20.0, 20.0))))}, "overlap by"),
        (Building, {"corners": SQUARE, "reflectivity": np.nan}, "reflectivity is nan"),
        (Road, {"centre": ((0.0, 0.0), (np.inf, 0.0)), "width": 3.0}, "centre.1.0 is inf, expected a finite number"),
        (UrbanMap, {"discretes": ((np.nan, 1.0),)}, "discretes.0.0 is nan, expected a finite number"),
        (UrbanMap, {"roads": ({"centre": SQUARE[:2], "widht": 3.0},)}, "setting 'roads.0.width' is missing"),
        (
            UrbanMap,
            {"building": ()},
            "UrbanMap got an unexpected keyword argument 'building'; did you mean 'buildings'",
        ),
    ],
)
def test_mistakes_in_a_map(make, values, message) -> None:
    with pytest.raises(InputError, match=message) as error:
        make_checked(make, values)
    assert "\n" not in str(error.value)
    if "unexpected keyword" not in message:
        with pytest.raises(InputError, match=message):
            make(**values)


def test_mistakes_in_a_file(tmp_path: Path) -> None:
    wanted = "city is 'intersektion', expected one of 'intersection', 'promenade'; did you mean"
    with pytest.raises(InputError, match=wanted):
        UrbanMap.load("intersektion")
    with pytest.raises(InputError, match="cannot be read"):
        UrbanMap.load(tmp_path / "none.toml")
    torn = tmp_path / "torn.toml"
    torn.write_text("buildings = [")
    with pytest.raises(InputError, match=r"torn\.toml cannot be read"):
        UrbanMap.load(torn)
    torn.write_text("[[buildings]]\ncorner = [[0, 0]]")
    with pytest.raises(InputError, match="corner"):
        UrbanMap.load(torn)


@pytest.mark.parametrize("content", ["", "discretes = [[1.0, 2.0]]"])
def test_an_empty_city_is_refused(tmp_path, content):
    (tmp_path / "empty.toml").write_text(content)
    with pytest.raises(InputError, match=r"empty\.toml has no buildings and no roads, expected a city"):
        UrbanMap.load(tmp_path / "empty.toml")


def test_where_nobody_can_stand_or_drive() -> None:
    with pytest.raises(InputError, match=r"tx is \(2100\.0, 1600\.0\) m, inside a building.*\(2095, 1600\)"):
        CROSSING.check_outdoors("tx", (2100.0, 1600.0))
    with pytest.raises(InputError, match=r"path leads into a building at \(2045, 1600\) m"):
        CROSSING.check_drivable("path", [[2060.0, 1600.0], [2000.0, 1600.0]])
    with pytest.raises(InputError, match="points has shape"):
        CROSSING.indoors([1.0])
