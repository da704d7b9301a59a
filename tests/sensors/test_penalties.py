"""Penalties of the field of view: values inside, at the edges, outside and far outside."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import expit, huber

from wavegym.core.errors import InputError
from wavegym.sensors import fov_penalty, platform_view

KINDS = ("logistic", "hard", "deadzone", "huber", "log-barrier")
SHARPNESS = {"logistic": 100.0, "hard": 100.0, "deadzone": 100.0, "huber": 100.0, "log-barrier": 1e8}
HEIGHT = np.array([1e8, 1e6, 10.0])  # of range, range-rate and azimuth
SETTINGS = np.array([(f, B, a) for f in (1e3, 1e4, 1e5) for B in (1e6, 20e6) for a in (1e-5, 1.2e-4, 1e-3, 6e-3)])
VIEW = platform_view(*SETTINGS.T, 0.03, 128, 1000)  # variance, low and high, (setting, quantity)
HIGH = 450.0


def of(kind, x, low=-HIGH, sharpness=None, height=1e6):
    return fov_penalty(kind, x, low, HIGH, sharpness or SHARPNESS[kind], height)


def share(kind, x):
    """The penalty at x of the edge over the plain variance, (setting, quantity)."""
    return fov_penalty(kind, x * VIEW.high, VIEW.low, VIEW.high, SHARPNESS[kind], HEIGHT) / VIEW.variance


@pytest.mark.parametrize("kind", ["hard", "deadzone", "huber"])
@pytest.mark.parametrize("x", [-1.0, -0.85, 0.0, 0.5, 0.999999, 1.0])
def test_hard_deadzone_and_huber_are_exactly_zero_inside(kind, x):
    """Also at the edge; a range has no lower edge."""
    assert not share(kind, x).any()


def test_the_logistic_is_below_a_thousandth_in_the_documented_interval():
    """|x| <= high (1 - ln(gamma / (1e-3 v)) / (2 sharpness)): 0.85 of the edge and more, of azimuth from 1.1e-4 rad."""
    reach = 1 - np.log(HEIGHT / (1e-3 * VIEW.variance)) / 200
    assert reach[:, :2].min() > 0.85
    fine = SETTINGS[:, 2] < 1.1e-4
    assert reach[~fine, 2].min() > 0.85
    assert reach[fine, 2].max() < 0.85
    for side in (1, -1):
        two_sided = slice(None) if side > 0 else slice(1, 3)
        x = side * reach
        np.testing.assert_array_less(share("logistic", x * (1 - 1e-9))[:, two_sided], 1e-3)
        np.testing.assert_array_less(1e-3, share("logistic", x * (1 + 1e-4))[:, two_sided])
    coarse = np.column_stack([np.ones((len(fine), 2), bool), ~fine])
    assert share("logistic", 0.85)[coarse].max() < 1e-3
    assert share("logistic", 0.85)[~coarse] == pytest.approx(0.112, rel=0.01)


def test_the_log_barrier_is_zero_at_the_centre_and_capped():
    assert not share("log-barrier", 0.0).any()
    assert (of("log-barrier", 0.3 * HIGH) > 0).all()
    sharpness, height = 10.0, 7.0
    x = np.linspace(-0.999, 0.999, 101)
    want = np.minimum(height, -height / sharpness * np.log1p(-x * x))
    np.testing.assert_allclose(of("log-barrier", x * HIGH, sharpness=sharpness, height=height), want, atol=1e-12)
    for x in (1 - 1e-9, 1.0, 1 + 1e-9, 2.0, -1.0, -5.0):
        got = of("log-barrier", x * HIGH, sharpness=1.0, height=height)
        assert got == height  # 1 - exp(-1) of the square is where it begins


@pytest.mark.parametrize("x", [-3.0, -1.2, -1.004, -0.9, 0.0, 0.5, 0.97, 1.0, 1.0001, 1.03, 4.0])
def test_plain_forms(x):
    """Each kind by its definition at x times the edge: the sum of both sides, of which one is always zero."""
    beyond = HIGH * (abs(x) - 1)
    assert of("hard", x * HIGH) == (1e6 if beyond > 0 else 0.0)
    assert of("deadzone", x * HIGH) == pytest.approx(1e6 * 100 / HIGH * max(beyond, 0.0))
    assert of("huber", x * HIGH) == pytest.approx(1e6 * huber(1.0, 100 / HIGH * max(beyond, 0.0)))
    both = sum(expit(200 / HIGH * d) for d in (beyond, -HIGH * (abs(x) + 1)))
    assert of("logistic", x * HIGH) == pytest.approx(1e6 * both, rel=1e-12, abs=1e-30)


@pytest.mark.parametrize("sharpness", [3.0, 20.0])
def test_the_logistic_is_the_tanh_form_where_that_does_not_cancel(sharpness):
    """gamma (1 + (tanh nu (x - high) - tanh nu (x - low)) / 2): eq. (13) with both sides."""
    x, nu = np.linspace(-1.5, 1.5, 61) * HIGH, sharpness / HIGH
    want = 1e6 * (1 + (np.tanh(nu * (x - HIGH)) - np.tanh(nu * (x + HIGH))) / 2)
    np.testing.assert_allclose(of("logistic", x, sharpness=sharpness), want, rtol=1e-12, atol=1e-9)


def test_the_tanh_form_cancels_where_the_logistic_does_not():
    x, nu = 0.8 * HIGH, 100 / HIGH
    assert 1 + np.tanh(nu * (x - HIGH)) == pytest.approx(2 * np.exp(-40), abs=1e-16)
    assert of("logistic", x) == pytest.approx(1e6 * np.exp(-40), rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
@given(one=st.floats(0, 3), other=st.floats(0, 3), sharpness=st.floats(1.0, 1e9))
def test_grows_with_the_distance_from_the_centre(kind, one, other, sharpness):
    near, far = sorted((one, other))
    for side in (1.0, -1.0):
        low, high = (of(kind, side * x * HIGH, sharpness=sharpness) for x in (near, far))
        assert 0 <= low <= high * (1 + 1e-12) + 1e-300


@pytest.mark.parametrize("kind", KINDS)
@given(x=st.floats(-3, 3))
def test_two_sided_where_the_interval_is(kind, x):
    """The penalty is symmetric; without a lower edge it is least everywhere below."""
    assert of(kind, x * HIGH) == pytest.approx(of(kind, -x * HIGH), rel=1e-12)
    if x < 0 and kind != "log-barrier":  # whose measure is the distance from 0
        assert of(kind, x * HIGH, low=-np.inf) <= of(kind, 0.0, low=-np.inf) * (1 + 1e-12)
    if x > 0:
        assert of(kind, x * HIGH, low=-np.inf) == pytest.approx(of(kind, x * HIGH), rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_one_sided_interval_from_zero(kind):
    """The printed interval of a range-rate: approaching targets are outside."""
    assert of(kind, -0.5 * HIGH, low=0.0) >= 1e6 * (1 - 1e-12)
    assert of(kind, 0.5 * HIGH, low=0.0) < 1e-2 * 1e6


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("x", [1e3, 1e9, 1e150, 1e300])
def test_far_outside_nothing_overflows(kind, x):
    with warnings.catch_warnings(), np.errstate(all="raise"):
        warnings.simplefilter("error")
        for side in (1.0, -1.0):
            got = of(kind, side * x * HIGH)
            linear = kind in ("deadzone", "huber")
            assert np.isfinite(got) or (linear and x > 1e290)
            assert got == pytest.approx(1e6) if not linear else got > 1e6


def test_at_the_edge_and_just_beyond():
    assert of("logistic", HIGH) == pytest.approx(0.5e6)
    assert of("hard", np.nextafter(HIGH, 500)) == 1e6
    assert of("deadzone", HIGH * 1.01) == pytest.approx(1e6)
    assert of("deadzone", HIGH * 1.02) == pytest.approx(2e6)
    assert of("huber", HIGH * 1.01) == pytest.approx(0.5e6)
    assert of("huber", HIGH * 1.02) == pytest.approx(1.5e6)


@pytest.mark.parametrize("kind", KINDS)
def test_no_height_is_no_penalty_and_arrays_broadcast(kind):
    assert not of(kind, np.linspace(-2, 2, 9) * HIGH, height=0.0).any()
    x, high = np.array([[0.5], [1.5]]) * HIGH, np.array([HIGH, 2 * HIGH, 0.1 * HIGH])
    got = fov_penalty(kind, x, -high, high, 50.0, 3.0)
    assert got.shape == (2, 3)
    for index in np.ndindex(2, 3):
        edge = high[index[1]]
        assert got[index] == fov_penalty(kind, x[index[0], 0], -edge, edge, 50.0, 3.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("logistc", 1.0, -1.0, 1.0, 1.0, 1.0), "penalty is 'logistc'.*did you mean 'logistic'"),
        ((None, 1.0, -1.0, 1.0, 1.0, 1.0), "penalty is None"),
        (("hard", 1.0, -1.0, 0.0, 1.0, 1.0), "high edge of the field of view is 0.0"),
        (("hard", 1.0, -1.0, np.nan, 1.0, 1.0), "high edge of the field of view is nan"),
        (("hard", 1.0, -1.0, [1.0, -1.0], 1.0, 1.0), "high edge of the field of view is -1.0"),
        (("hard", 1.0, 1.0, 1.0, 1.0, 1.0), "expected low < high"),
        (("hard", 1.0, 2.0, 1.0, 1.0, 1.0), "expected low < high"),
        (("hard", 1.0, np.nan, 1.0, 1.0, 1.0), "expected low < high"),
        (("hard", 1.0, -1.0, 1.0, 0.0, 1.0), "sharpness is 0.0"),
        (("hard", 1.0, -1.0, 1.0, np.nan, 1.0), "sharpness is nan"),
        (("hard", 1.0, -1.0, 1.0, 1.0, -1.0), "height is -1.0"),
        (("hard", 1.0, -1.0, 1.0, 1.0, np.inf), "height is inf"),
        (("hard", [1.0, 2.0], [-1.0] * 3, 1.0, 1.0, 1.0), "leading axes that broadcast"),
        (("hard", 1.0, [-1.0] * 3, [1.0] * 2, 1.0, 1.0), r"shapes are low \(3,\), high \(2,\), expected shapes that b"),
        (("hard", [0.0, np.nan], -1.0, 1.0, 1.0, 1.0), "x is nan"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(arguments, words):
    with pytest.raises(InputError, match=words) as caught:
        fov_penalty(*arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", KINDS)
def test_without_an_edge_there_is_no_penalty(kind):
    x = np.array([-1e6, -np.pi, 0.0, np.pi, 1e6])
    assert not fov_penalty(kind, x, -np.inf, np.inf, 100.0, 10.0).any()
