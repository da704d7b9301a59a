"""The scene of the RF/EO platforms: what is drawn is what the state says, for every form of action and any numbers."""

import math

import matplotlib.colors as colours
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from scene_plays import drawn, moment_of, of, played

from wavegym.envs.film import make_scene
from wavegym.rendering.maps import colour
from wavegym.systems.rf_eo.scene import DECADE, MOST, draw_platform_map, place_of, received_caption
from wavegym.systems.rf_eo.system import RfEo, RfEoFar

C = 299792458.0
FORMS = ("box", "library", "joint")
PLATFORMS = ((-1e3, -1e3), (1e3, -1e3), (0.0, 3e3), (3e3, 1e3))
LOOKS = (0.4, -0.5, 3.1, -1.5)
STARTS = ((-1e3, 0.0, 1e3, 0.0), (1e3, 5.0, 1e3, -30.0), (0.0, 3.0, 2e3, -2.0), (-2e3, 5.0, 500.0, -1.0))
SYSTEM = RfEo(looks=LOOKS[:2], starts=STARTS[:2], horizon=8)
FAR = RfEoFar(action="library", looks=LOOKS[:2], horizon=8)


def mapped(system, settings, seed=0):
    """Map after one step with settings (platform, 3), and the moment."""
    axes = Figure().subplots()
    moment = moment_of(played(system, 1, seed, system.action_set.encode(np.array([settings]))))
    draw_platform_map(axes, system, moment)
    return axes, moment


def measured(system, truth):
    """(r, rdot, azimuth) of each target at each platform in plain trigonometry, (platform, target, 3)."""
    rows = []
    for (sx, sy), look in zip(system.platforms, system.looks or (0.0,) * len(system.platforms), strict=True):
        for x, vx, y, vy in truth:
            r = math.hypot(x - sx, y - sy)
            rdot = (vx * (x - sx) + vy * (y - sy)) / r
            rows.append((r, rdot, math.remainder(math.atan2(x - sx, y - sy) - look, 2.0 * math.pi)))
    return np.array(rows).reshape(len(system.platforms), len(truth), 3)


def edges(system, settings):
    """c / (2 PRF), lambda PRF / 4 and Npix alpha / 2 of settings (platform, 3)."""
    prf, _, alpha = settings.T
    return np.stack([C / (2.0 * prf), C / system.carrier_hz * prf / 4.0, system.pixels * alpha / 2.0], axis=1)


def markers(axes, filled):
    """Positions of the view panel's circles by target: lists of [x, row]."""
    found = {}
    for line in axes.lines:
        if line.get_marker() == "o" and (line.get_markerfacecolor() != "white") == filled:
            found.setdefault(colours.to_hex(line.get_color()), []).extend(line.get_xydata().tolist())
    return found


def test_the_map_is_to_scale_and_holds_trails_ellipses_and_platforms():
    scene, moment = drawn(SYSTEM, 3)
    axes, now = scene._map, moment.states[-1]
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert axes.bbox.width / (right - left) == pytest.approx(axes.bbox.height / (top - bottom))
    for t in (0, 1):
        trail, means, outline, cross = of(colour(t), axes.lines)
        expected = [state.truth.targets[0, t, [0, 2]] for state in moment.states]
        np.testing.assert_allclose(1e3 * trail.get_xydata(), expected)
        np.testing.assert_allclose(1e3 * cross.get_xydata(), expected[-1:])
        np.testing.assert_allclose(1e3 * means.get_xydata(), [s.belief.mean[0, t, [0, 2]] for s in moment.states])
        points = 1e3 * outline.get_xydata() - now.belief.mean[0, t, [0, 2]]
        inverse = np.linalg.inv(now.belief.covariance[0, t][np.ix_([0, 2], [0, 2])])
        np.testing.assert_allclose(np.einsum("pi,ij,pj->p", points, inverse, points), 4.0, rtol=1e-6)
        for x, y in np.concatenate([trail.get_xydata(), outline.get_xydata()]):
            assert left < x < right
            assert bottom < y < top
    for j, place in enumerate(SYSTEM.platforms):
        *_, marker = of(f"C{j}", axes.lines)
        np.testing.assert_allclose(1e3 * marker.get_xydata(), [place])
        np.testing.assert_allclose(marker.get_marker()[0], [math.sin(LOOKS[j]), math.cos(LOOKS[j])], rtol=1e-12)
        assert f"P{j + 1}" in {text.get_text() for text in axes.texts}


