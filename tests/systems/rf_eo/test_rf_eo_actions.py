"""Settings of RF/EO platforms: the library, joint and box forms name the same settings."""

from __future__ import annotations

from itertools import product

import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core import shortcuts
from wavegym.core.action_sets import JointLibrary, ParameterBox, PerSensorLibrary
from wavegym.core.errors import InputError
from wavegym.sensors import platform_view
from wavegym.systems.rf_eo.actions import GRID_POINTS, MOST_ACTIONS, MOST_CANDIDATES, PlatformActions
from wavegym.systems.rf_eo.system import RfEo

RANGES = ((1e3, 1e5), (1e6, 2e7), (1e-5, 6e-3))
FORMS = ("library", "joint", "box")
POINTS = (3, 2, 4)
ALL = list(product(np.geomspace(1e3, 1e5, 3), np.geomspace(1e6, 2e7, 2), np.geomspace(1e-5, 6e-3, 4)))


def make_set(form, points=POINTS, platforms=2, as_printed=False):
    return PlatformActions(RANGES, points, platforms, form, 0.03, 128, 1000, as_printed)


def picked(action_set, choices):
    """The settings (..., platform, 3) of the library's ``choices``."""
    return np.array(action_set.library.entries)[choices]


def test_the_library_has_prf_bandwidth_pixel_angle_in_this_order():
    np.testing.assert_allclose(make_set("library").library.entries, ALL, rtol=1e-14)
    assert len(make_set("library").actions) == 24
    single = make_set("library", points=(2, 1, 1)).library.entries
    assert single == ((1e3, 2e7, 6e-3), (1e5, 2e7, 6e-3))  # of a single point, the greatest


def test_labels_tell_settings_apart():
    labels = make_set("library").actions.labels
    assert len(set(labels)) == 24
    assert labels[0] == "1 kHz 1 MHz 10 urad"


def test_each_form_has_its_action_set():
    assert isinstance(make_set("library").actions, PerSensorLibrary)
    assert isinstance(make_set("joint").actions, JointLibrary)
    assert len(make_set("joint").actions) == 24**2
    box = make_set("box").actions
    assert isinstance(box, ParameterBox)
    assert box.names == ("prf_1", "bandwidth_1", "pixel_angle_1", "prf_2", "bandwidth_2", "pixel_angle_2")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("platforms", [1, 2, 3])
def test_numbers_of_the_library_name_the_same_settings_in_all_forms(form, platforms):
    action_set = make_set(form, platforms=platforms)
    choices = np.random.default_rng(0).integers(24, size=(5, 7, platforms))
    got = action_set.settings(action_set.number(choices))
    assert got.shape == (5, 7, platforms, 3)
    np.testing.assert_allclose(got, picked(action_set, choices), rtol=1e-13 if form == "box" else 0)


@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6))
def test_the_box_is_logarithmic_platform_by_platform(point):
    action_set = make_set("box")
    got = action_set.settings(np.array([point]))[0]
    low, high = np.array(RANGES).T
    want = low * (high / low) ** (0.5 * (np.reshape(point, (2, 3)) + 1))
    np.testing.assert_allclose(got, want, rtol=1e-12)
    assert (got >= low).all()
    assert (got <= high).all()


@given(seed=st.integers(0, 999), platforms=st.integers(1, 3))
def test_encode_and_decode_are_inverse(seed, platforms):
    action_set, rng = make_set("box", platforms=platforms), np.random.default_rng(seed)
    low, high = np.log(np.array(RANGES)).T
    settings = np.exp(rng.uniform(low, high, (4, platforms, 3)))
    actions = action_set.encode(settings)
    assert actions.shape == (4, 3 * platforms)
    np.testing.assert_allclose(action_set.settings(actions), settings, rtol=1e-12)
    np.testing.assert_allclose(action_set.encode(action_set.settings(actions)), actions, atol=1e-12)


def test_values_outside_the_box_are_refused():
    with pytest.raises(InputError, match="value of prf_2 is 500, expected"):
        make_set("box").encode(np.array([[1e4, 1e7, 1e-3], [500.0, 1e7, 1e-3]]))
    with pytest.raises(InputError, match="action of pixel_angle_1 is nan"):
        make_set("box").settings(np.array([[0, 0, np.nan, 0, 0, 0]]))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("points", [POINTS, (4, 1, 1)])
def test_choose_takes_points_of_the_grid_at_the_greatest_bandwidth(form, points):
    action_set, rng = make_set(form, points), np.random.default_rng(1)
    prfs, angles = action_set.grid
    assert action_set.sizes == ((GRID_POINTS, GRID_POINTS) if form == "box" else (points[0], points[2]))
    prf, angle = (rng.integers(size, size=(6, 2)) for size in action_set.sizes)
    got = action_set.settings(action_set.choose(prf, angle))
    want = np.stack([prfs[prf], np.full((6, 2), 2e7), angles[angle]], axis=-1)
    np.testing.assert_allclose(got, want, rtol=1e-12)


