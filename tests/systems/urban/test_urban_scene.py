"""The urban scene: it draws what the state holds, for any number of antennas, targets and slots."""

import matplotlib.colors as colours
import numpy as np
import pytest
from matplotlib.patches import PathPatch, Polygon, Rectangle
from scene_plays import drawn, marked, of

from wavegym.rendering.maps import colour
from wavegym.systems.urban.scene import FAINT, SHADES, SURE, UNSURE, folded, scan_caption
from wavegym.systems.urban.system import Urban
from wavegym.systems.urban.tracker import CONFIRMED, EMPTY, TENTATIVE, Tracks

LONG_UP = np.array([0])
SYSTEM = Urban()
BOTH_HELD = 90  # step of seed 0 at which both targets are in the crossing


@pytest.fixture(scope="module")
def crossing():
    return drawn(SYSTEM, BOTH_HELD, actions=LONG_UP)


def tracks_of(state):
    return Tracks(*state.belief[1:])


def plain(states, transmitter, receiver):
    """Half the path length by each target and its rate, (target, 2), in plain geometry."""
    r = rate = 0.0
    for place in (transmitter, receiver):
        off = states[:, :2] - place
        distance = np.linalg.norm(off, axis=1)
        r, rate = r + distance / 2, rate + (off * states[:, 2:4]).sum(axis=1) / distance / 2
    return np.stack([r, rate], axis=1)


def test_the_map_is_to_scale_and_shows_buildings_and_antennas(crossing):
    axes = crossing[0]._map
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert axes.bbox.width / (right - left) == pytest.approx(axes.bbox.height / (top - bottom))
    (paved,) = [patch for patch in axes.patches if isinstance(patch, PathPatch)]
    buildings = [patch for patch in axes.patches if isinstance(patch, Polygon)]
    for patch, building in zip(buildings, SYSTEM.map.buildings, strict=True):
        assert {tuple(p) for p in patch.get_xy()} == set(building.corners)
    assert paved.contains_point(axes.transData.transform((2070.0, 1400.0)))
    assert not paved.contains_point(axes.transData.transform((2000.0, 1600.0)))
    (transmitter,), receivers = marked("^", axes.lines), marked("v", axes.lines)
    assert transmitter.get_xydata().tolist() == [list(SYSTEM.transmitters[0])]
    assert [line.get_xydata().tolist() for line in receivers] == [[list(place)] for place in SYSTEM.receivers]


def test_the_map_shows_targets_with_their_trails_and_visible_paths(crossing):
    axes, moment = crossing[0]._map, crossing[1]
    for t, since in ((0, 0), (1, 40)):  # the second target arrives ten seconds later
        paths, trail, cross = of(colour(t), axes.lines)
        expected = [state.truth.targets[0, t, :2] for state in moment.states[since:]]
        np.testing.assert_allclose(trail.get_xydata(), expected)
        np.testing.assert_allclose(cross.get_xydata(), expected[-1:])
        antennas = (*SYSTEM.transmitters, *SYSTEM.receivers)
        for place, line in zip(antennas, paths.get_xydata().reshape(-1, 3, 2), strict=True):
            np.testing.assert_allclose(line[:2], [place, expected[-1]])


@pytest.mark.parametrize("steps", [30, BOTH_HELD])
def test_the_map_shows_every_track_with_its_ellipse(steps):
    scene, moment = drawn(SYSTEM, steps, actions=LONG_UP)
    now = moment.states[-1]
    x, P = tracks_of(now).combined()
    for status, style in ((TENTATIVE, UNSURE), (CONFIRMED, SURE)):
        outlines = [line for line in of(style["color"], scene._map.lines) if len(line.get_xdata()) == 121]
        for slot, line in zip(np.flatnonzero(now.belief.status[0] == status), outlines, strict=True):
            off = line.get_xydata() - x[0, slot, :2]
            inverse = np.linalg.inv(P[0, slot, :2, :2])
            np.testing.assert_allclose(np.einsum("pi,ij,pj->p", off, inverse, off), 4.0, rtol=1e-6)
    assert (now.belief.status == (CONFIRMED if steps == BOTH_HELD else TENTATIVE)).any()
    trail = marked(".", of("black", scene._map.lines))[0].get_xydata()
    assert len(trail) == sum((state.belief.status == CONFIRMED).sum() for state in moment.states)


