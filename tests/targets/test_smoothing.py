"""Smoothing splines against SciPy's; the choice of the time constant against its definition and known motion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, make_smoothing_spline

from wavegym.targets import RecordedTrack
from wavegym.targets.smoothing import ENDS, FACTORS, errors_of_prediction, smoothed

RADIUS, RATE, DRIFT = 20.0, 0.5, 3.0  # a drone that circles at 10 m/s and drifts


def drone(times):
    t = np.asarray(times)
    x, y = RADIUS * np.cos(RATE * t) + DRIFT * t, RADIUS * np.sin(RATE * t)
    return np.stack([x, y, 50.0 + 5.0 * np.sin(0.1 * t)], axis=-1)


def recorded(spacing, noise, seed=0, seconds=300.0) -> RecordedTrack:
    times = np.arange(0.0, seconds, spacing)
    errors = np.random.default_rng(seed).normal(0.0, noise, (len(times), 3))
    return RecordedTrack("drone", times, drone(times) + errors)


def error(track: RecordedTrack, smoothing: float | None) -> np.ndarray:
    """Distance of the truth made from a recording to the known path [m], without the ends."""
    (piece,) = track.resample(0.1, smoothing=smoothing)
    return np.linalg.norm(piece.positions - drone(piece.times), axis=1)[50:-50]


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.floats(0.2, 20.0), min_size=4, max_size=60),
    st.floats(0.1, 5.0),
    st.integers(0, 2**32 - 1),
)
def test_smoothing_is_scipys(gaps, factor, seed):
    times = np.cumsum([0.0, *gaps])
    positions = np.random.default_rng(seed).normal(0.0, 100.0, (len(times), 3))
    tau = factor * np.mean(gaps)
    curve = make_smoothing_spline(times, positions, lam=tau**4 / np.mean(gaps))
    np.testing.assert_allclose(smoothed(times, positions, tau), curve(times), atol=1e-5)
    (piece,) = RecordedTrack("a", times, positions).resample(0.1, smoothing=tau)
    np.testing.assert_allclose(piece.positions, curve(piece.times), atol=1e-5)


def test_errors_of_prediction_are_those_of_leaving_each_report_out():
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(0.5, 2.0, 14))
    positions = rng.normal(0.0, 10.0, (14, 3))
    found = errors_of_prediction(times, positions)
    mean = np.diff(times).mean()
    for left_out in range(ENDS, 14 - ENDS):
        rest = np.delete(np.arange(14), left_out)
        for factor, row in zip(FACTORS, found, strict=True):
            if factor:
                curve = make_smoothing_spline(times[rest], positions[rest], lam=(factor * mean) ** 4 / mean)
            else:
                curve = CubicSpline(times[rest], positions[rest], bc_type="natural")
            away = np.sum((curve(times[left_out]) - positions[left_out]) ** 2)
            assert row[left_out - ENDS] == pytest.approx(away, rel=1e-6)


@pytest.mark.parametrize("spacing", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("noise", [0.0, 0.5, 2.0, 10.0])
def test_the_truth_of_a_drone_stays_within_the_noise_of_its_reports(spacing, noise):
    track = recorded(spacing, noise)
    away = error(track, None)
    of_reports = np.sqrt(3.0) * noise
    assert np.sqrt(np.mean(away**2)) <= 0.8 * of_reports + 0.05
    assert away.max() <= 2.0 * of_reports + 0.1
    assert np.sqrt(np.mean(error(track, 7.0) ** 2)) > 15.0  # 7 s suit aircraft that report every 10 s


def test_smoothing_grows_with_the_noise_and_is_stated():
    chosen = [recorded(0.5, noise).choose_smoothing() for noise in (0.0, 0.5, 2.0, 10.0)]
    assert chosen == sorted(chosen)
    assert chosen[0] < 0.3 < 0.7 < chosen[-1]
    (piece,) = recorded(0.5, 2.0).resample(0.5, smoothing=None)
    assert piece.smoothing == chosen[2]


def test_late_time_stamps_of_aircraft_are_smoothed_as_they_were():
    times = np.arange(0.0, 1200.0, 10.0)
    late = times - np.random.default_rng(4).uniform(0.0, 2.0, len(times))
    path = np.stack([8000.0 * np.cos(0.025 * late), 8000.0 * np.sin(0.025 * late), 0 * late], axis=-1)
    assert 5.0 <= RecordedTrack("a", times, path).choose_smoothing() <= 10.0


def test_too_few_reports_are_not_smoothed():
    times = np.arange(8.0)
    track = RecordedTrack("a", times, drone(times))
    assert track.choose_smoothing() == 0.0
    (piece,) = RecordedTrack("a", times[:4], drone(times[:4])).resample(1.0, smoothing=5.0)
    assert piece.smoothing == 0.0


def test_the_longest_gap_follows_the_spacing_of_the_reports():
    times = np.append(np.arange(0.0, 600.0, 60.0), 1000.0)
    track = RecordedTrack("ship", times, np.zeros((11, 3)) + times[:, None])
    assert track.spacing == 60.0
    assert track.longest_gap(None) == 180.0
    assert [len(piece.times) for piece in track.pieces(None)] == [10, 1]
    assert [len(piece.times) for piece in track.pieces(30.0)] == [1] * 11
    assert RecordedTrack("a", times[:1], np.zeros((1, 3))).longest_gap(None) == 30.0
