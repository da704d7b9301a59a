"""Measurements, resolution and view of a platform against plain formulas, plane geometry and finite differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.sensors import (
    platform_jacobian,
    platform_measurement,
    platform_view,
    range_and_rate,
    range_and_rate_jacobian,
)

ORDER = [0, 2, 1, 3]  # (x, xdot, y, ydot) as (x, y, xdot, ydot), and back
SPANS = (2e3, 300.0, 2e3, 300.0)


def plain(state, platform, as_printed=False):
    """r, rdot and azimuth of one target with Python's own functions; ``as_printed``: eq. (5) and the arcsine."""
    x, vx, y, vy = (float(a) for a in state)
    sx, sy, look = (float(a) for a in platform)
    dx, dy = x - sx, y - sy
    r = math.hypot(dx, dy)
    rdot = (vx * dx - vy * dy) / r if as_printed else (vx * dx + vy * dy) / r
    azimuth = math.asin(dx / r) if as_printed else math.atan2(dx, dy)
    return np.array([r, rdot, math.remainder(azimuth - look, 2 * math.pi)])


def differences(state, platform, as_printed):
    """Central differences of ``plain`` over 1e-5 of the range: wrong by 1e-10 and by what h rounds."""
    columns = []
    for i, width in enumerate([1e-5 * plain(state, platform)[0], 1e-3] * 2):
        step = width * np.eye(4)[i]
        change = plain(state + step, platform, as_printed) - plain(state - step, platform, as_printed)
        change[2] = math.remainder(change[2], 2 * math.pi)
        columns.append(change / (2 * width))
    return np.stack(columns, axis=1)


def scene(lead=(), seed=0):
    """Targets with leading axes ``lead``, platforms at distances over four decades from them, any look direction."""
    rng = np.random.default_rng(seed)
    state = rng.standard_normal((*lead, 4)) * SPANS
    place = state[..., ::2] + rng.standard_normal((*lead, 2)) * 10 ** rng.uniform(1, 5, (*lead, 1))
    return state, np.concatenate([place, rng.uniform(-4, 4, (*lead, 1))], axis=-1)


@pytest.mark.parametrize("as_printed", [False, True])
def test_equals_plain_formulas(as_printed):
    for state, platform in zip(*scene((200,)), strict=True):
        got, want = platform_measurement(state, platform, as_printed), plain(state, platform, as_printed)
        np.testing.assert_allclose(got[:2], want[:2], rtol=1e-12, atol=1e-10)
        assert abs(got[2] - want[2]) < 1e-7 if as_printed else abs(got[2] - want[2]) < 1e-14  # arcsine: sqrt(eps)


@pytest.mark.parametrize("as_printed", [False, True])
def test_jacobian_is_the_derivative(as_printed):
    """Each row to 1e-6 of its greatest element; next to the arcsine's fold finite differences are not valid."""
    compared = 0
    for state, platform in zip(*scene((200,), seed=1), strict=True):
        if as_printed and abs(state[2] - platform[1]) < 0.05 * plain(state, platform)[0]:
            continue
        want = differences(state, platform, as_printed)
        scale = np.abs(want).max(axis=1, keepdims=True)
        got = platform_jacobian(state, platform, as_printed)
        np.testing.assert_allclose(got / scale, want / scale, rtol=0, atol=1e-6)
        compared += 1
    assert compared > 150


@given(seed=st.integers(0, 999))
def test_range_and_rate_are_those_of_any_sensor(seed):
    state, platform = scene(seed=seed)
    want = range_and_rate(state[ORDER], platform[:2])
    np.testing.assert_array_equal(platform_measurement(state, platform)[:2], want)
    slopes, rows = range_and_rate_jacobian(state[ORDER], platform[:2])[:, ORDER], platform_jacobian(state, platform)[:2]
    scale = np.abs(slopes).max(axis=1, keepdims=True)
    np.testing.assert_allclose(rows / scale, slopes / scale, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("place", "azimuth"),
    [((0, 9), 0.0), ((9, 9), 45.0), ((9, 0), 90.0), ((9, -9), 135.0), ((-9, -9), -135.0), ((-9, 0), -90.0)],
)
def test_azimuth_counts_clockwise_from_plus_y(place, azimuth):
    """Also behind the platform, where the printed arcsine takes 135 degrees for 45."""
    state = [place[0], 1.0, place[1], 2.0]
    for look in (0.0, 30.0, -170.0, 350.0):
        got = platform_measurement(state, (0, 0, np.radians(look)))[2]
        assert got == pytest.approx(np.radians((azimuth - look + 180) % 360 - 180), abs=1e-14)
    folded = {135.0: 45.0, -135.0: -45.0}.get(azimuth, azimuth)
    assert platform_measurement(state, (0, 0, 0.0), True)[2] == pytest.approx(np.radians(folded), abs=1e-14)


