"""The sector set-up on an urban map: starts on roads, and visibility against shapely."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
import shapely

from wavegym.core.errors import InputError
from wavegym.core.parameters import make_checked
from wavegym.sensors import Antenna
from wavegym.systems.sector_setup.city import SectorSetupCity

SYSTEM = SectorSetupCity()


def test_targets_start_on_roads_and_drive_along_their_right_hand_side():
    truth = SYSTEM.initial(oracles.worlds(SYSTEM, 400)).truth.targets.reshape(-1, 4)
    x, u, y, v = truth.T
    assert (v == 0.0).all()  # both roads lead from west to east
    assert SYSTEM.map.on_road(truth[:, ::2]).all()
    speed = np.abs(u)
    assert (speed >= 3.0).all()
    assert (speed <= 10.0).all()
    middle = np.where(y < 122.5, 110.0, 135.0)
    assert ((y < middle) == (u > 0)).all()
    for part in (y < 122.5, u > 0, x > 0):  # uniform along roads and over directions, within five standard errors
        assert abs(part.mean() - 0.5) < 5 * 0.5 / np.sqrt(len(truth))


def test_buildings_hide_targets():
    """Straight lines from the filed positions of some targets to the three antennas, by shapely."""
    belief, truth = (lambda s: (s.belief, s.truth.targets))(SYSTEM.initial(oracles.worlds(SYSTEM, 4)))
    built = shapely.union_all([shapely.Polygon(each.corners) for each in SYSTEM.map.buildings])
    for e in range(4):
        for k in range(0, SYSTEM.horizon, 3):
            for t in range(SYSTEM.targets):
                place = truth[e, t, ::2] + SYSTEM.dt * (k + 1) * truth[e, t, 1::2]
                lines = [shapely.LineString([place, site]) for site in (SYSTEM.illuminator, *SYSTEM.receivers)]
                assert belief.visible[e, k, t] == (not any(line.crosses(built) for line in lines))
    assert 0.3 < belief.visible.mean() < 0.7


def test_direct_visibility_is_that_of_the_first_image():
    antenna, rng = Antenna(SYSTEM.map, (0.0, 0.0)), np.random.default_rng(0)
    points = rng.uniform((-200.0, 0.0), (200.0, 160.0), (50, 3, 2))
    np.testing.assert_array_equal(antenna.directly_visible(points), antenna.visible(points)[..., 0])
    assert antenna.directly_visible((0.0, 50.0)).shape == ()


def test_given_windows_replace_those_of_the_map():
    visible = SectorSetupCity(windows=((1, 5, 9),)).initial(oracles.worlds(SYSTEM, 2)).belief.visible
    assert visible.sum() == visible.size - 2 * 5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"city": "promenad"}, "city is 'promenad', expected one of"),
        ({"illuminator": (15.0, 80.5)}, "inside a building"),
        ({"receivers": ((0.0, 0.0), (15.0, 80.5))}, "inside a building"),
    ],
)
def test_mistakes(change, message):
    with pytest.raises(InputError, match=message) as error:
        make_checked(SectorSetupCity, change)
    assert "\n" not in str(error.value)


def test_a_map_without_roads_is_refused(tmp_path):
    file = tmp_path / "bare.toml"
    file.write_text("[[buildings]]\ncorners = [[0, 50], [10, 50], [10, 60]]\n")
    with pytest.raises(InputError, match="expected a map with roads"):
        make_checked(SectorSetupCity, {"city": str(file)})


def test_no_road_leads_through_a_building(tmp_path):
    file = tmp_path / "tunnel.toml"
    file.write_text(
        "[[buildings]]\ncorners = [[-20, 100], [20, 100], [20, 120], [-20, 120]]\n"
        "[[roads]]\ncentre = [[-150, 110], [150, 110]]\nwidth = 14\n"
    )
    with pytest.raises(InputError, match="leads into a building, expected roads outside all buildings"):
        make_checked(SectorSetupCity, {"city": str(file)})
