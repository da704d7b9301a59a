from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wavegym.targets.geodesy import ecef_to_enu, geodetic_to_ecef, mean_direction

A, B = 6378137.0, 6356752.314245179  # WGS-84 semi-axes as tabulated
E2 = 1 - (B / A) ** 2


def geodetic(ecef: np.ndarray) -> tuple[float, float, float]:
    """Latitude, longitude, height by fixed-point iteration on the latitude: an independent inverse."""
    x, y, z = ecef
    rho, phi = np.hypot(x, y), np.arctan2(z, np.hypot(x, y))
    for _ in range(30):
        N = A / np.sqrt(1 - E2 * np.sin(phi) ** 2)
        phi = np.arctan2(z + E2 * N * np.sin(phi), rho)
    N = A / np.sqrt(1 - E2 * np.sin(phi) ** 2)
    # height along the normal, well conditioned at all latitudes
    h = (rho - N * np.cos(phi)) * np.cos(phi) + (z - N * (1 - E2) * np.sin(phi)) * np.sin(phi)
    return np.degrees(phi), np.degrees(np.arctan2(y, x)), h


def test_the_axes_of_the_ellipsoid():
    np.testing.assert_allclose(geodetic_to_ecef(0, 0, 0), (A, 0, 0), atol=1e-6)
    np.testing.assert_allclose(geodetic_to_ecef(0, 90, 10), (0, A + 10, 0), atol=1e-6)
    np.testing.assert_allclose(geodetic_to_ecef(-90, 30, 5), (0, 0, -B - 5), atol=1e-6)


@settings(max_examples=100)
@given(st.floats(-89.9, 89.9), st.floats(-179.9, 179.9), st.floats(-400, 30e3))
def test_round_trip(lat, lon, alt):
    back = geodetic(geodetic_to_ecef(lat, lon, alt))
    np.testing.assert_allclose(back, (lat, lon, alt), atol=1e-7, rtol=0)


@pytest.mark.parametrize(("latitude", "length"), [(0.0, 110_574.4), (45.0, 111_131.8), (89.5, 111_693.9)])
def test_length_of_a_degree_of_latitude(latitude, length):
    """Tabulated for WGS-84, centred on the latitude (at the pole: on 89.5°); the chord is 1.4 m short of the arc."""
    steps = latitude + np.linspace(-0.5, 0.5, 1001)
    points = ecef_to_enu(geodetic_to_ecef(steps, 10.0, 0.0), latitude, 10.0)
    arc = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert arc == pytest.approx(length, abs=0.5)
    assert np.abs(points[:, 0]).max() < 1e-6  # a meridian runs north


@pytest.mark.parametrize("latitude", [-60.0, 0.0, 51.5])
def test_small_steps_follow_the_radii_of_curvature(latitude):
    phi, h = np.radians(latitude), 8000.0
    N = A / np.sqrt(1 - E2 * np.sin(phi) ** 2)
    M = A * (1 - E2) / (1 - E2 * np.sin(phi) ** 2) ** 1.5
    d = 1e-4
    lat, lon, alt = latitude + np.array([d, 0, 0]), -3.0 + np.array([0, d, 0]), h + np.array([0, 0, 1])
    east_north_up = ecef_to_enu(geodetic_to_ecef(lat, lon, alt), latitude, -3.0, h)
    expected = [[0, (M + h) * np.radians(d), 0], [(N + h) * np.radians(d) * np.cos(phi), 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(east_north_up, expected, atol=2e-4)


def test_the_plane_keeps_distances_and_the_horizon_drops():
    lat, lon, alt = np.array([52.0, 53.0, 51.0]), np.array([0.5, -2.0, 1.0]), np.array([0.0, 1e4, 500.0])
    ecef = geodetic_to_ecef(lat, lon, alt)
    enu = ecef_to_enu(ecef, 52.1, -0.7, 120.0)
    for i in range(3):
        np.testing.assert_allclose(
            np.linalg.norm(enu - enu[i], axis=1), np.linalg.norm(ecef - ecef[i], axis=1), atol=1e-8
        )
    # at distance s along the earth the plane is left by s²/2R
    down = ecef_to_enu(geodetic_to_ecef(0.0, 1.0, 0.0), 0.0, 0.0)[2]
    assert down == pytest.approx(-A * (1 - np.cos(np.radians(1.0))), abs=1e-6)


def test_mean_direction_crosses_the_date_line():
    latitude, longitude = mean_direction([10.0, 10.0], [179.0, -179.0])
    assert abs(longitude) == pytest.approx(180.0)
    assert latitude == pytest.approx(np.degrees(np.arctan(np.tan(np.radians(10)) / np.cos(np.radians(1)))))