@given(azimuth=st.floats(-np.pi, np.pi), look=st.floats(-50.0, 50.0))
def test_azimuths_are_wrapped_and_point_at_the_target(azimuth, look):
    state = [100 * np.sin(azimuth), 0.0, 100 * np.cos(azimuth), 0.0]
    got = platform_measurement(state, (0.0, 0.0, look))[2]
    assert abs(got) <= np.pi
    away = got + look - azimuth
    assert np.hypot(np.cos(away) - 1.0, np.sin(away)) < 1e-13


def test_behind_the_platform_a_small_turn_is_a_full_one():
    """Straight behind the platform the azimuth jumps by 2 pi; its slope does not."""
    left, right = [-1e-6, 3.0, -10.0, 4.0], [1e-6, 3.0, -10.0, 4.0]
    jump = platform_measurement(right, (0, 0, 0.0)) - platform_measurement(left, (0, 0, 0.0))
    assert jump[2] == pytest.approx(2 * np.pi, abs=1e-6)
    np.testing.assert_allclose(
        platform_jacobian(right, (0, 0, 0.0))[2], platform_jacobian(left, (0, 0, 0.0))[2], atol=1e-7
    )


def test_the_printed_rate_has_a_minus():
    """A target that recedes at 5 m/s along +y closes at 5 m/s by eq. (5); along x both agree."""
    assert platform_measurement([0.0, 0.0, 10.0, 5.0], (0, 0, 0))[1] == 5.0
    assert platform_measurement([0.0, 0.0, 10.0, 5.0], (0, 0, 0), as_printed=True)[1] == -5.0
    assert platform_measurement([10.0, 5.0, 0.0, 0.0], (0, 0, 0), as_printed=True)[1] == 5.0


def test_the_printed_arcsine_at_its_fold_is_finite():
    for x in (9.0, -9.0, 1e-3, 1e5 / 3):
        assert platform_measurement([x, 1.0, 0.0, 2.0], (0, 0, 0), True)[2] == np.copysign(np.pi / 2, x)
        assert np.isfinite(platform_jacobian([x, 1.0, 0.0, 2.0], (0, 0, 0), True)).all()


@given(angle=st.floats(-np.pi, np.pi), seed=st.integers(0, 99))
def test_turning_the_world_and_the_look_direction_changes_nothing(angle, seed):
    """Clockwise by ``angle``."""
    state, platform = scene(seed=seed)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    turned = np.empty(4)
    turned[::2], turned[1::2] = turn @ state[::2], turn @ state[1::2]
    moved = [*(turn @ platform[:2]), platform[2] + angle]
    change = platform_measurement(turned, moved) - platform_measurement(state, platform)
    np.testing.assert_allclose(change[:2], 0.0, atol=1e-9)
    assert abs(math.remainder(change[2], 2 * math.pi)) < 1e-10


@pytest.mark.parametrize("as_printed", [False, True])
def test_on_top_of_the_platform_everything_stays_finite(as_printed):
    r, rdot, azimuth = platform_measurement([1.0, 30.0, 2.0, -40.0], [1.0, 2.0, 0.5], as_printed)
    assert 0 < r <= 1e-9
    assert rdot == 0
    assert azimuth == -0.5
    H = platform_jacobian([1.0, 30.0, 2.0, -40.0], [1.0, 2.0, 0.5], as_printed)
    assert np.isfinite(H).all()
    assert not H[2].any()


def test_a_batch_equals_its_elements_bit_for_bit():
    state, platform = scene((5, 3))
    z, H = platform_measurement(state, platform), platform_jacobian(state, platform)
    assert z.shape == (5, 3, 3)
    assert H.shape == (5, 3, 3, 4)
    for index in np.ndindex(5, 3):
        assert (platform_measurement(state[index], platform[index]) == z[index]).all()
        assert (platform_jacobian(state[index], platform[index]) == H[index]).all()


def test_leading_axes_broadcast():
    state, _ = scene((5, 1))
    platforms = np.array([[-1e3, -1e3, 0.0], [1e3, -1e3, 0.3]])
    z, H = platform_measurement(state, platforms), platform_jacobian(state, platforms)
    assert z.shape == (5, 2, 3)
    assert H.shape == (5, 2, 3, 4)
    assert (z[3, 1] == platform_measurement(state[3, 0], platforms[1])).all()
    assert (H[3, 1] == platform_jacobian(state[3, 0], platforms[1])).all()


@pytest.mark.parametrize("function", [platform_measurement, platform_jacobian])
def test_shapes_that_do_not_fit(function):
    with pytest.raises(InputError, match=r"state has shape \(3,\), expected \(\.\.\., 4\)"):
        function(np.zeros(3), np.zeros(3))
    with pytest.raises(InputError, match=r"platform has shape \(2,\), expected \(\.\.\., 3\)"):
        function(np.zeros(4), np.zeros(2))
    with pytest.raises(InputError, match="leading axes that broadcast"):
        function(np.zeros((2, 4)), np.zeros((3, 3)))


C = 299792458.0
WAVELENGTH = C / 10e9
PRFS, BANDWIDTHS, ANGLES = st.floats(1e3, 1e5), st.floats(1e6, 2e7), st.floats(1e-5, 6e-3)


