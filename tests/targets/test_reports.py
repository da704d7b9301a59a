"""The removal of impossible reports against a plain search, and its effort; geodesy against known points."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wavegym.targets import reader
from wavegym.targets.reader import POSITION_TOLERANCE, ecef_to_enu, flyable, geodetic_to_ecef, mean_direction

LIMIT = 8.0


def suspicions(times, positions):
    if len(times) < 3:
        return np.zeros(0)
    h1, h2 = times[1:-1] - times[:-2], times[2:] - times[1:-1]
    weight = (h1 / (h1 + h2))[:, None]
    chord = (1 - weight) * positions[:-2] + weight * positions[2:]
    return np.linalg.norm(positions[1:-1] - chord, axis=1) / (POSITION_TOLERANCE + LIMIT * h1 * h2 / 2)


def searched(times, positions):
    """The rule as it is documented: all suspicions anew after every removal."""
    kept = np.arange(len(times))
    level = suspicions(times, positions)
    while len(level) and level.max() > 1:
        worst = int(level.argmax()) + 1
        left = {}
        for suspect in (worst, worst - 1, worst + 1):
            near = np.delete(kept[max(0, worst - 3) : worst + 4], suspect - max(0, worst - 3))
            remaining = suspicions(times[near], positions[near])
            left[suspect] = (int((remaining > 1).sum()), float(remaining.sum()))
        kept = np.delete(kept, min(left, key=left.__getitem__))
        level = suspicions(times[kept], positions[kept])
    return np.isin(np.arange(len(times)), kept)


@settings(max_examples=80, deadline=None)
@given(
    st.integers(1, 60),
    st.sampled_from([1.0, 100.0, 1000.0]),
    st.sampled_from([1.0, 300.0]),
    st.booleans(),
    st.integers(0, 2**32 - 1),
)
def test_the_removal_is_that_of_a_plain_search(count, step, noise, on_a_grid, seed):
    rng = np.random.default_rng(seed)
    times = 10.0 * np.arange(count) if on_a_grid else np.cumsum(rng.uniform(0.1, 20.0, count))
    positions = np.cumsum(rng.normal(0, step, (count, 3)), axis=0) + rng.normal(0, noise, (count, 3))
    if on_a_grid:
        positions = np.round(positions / 500.0) * 500.0  # equal suspicions
    np.testing.assert_array_equal(flyable(times, positions, LIMIT), searched(times, positions))


def test_the_effort_of_a_removal_does_not_grow_with_the_file(monkeypatch):
    calls = 0
    level = reader._Chain._level

    def counted(self, *three):
        nonlocal calls
        calls += 1
        return level(self, *three)

    monkeypatch.setattr(reader._Chain, "_level", counted)
    efforts = []
    for count in (500, 4000):
        rng, times = np.random.default_rng(2), 10.0 * np.arange(count)
        stamped = times - np.where(rng.random(count) < 0.05, 6.0, 0.0)
        positions = np.stack([200.0 * stamped, 0 * stamped, 0 * stamped], axis=1)
        calls = 0
        removed = int((~flyable(times, positions, LIMIT)).sum())
        efforts.append(calls / removed)
    assert max(efforts) < 30
    assert efforts[1] < 1.2 * efforts[0]


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