def test_before_the_crossing_a_target_has_paths_over_walls_only():
    scene, moment = drawn(SYSTEM, 20, actions=LONG_UP)
    trail, cross = of(colour(0), scene._map.lines)
    assert len(trail.get_xdata()) == 21
    assert len(cross.get_xdata()) == 1
    for axes in scene._scans:
        assert not sum(len(line.get_xdata()) for line in marked("x", axes.lines))
        assert sum(len(line.get_xdata()) for line in marked("+", axes.lines))
    assert scan_caption(SYSTEM, moment).endswith("target 1: not held, hidden")


def test_a_scan_panel_shows_measurements_targets_and_tracks(crossing):
    scene, moment = crossing
    now = moment.states[-1]
    x, _ = tracks_of(now).combined()
    for m, axes in enumerate(scene._scans):
        number = now.truth.number[0, m]
        np.testing.assert_array_equal(marked(".", axes.lines)[0].get_xydata(), now.truth.z[0, m, :number, :2])
        exact = plain(now.truth.targets[0], SYSTEM.transmitters[0], SYSTEM.receivers[m])
        for t, cross in enumerate(marked("x", axes.lines)):
            np.testing.assert_allclose(cross.get_xydata(), exact[t : t + 1])
        sure = x[0, now.belief.status[0] == CONFIRMED]
        circles = of("black", marked("o", axes.lines))[0]
        np.testing.assert_allclose(circles.get_xydata(), plain(sure, SYSTEM.transmitters[0], SYSTEM.receivers[m]))
        assert len(sure) == 2


def test_rates_are_drawn_as_they_are_measured():
    z = np.array([[100.0, -19.0], [120.0, 3.0], [80.0, 40.0]])
    np.testing.assert_allclose(folded(z, 10.0), [[100.0, 1.0], [120.0, 3.0], [80.0, 0.0]])


def test_errors_are_those_of_the_metrics_where_a_target_is_held(crossing):
    scene, moment = crossing
    figures = [SYSTEM.state_info(state) for state in moment.states]
    for t in (0, 1):
        line, last = of(colour(t), scene._errors.lines)
        held = np.array([figure["held"][0, t] for figure in figures])
        error = np.array([figure["position_error"][0, t] for figure in figures])
        np.testing.assert_array_equal(np.isfinite(line.get_ydata()), held)
        np.testing.assert_array_equal(line.get_ydata()[held], error[held])
        assert last.get_ydata() == error[-1:]


@pytest.mark.parametrize("steps", [30, BOTH_HELD])
def test_a_bar_is_as_long_as_its_track_is_sure(steps):
    scene, moment = drawn(SYSTEM, steps, actions=LONG_UP)
    belief = moment.states[-1].belief
    bars = [patch for patch in scene._slots.patches if isinstance(patch, Rectangle)]
    for slot in range(SYSTEM.slots):
        own = [bar for bar in bars if bar.get_y() + 0.5 * bar.get_height() == pytest.approx(slot + 1)]
        assert bool(own) == (belief.status[0, slot] != EMPTY)
        for bar, mu, shade in zip(own, belief.mu[0, slot], SHADES, strict=False):
            assert bar.get_width() == pytest.approx(belief.existence[0, slot] * mu)
            faint = 1.0 if belief.status[0, slot] == CONFIRMED else FAINT
            assert bar.get_facecolor() == pytest.approx(colours.to_rgba(shade, faint))
        if own:
            assert own[-1].get_x() + own[-1].get_width() == pytest.approx(belief.existence[0, slot])


def test_the_caption_counts(crossing):
    moment = crossing[1]
    count = int(moment.states[-1].truth.number.sum())
    assert scan_caption(SYSTEM, moment) == f"{count} measurements  ·  target 1: held  ·  target 2: held"


@pytest.mark.parametrize(
    "changes",
    [
        {"tracker": "ncv"},
        {"receivers": ((2088.0, 1475.0), (2078.0, 1467.0), (2060.0, 1500.0))},
        {"arrivals": (0.0,), "slots": 2},
        {"arrivals": (0.0, 5.0, 10.0), "slots": 20, "durations": (1e-6, 2e-6, 3e-6)},
    ],
)
@pytest.mark.slow
def test_any_numbers_are_drawn(changes):
    scene, moment = drawn(Urban(**changes), 45, actions=LONG_UP)
    present = moment.states[-1].truth.present[0]
    assert len(marked("x", scene._map.lines)) == present.sum()
    scene._map.figure.canvas.draw()