def view(prf=1e4, bandwidth=1e7, pixel_angle=1e-3, **other):
    return platform_view(prf, bandwidth, pixel_angle, **{"wavelength": 0.03, "fft_length": 128, "pixels": 1000} | other)


def test_documented_numbers():
    """The proposed fixed setting: 60 kHz, 10 MHz, 1e-3 rad at 10 GHz."""
    got = view(60e3, wavelength=WAVELENGTH)
    assert got.variance == pytest.approx(np.array([14.9896, 7.0264, 1e-3]) ** 2 / 12, rel=1e-4)
    assert got.high == pytest.approx([2498.27, 449.689, 0.5], rel=1e-5)
    assert got.low == pytest.approx([-np.inf, -449.689, -0.5], rel=1e-5)


@given(prf=PRFS, bandwidth=BANDWIDTHS, angle=ANGLES, length=st.integers(1, 4096), pixels=st.integers(1, 4000))
def test_cells_and_intervals(prf, bandwidth, angle, length, pixels):
    """Uniform in a cell: (c / 2B)^2 / 12, a Doppler bin of PRF / Nfft, one pixel. In view: unambiguous values."""
    got = view(prf, bandwidth, angle, wavelength=WAVELENGTH, fft_length=length, pixels=pixels)
    doppler_bin = prf / length
    want = np.array([C / (2 * bandwidth), WAVELENGTH * doppler_bin / 2, angle]) ** 2 / 12
    np.testing.assert_allclose(got.variance, want, rtol=1e-14)
    interval, nyquist = 1 / prf, prf / 2  # echo before the next pulse, Doppler shift 2 rdot / lambda at most half a PRF
    image = pixels * angle / 2 if pixels * angle / 2 < np.pi * (1 - 1e-9) else np.inf  # a full circle has no edge
    np.testing.assert_allclose(got.high, [C * interval / 2, WAVELENGTH * nyquist / 2, image], rtol=1e-14)
    np.testing.assert_array_equal(got.low[1:], -got.high[1:])
    assert got.low[0] == -np.inf


@given(prf=PRFS, bandwidth=BANDWIDTHS, angle=ANGLES)
def test_range_and_rate_in_view_have_one_product(prf, bandwidth, angle):
    """Rmax times the greatest range-rate is c lambda / 8 whatever the PRF, hence the trade-off; B has none."""
    got, wider = view(prf, bandwidth, angle), view(prf, 2 * bandwidth, angle)
    assert got.high[0] * got.high[1] == pytest.approx(C * 0.03 / 8, rel=1e-14)
    np.testing.assert_array_equal(got.high, wider.high)
    assert wider.variance[0] == pytest.approx(got.variance[0] / 4, rel=1e-14)
    np.testing.assert_array_equal(got.variance[1:], wider.variance[1:])


@given(prf=PRFS, angle=ANGLES)
def test_printed_forms(prf, angle):
    """(14a) and (14b) as they stand: Rmax = lambda PRF / 2 and 0 <= rdot <= c / (2 PRF); the image is right."""
    got, right = view(prf, pixel_angle=angle, as_printed=True), view(prf, pixel_angle=angle)
    np.testing.assert_allclose(got.high, [0.03 * prf / 2, C / (2 * prf), right.high[2]], rtol=1e-14)
    np.testing.assert_array_equal(got.low, [-np.inf, 0.0, right.low[2]])
    np.testing.assert_array_equal(got.variance, right.variance)


def test_as_printed_a_fast_radar_sees_its_feet_only():
    """60 kHz: printed 0.9 km and 2.5 km/s, correct 2.5 km and 0.45 km/s."""
    assert view(60e3, as_printed=True).high[:2] == pytest.approx([900.0, 2498.27], rel=1e-5)


def test_a_batch_equals_its_elements_and_arguments_broadcast():
    prf, bandwidth = np.array([[1e3], [2e4], [1e5]]), np.array([1e6, 2e7])
    together = view(prf, bandwidth)
    for part in together:
        assert part.shape == (3, 2, 3)
    for i, j in np.ndindex(3, 2):
        for whole, one in zip(together, view(prf[i, 0], bandwidth[j]), strict=True):
            np.testing.assert_array_equal(whole[i, j], one)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize("name", ["prf", "bandwidth", "pixel_angle", "wavelength"])
def test_what_is_not_positive_is_refused(name, value):
    with pytest.raises(InputError, match=f"{name} is {value}.*expected a finite number > 0") as caught:
        view(**{name: value})
    assert "\n" not in str(caught.value)
    if name != "wavelength":
        with pytest.raises(InputError, match=f"{name} is {value}"):
            view(**{name: [1e3, value]})


@pytest.mark.parametrize("name", ["fft_length", "pixels"])
@pytest.mark.parametrize("value", [0, -3, 2.5])
def test_counts_are_whole(name, value):
    with pytest.raises(InputError, match=f"{name} is {value}, expected an integer >= 1"):
        view(**{name: value})


def test_settings_whose_shapes_do_not_fit():
    with pytest.raises(InputError, match=r"shapes are prf \(2,\), bandwidth \(3,\), pixel_angle \(\), expected shapes"):
        view(np.ones(2), np.ones(3))
