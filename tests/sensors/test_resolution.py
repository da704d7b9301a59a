"""Variance and field of view of a platform's settings: resolution cells, unambiguous intervals and the image."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.sensors import platform_view

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


def test_shapes_that_do_not_fit():
    with pytest.raises(InputError, match=r"shapes are prf \(2,\), bandwidth \(3,\), pixel_angle \(\), expected shapes"):
        view(np.ones(2), np.ones(3))