def test_the_grid_of_the_box_spans_its_bounds():
    for values, (low, high) in zip(make_set("box").grid, (RANGES[0], RANGES[2]), strict=True):
        assert (values[0], values[-1]) == (low, high)
        ratio = values[1:] / values[:-1]
        np.testing.assert_allclose(ratio, ratio[0], rtol=1e-12)


@pytest.mark.parametrize("as_printed", [False, True])
def test_axes_are_the_view_at_the_grid_points(as_printed):
    """The shorter axis repeats its last point."""
    action_set = make_set("library", as_printed=as_printed)
    prfs, angles = action_set.grid
    want = platform_view(np.append(prfs, prfs[-1]), 2e7, angles, 0.03, 128, 1000, as_printed)
    assert action_set.axes.shape == (4, 4, 3)
    np.testing.assert_array_equal(action_set.axes[:3], np.stack(want))
    assert not action_set.axes[3].any()


@pytest.mark.parametrize("form", FORMS)
def test_candidates_are_all_combinations_or_the_same_everywhere(form):
    """All 24^2; in place of 24^3 only the same setting at every platform, except in the joint form."""
    action_set = make_set(form)
    want = picked(action_set, np.array(list(product(range(24), repeat=2))))
    np.testing.assert_allclose(action_set.settings(action_set.candidates), want, rtol=1e-13)
    assert MOST_CANDIDATES < 24**3
    action_set = make_set(form, platforms=3)
    every = np.array(list(product(range(24), repeat=3)))
    want = picked(action_set, every if form == "joint" else np.repeat(np.arange(24)[:, None], 3, axis=1))
    np.testing.assert_allclose(action_set.settings(action_set.candidates), want, rtol=1e-13)


def test_the_proposed_setting_has_a_name_where_the_box_holds_it():
    system = RfEo()
    got = system.action_set.settings(shortcuts.named_constants(system)["proposed"])
    np.testing.assert_allclose(got, [[60e3, 10e6, 1e-3], [40e3, 5e6, 1e-3]], rtol=1e-12)
    for other in ({"prf": (1e3, 50e3)}, {"bandwidth": (6e6, 20e6)}, {"action": "library"}, {"platforms": ((0, 0),)}):
        assert shortcuts.named_constants(RfEo(**other)) == {}


@pytest.mark.parametrize("as_printed", [False, True])
def test_view_is_the_sensors(as_printed):
    action_set = make_set("box", as_printed=as_printed)
    settings = picked(action_set, np.arange(24).reshape(4, 6))
    want = platform_view(*np.moveaxis(settings, -1, 0), 0.03, 128, 1000, as_printed)
    for got, expected in zip(action_set.view(settings), want, strict=True):
        assert got.shape == (4, 6, 3)
        np.testing.assert_array_equal(got, expected)


@pytest.mark.parametrize(
    ("form", "points", "platforms", "words"),
    [
        ("box", (0, 1, 4), 2, "points of prf is 0, expected an integer >= 1"),
        ("box", (4, -1, 4), 2, "points of bandwidth is -1"),
        ("library", (4, 1, 2.5), 2, "points of pixel_angle is 2.5"),
        (
            "box",
            (10**6, 10**6, 4),
            2,
            f"library has 4000000000000 settings.*at most {MOST_ACTIONS}",
        ),
        ("joint", (9, 9, 9), 2, r"number of joint actions is 729\^2.*nearest action: 'library'"),
        ("joint", POINTS, 64, r"number of joint actions is 24\^64"),
    ],
)
def test_points_are_checked(form, points, platforms, words):
    with pytest.raises(InputError, match=words) as caught:
        make_set(form, points, platforms).levels  # noqa: B018
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("platforms", [((-1e3, -1e3),), ((-1e3, -1e3), (1e3, -1e3))])
def test_all_forms_play_the_same_episode(platforms):
    """Step by step on the same settings: library and joint to the bit, the box by way of a logarithm and back.

    The iterated update of a wide prior amplifies that rounding.
    """
    systems = {form: RfEo(horizon=20, action=form, platforms=platforms) for form in FORMS}
    worlds = oracles.worlds(systems["box"], 3)
    states = {form: system.initial(worlds) for form, system in systems.items()}
    rng = np.random.default_rng(2)
    for _ in range(20):
        choices = rng.integers(16, size=(3, len(platforms)))
        for form, system in systems.items():
            states[form] = system.transition(states[form], system.action_set.number(choices), worlds)
        one, joint, box = (states[form] for form in FORMS)
        for a, b in zip((*one.truth, *one.belief), (*joint.truth, *joint.belief), strict=True):
            np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(one.truth.received, box.truth.received)
        assert oracles.covariance_distance(box.belief.covariance, one.belief.covariance) < 1e-6
        sigma = np.sqrt(np.diagonal(one.belief.covariance, axis1=-2, axis2=-1))
        assert np.abs((box.belief.mean - one.belief.mean) / sigma).max() < 1e-7
    assert one.truth.received.max() > 0