@pytest.mark.parametrize("alphas", [(1e-5, 2e-3), (1e-3, 2e-3 * math.pi), (3e-3, 6e-3)])
def test_a_sector_holds_the_directions_that_are_on_the_image(alphas):
    axes, _ = mapped(SYSTEM, [(2e4, 1e7, alpha) for alpha in alphas])
    sectors = [patch for patch in axes.patches if isinstance(patch, Polygon)]
    assert len(sectors) == 2
    rng = np.random.default_rng(0)
    points = np.stack([rng.uniform(*axes.get_xlim(), 4000), rng.uniform(*axes.get_ylim(), 4000)], axis=1)
    for j, (sector, alpha) in enumerate(zip(sectors, alphas, strict=True)):
        assert colours.same_color(sector.get_facecolor()[:3], f"C{j}")
        dx, dy = (points - 1e-3 * np.array(SYSTEM.platforms[j])).T
        angle = np.arctan2(dx, dy) - LOOKS[j]
        off = np.abs(np.arctan2(np.sin(angle), np.cos(angle)))
        clear = np.abs(off - 500.0 * alpha) > 1e-6  # of rounding; the sector's far side is off the map
        held = sector.get_path().contains_points(points)
        assert (held == (off < 500.0 * alpha))[clear].all()
        ends = sector.get_xy()[[1, -2]] - 1e-3 * np.array(SYSTEM.platforms[j])
        expected = LOOKS[j] + np.array([-500.0, 500.0]) * alpha
        turn = np.arctan2(*ends.T) - expected
        np.testing.assert_allclose(np.sin(0.5 * turn), 0.0, atol=1e-9)


def test_a_circle_is_the_unambiguous_range():
    prfs = (1e5, 6e4)
    axes, _ = mapped(SYSTEM, [(prf, 1e7, 1e-3) for prf in prfs])
    for j, prf in enumerate(prfs):
        circle = next(line for line in of(f"C{j}", axes.lines) if len(line.get_xdata()) > 1)
        radius = np.linalg.norm(1e3 * circle.get_xydata() - SYSTEM.platforms[j], axis=1)
        np.testing.assert_allclose(radius, C / (2.0 * prf), rtol=1e-12)


def test_before_the_first_step_nothing_is_in_view():
    scene, moment = drawn(SYSTEM, 0)
    assert not scene._map.patches
    assert not any(axes.get_visible() for axes in scene._views)
    assert received_caption(SYSTEM, moment) == ""


@pytest.mark.parametrize("system", [SYSTEM, FAR])
@pytest.mark.parametrize("seed", range(6))
def test_filled_circles_are_what_was_received_and_stand_where_the_target_was(system, seed):
    scene, moment = drawn(system, 2, seed)
    truth, received = (moment.states[-1].truth.targets[0], moment.states[-1].truth.received[0])
    settings = system.action_set.settings(moment.actions[-1])[0]
    high = edges(system, settings)
    quantities, unseen = measured(system, truth), np.zeros((2, 2, 3), bool)
    if system.folding:
        widths = high[:, None, :2] * [1.0, 2.0]
        off = np.abs((quantities[..., :2] + widths / 2) % widths - widths / 2)
        unseen[..., :2] = (off < np.stack([0.1 * widths[..., 0], np.full((2, 1), 10.0)], -1)).any(-1, keepdims=True)
        quantities[..., 0] %= widths[..., 0]
        quantities[..., 1] = (quantities[..., 1] + widths[..., 1] / 2) % widths[..., 1] - widths[..., 1] / 2
    share = quantities / high[:, None]
    filled = np.zeros(2, int)
    for j, axes in enumerate(scene._views):
        for t in (0, 1):
            shade = colours.to_hex(colour(t))
            spots = {True: markers(axes, True).get(shade, []), False: markers(axes, False).get(shade, [])}
            assert len(spots[True]) + len(spots[False]) == 3
            filled[t] += len(spots[True])
            for inside, places in spots.items():
                for x, row in places:
                    expected = share[j, t, round(row)]
                    assert inside == (abs(expected) <= 1.0 and not unseen[j, t, round(row)])
                    shown = abs(x) if abs(x) <= 1.0 else 10.0 ** ((abs(x) - 1.0) / DECADE)
                    assert math.copysign(shown, x) == pytest.approx(expected, rel=1e-9)
                    assert row - round(row) == pytest.approx(0.4 * (t - 0.5))
    assert filled.tolist() == received.tolist()


def test_the_scale_is_proportional_inside_and_logarithmic_beyond():
    inside = np.linspace(-1.0, 1.0, 21)
    np.testing.assert_allclose(place_of(inside), inside, atol=1e-15)
    ratios = np.geomspace(1.0, MOST, 7)
    np.testing.assert_allclose(np.diff(place_of(ratios)), 0.5 * DECADE)
    np.testing.assert_array_equal(place_of(-ratios), -place_of(ratios))
    assert place_of(1e9) == place_of(MOST)


def test_a_view_panel_names_settings_and_edges_and_shades_the_field_of_view():
    settings = np.array([[[6e4, 1e7, 1e-3], [4e4, 5e6, 2e-3]]])
    env = played(SYSTEM, 1)
    env.step(SYSTEM.action_set.encode(settings))
    scene = make_scene(SYSTEM, Figure(figsize=(5.76, 6.4)).subfigures(1, 1))
    scene.draw(moment_of(env))
    titles = [axes.get_title() for axes in scene._views]
    assert titles == ["P1: PRF 60 kHz, B 10 MHz, α 1 mrad", "P2: PRF 40 kHz, B 5 MHz, α 2 mrad"]
    names = [label.get_text() for label in scene._views[1].get_yticklabels()]
    assert names == ["range\n≤ 3.747 km", "rate\n± 299.8 m/s", "azimuth\n± 1 rad"]
    spans = [(patch.get_xy()[:, 0].min(), patch.get_xy()[:, 0].max()) for patch in scene._views[1].patches]
    np.testing.assert_allclose(spans, [(0, 1), (-1, 1), (-1, 1)])


def test_the_printed_range_rate_is_in_view_when_positive():
    system = RfEo(as_printed=True, starts=STARTS[:2], horizon=8)
    for seed in range(4):
        scene, moment = drawn(system, 1, seed)
        spans = [patch.get_xy()[:, 0].min() for patch in scene._views[0].patches]
        np.testing.assert_allclose(spans, [0, 0, -1])
        rate = scene._views[0].get_yticklabels()[1].get_text()
        assert rate.startswith("rate\n≤ ")
        filled = sum(len(spots) for axes in scene._views for spots in markers(axes, True).values())
        assert filled == moment.states[-1].truth.received[0].sum()


def test_nothing_is_in_view_of_a_platform_on_top_of_the_target():
    system = RfEo(platforms=((0.0, 0.0),), starts=((0.2, 0.0, 0.3, 0.0),), first_estimate="halfway", q=0.0)
    scene, moment = drawn(system, 1)
    assert moment.states[-1].truth.received[0].tolist() == [0]
    assert not markers(scene._views[0], True).get(colours.to_hex(colour(0)))
    assert received_caption(system, moment) == "quantities measured:  target 1: nothing for 1 step"


def test_what_is_out_of_view_is_hollow_although_drawn_inflated():
    system = RfEo(out_of_view="inflated", horizon=8)
    settings = np.array([[[6e4, 1e7, 1e-5]] * 2])
    scene, moment = drawn(system, 1, actions=system.action_set.encode(settings))
    assert moment.states[-1].truth.received[0].tolist() == [6, 6]
    hollow = markers(scene._views[0], False)[colours.to_hex(colour(1))]
    assert 2 in [round(row) for _, row in hollow]  # 45 degrees off


def test_the_caption_counts_by_target():
    moment = moment_of(played(SYSTEM, 2))
    one, two = moment.states[-1].truth.received[0]
    assert received_caption(SYSTEM, moment) == f"quantities measured:  target 1: {one} of 6  ·  target 2: {two} of 6"


def test_errors_are_those_of_the_metrics_and_sigma_is_the_beliefs():
    scene, moment = drawn(SYSTEM, 5)
    errors = np.array([SYSTEM.state_info(state)["position_error"][0] for state in moment.states])
    P = np.array([state.belief.covariance[0] for state in moment.states])
    for t in (0, 1):
        error, sigma, _ = of(colour(t), scene._errors.lines)
        np.testing.assert_allclose(error.get_ydata(), errors[:, t])
        np.testing.assert_allclose(sigma.get_ydata(), np.sqrt(P[:, t, 0, 0] + P[:, t, 2, 2]))
    assert scene._errors.get_yscale() == "log"


def test_an_estimate_without_error_fits_on_the_logarithmic_axis():
    scene, _ = drawn(RfEo(starts=((0.0, 0.0, 0.0, 0.0),)), 0)
    assert scene._errors.get_yscale() == "log"
    assert np.isfinite(scene._errors.get_ylim()).all()


@pytest.mark.parametrize("form", FORMS)
def test_the_settings_over_time_are_those_of_the_actions(form):
    system = RfEo(platforms=PLATFORMS[:3], action=form, points=(3, 1, 3), horizon=8)
    scene, moment = drawn(system, 4)
    settings = np.array([system.action_set.settings(action)[0] for action in moment.actions])  # (step, platform, 3)
    for axes, q, scale in zip(scene._settings, (0, 2), (1e-3, 1e3), strict=True):
        for j in range(3):
            line, last = of(f"C{j}", axes.lines)
            np.testing.assert_array_equal(line.get_xdata(), [1, 2, 3, 4])
            np.testing.assert_allclose(line.get_ydata(), scale * settings[:, j, q])
            np.testing.assert_allclose(last.get_ydata(), scale * settings[-1:, j, q])


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("platforms", "targets"), [(1, 1), (1, 4), (2, 3), (3, 1), (3, 4)])
def test_any_numbers_are_drawn(form, platforms, targets):
    scene, _ = drawn(
        RfEo(platforms=PLATFORMS[:platforms], starts=STARTS[:targets], points=(2, 1, 2), action=form, horizon=4), 2
    )
    assert len(scene._views) == min(platforms, 2)
    assert len(scene._map.patches) == platforms
    for axes in scene._views:
        spots = [markers(axes, filled).get(colours.to_hex(colour(t)), []) for t in range(targets) for filled in (0, 1)]
        assert sum(map(len, spots)) == 3 * targets
    scene._map.figure.canvas.draw()
