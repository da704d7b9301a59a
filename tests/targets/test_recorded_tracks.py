"""Cutting, resampling and cataloguing of tracks, against motion with a known closed form.

Smoothing splines against SciPy's; the choice of the time constant against its definition and known motion.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, make_smoothing_spline
from scipy.optimize import minimize

from wavegym.core.errors import InputError
from wavegym.targets import RecordedTrack, range_paths, windows
from wavegym.targets.reader import fill_heights, flyable, fresh, last_of_each_time
from wavegym.targets.recorded import ENDS, FACTORS, errors_of_prediction, smoothed


def straight(times, start=(1e4, -2e4, 3e3), velocity=(200.0, 30.0, -5.0), name="a") -> RecordedTrack:
    t = np.asarray(times, float)
    return RecordedTrack(name, t, np.asarray(start) + np.multiply.outer(t - t[0], velocity))


def circle(times, radius=8000.0, rate=0.025) -> np.ndarray:
    t = np.asarray(times)
    return np.stack([radius * np.cos(rate * t), radius * np.sin(rate * t), 0 * t + 5000.0], axis=-1)


def test_last_report_of_a_time_counts():
    assert last_of_each_time(np.array([0.0, 1, 1, 1, 2])).tolist() == [True, False, False, True, True]


def test_repeated_positions_are_stale_whatever_an_unknown_height():
    xy = np.array([[0.0, 0], [0, 0], [1, 0], [1, 0], [1, 0], [0, 0]])
    height = np.array([5.0, np.nan, 5, 6, 6, 6])
    assert fresh(xy, height).tolist() == [True, False, True, True, False, True]


def test_unknown_heights_are_interpolated_in_time():
    height, known = fill_heights(np.array([0.0, 10, 30, 40, 50]), np.array([np.nan, 100, np.nan, 400, np.nan]))
    assert known
    np.testing.assert_allclose(height, [100, 100, 300, 400, 400])
    height, known = fill_heights(np.array([0.0, 10]), np.full(2, np.nan))
    assert not known
    assert height.tolist() == [0, 0]


@pytest.mark.parametrize("late", [[0], [1], [12], [38], [39], [5, 6], [3, 20, 22]])
def test_late_reports_and_no_others_are_dropped(late):
    times = np.arange(0.0, 400.0, 10.0)
    stamped = times.copy()
    stamped[late] -= 6.0  # 6 s at 200 m/s: 1200 m behind the path; beyond 25 m + 8 m/s² (10 s)² / 2
    mask = flyable(times, circle(stamped, radius=8000.0), 8.0)
    assert np.flatnonzero(~mask).tolist() == late


@settings(max_examples=40)
@given(st.lists(st.floats(0.0, 9.0), min_size=3, max_size=40), st.floats(4.0, 12.0))
def test_the_kept_reports_respect_the_acceleration_limit(delays, limit):
    times = 10.0 * np.arange(len(delays))
    positions = circle(times - delays)
    mask = flyable(times, positions, limit)
    t, p = times[mask], positions[mask]
    h = np.diff(t)
    turn = np.linalg.norm(np.diff(np.diff(p, axis=0) / h[:, None], axis=0), axis=1)  # change of velocity
    allowed = limit * (h[1:] + h[:-1]) / 2 + 25.0 * (1 / h[1:] + 1 / h[:-1])
    assert (turn <= allowed * (1 + 1e-9)).all()
    assert mask.sum() >= 2


@settings(max_examples=30)
@given(st.floats(0.2, 20.0), st.floats(50.0, 300.0), st.floats(0.5, 7.9), st.integers(0, 2**32 - 1))
def test_a_turn_within_the_limit_is_kept(dt, speed, acceleration, seed):
    times = dt * np.arange(30)
    noise = np.random.default_rng(seed).uniform(-5.0, 5.0, (30, 3))  # quantisation, within the tolerance
    path = circle(times, radius=speed**2 / acceleration, rate=acceleration / speed)
    assert flyable(times, path + noise, 8.0).all()


def test_a_jump_for_good_becomes_a_gap():
    times = np.arange(0.0, 600.0, 10.0)
    positions = straight(times).positions
    positions[30:] += (40e3, 0, 0)  # two targets under one id
    mask = flyable(times, positions, 8.0)
    kept = RecordedTrack("a", times[mask], positions[mask])
    pieces = kept.pieces(30.0)
    assert len(pieces) == 2
    for piece in pieces:
        np.testing.assert_allclose(
            np.diff(piece.positions, axis=0) / np.diff(piece.times)[:, None], [(200, 30, -5)] * (len(piece.times) - 1)
        )


@settings(max_examples=60)
@given(
    st.lists(st.floats(0.5, 60.0), min_size=1, max_size=25),
    st.floats(0.3, 7.0),
    st.floats(1.0, 50.0),
)
def test_no_sample_lies_in_a_gap(steps, dt, max_gap):
    times = 1.6e9 + np.cumsum([0.0, *steps])
    track = straight(times)
    for piece in track.resample(dt, max_gap):
        after = np.searchsorted(times, piece.times, side="left").clip(1)
        width = times[after] - times[after - 1]
        on_report = np.isclose(piece.times, times[after], rtol=0, atol=1e-6)
        assert ((width <= max_gap) | on_report | np.isclose(piece.times, times[after - 1], rtol=0, atol=1e-6)).all()
        assert piece.times[0] in times
        np.testing.assert_allclose(np.diff(piece.times), dt, atol=1e-6)
        # constant velocity is reproduced exactly for any times of reports
        np.testing.assert_allclose(piece.velocities, [(200.0, 30.0, -5.0)] * len(piece.times), rtol=1e-6)


@settings(max_examples=60)
@given(st.lists(st.floats(0.5, 60.0), min_size=1, max_size=25), st.floats(0.3, 7.0), st.floats(1.0, 50.0))
def test_pieces_partition_the_reports(steps, dt, max_gap):
    track = straight(np.cumsum([0.0, *steps]))
    pieces = track.pieces(max_gap)
    np.testing.assert_array_equal(np.concatenate([p.times for p in pieces]), track.times)
    np.testing.assert_array_equal(np.concatenate([p.positions for p in pieces]), track.positions)
    assert all((np.diff(p.times) <= max_gap).all() for p in pieces)
    assert all(b.times[0] - a.times[-1] > max_gap for a, b in pairwise(pieces))
    counts = [int(p.duration / dt + 1e-9) + 1 for p in pieces if p.duration >= dt]
    assert [len(p.times) for p in track.resample(dt, max_gap)] == counts


def test_samples_pass_through_the_reports_and_agree_with_each_other():
    times = np.array([0.0, 7, 10, 20, 26, 40, 50, 63])
    track = RecordedTrack("a", times, circle(times))
    (piece,) = track.resample(0.125)
    at = np.searchsorted(piece.times, times)
    np.testing.assert_allclose(piece.positions[at], track.positions, atol=1e-8)
    # positions and velocities are one curve: Simpson's rule is exact on a cubic's derivative
    v = piece.velocities
    simpson = (v[:-2:2] + 4 * v[1:-1:2] + v[2::2]) * (0.125 / 3)
    np.testing.assert_allclose(simpson, piece.positions[2::2] - piece.positions[:-2:2], atol=1e-8)
    a = piece.accelerations  # piecewise linear, joints on samples: the trapezium is exact
    np.testing.assert_allclose((a[1:] + a[:-1]) * (0.125 / 2), np.diff(v, axis=0), atol=1e-10)


def test_a_turning_aircraft_is_followed():
    times = np.arange(0.0, 300.0, 10.0)
    (piece,) = RecordedTrack("a", times, circle(times)).resample(1.0)
    inner = slice(40, -40)  # the natural end condition affects some reports
    # a spline errs by 5/384 h⁴ |p''''| at most: 0.4 m here, and 1/24 h³ |p''''| in velocity: 0.13 m/s
    fourth = 8000.0 * 0.025**4
    error = np.abs(piece.positions - circle(piece.times))[inner]
    assert error.max() < 5 / 384 * 1e4 * fourth
    speed = np.linalg.norm(piece.velocities, axis=1)[inner]
    assert np.abs(speed - 200.0).max() < 1e3 / 24 * fourth


def test_the_result_does_not_depend_on_the_axes():
    times = np.array([0.0, 10, 20, 30, 50, 60])
    rng = np.random.default_rng(2)
    positions = circle(times) + rng.normal(0, 50, (6, 3))
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    (plain,), (turned,) = (RecordedTrack("a", times, p).resample(1.0) for p in (positions, positions @ turn.T))
    np.testing.assert_allclose(turned.velocities, plain.velocities @ turn.T, atol=1e-9)


def test_smoothing_minimises_the_documented_integral():
    """Σ|report - f|² + τ⁴/h ∫ f''², minimised over the knots of natural cubic splines by a general optimiser."""
    from scipy.interpolate import CubicSpline

    times, tau = np.arange(0.0, 60.0, 10.0), 6.0
    reports = np.array([0.0, 90, 260, 270, 420, 480])

    def target(values):
        curve = CubicSpline(times, values, bc_type="natural")
        bend = curve(np.linspace(0, 50, 5001), 2) ** 2
        return np.sum((reports - values) ** 2) + tau**4 / 10 * np.sum(bend[1:] + bend[:-1]) * 0.005

    best = minimize(target, reports, method="BFGS", options={"gtol": 1e-7}).x
    positions = np.stack([reports, 0 * reports, 2 * reports], axis=1)
    (piece,) = RecordedTrack("a", times, positions).resample(10.0, smoothing=tau)
    np.testing.assert_allclose(piece.positions[:, 0], best, atol=0.02)
    np.testing.assert_allclose(piece.positions[:, 2], 2 * piece.positions[:, 0], rtol=1e-9)


def test_smoothing_lessens_the_jitter_of_late_stamps():
    times = np.arange(0.0, 600.0, 10.0)
    late = times - np.random.default_rng(4).uniform(0.0, 2.0, len(times))
    track = RecordedTrack("a", times, circle(late))
    rough, smooth = (track.resample(1.0, smoothing=s)[0] for s in (0.0, 7.0))
    rms = [np.sqrt(np.mean((np.linalg.norm(p.velocities, axis=1) - 200.0) ** 2)) for p in (rough, smooth)]
    assert rms[1] < 0.5 * rms[0]


def test_windows_are_all_stretches_without_a_gap():
    track = straight([0.0, 10, 20, 30, 100, 110, 120, 130, 140, 200, 205])
    catalogue = windows(track, dt=1.0, steps=25)
    assert len(catalogue) == (31 - 25) + (41 - 25)
    found = set()
    for i in range(len(catalogue)):
        piece, first = catalogue.locate(i)
        window = catalogue[i]
        assert window.shape == (26, 9)
        np.testing.assert_array_equal(window[:, :3], piece.positions[first : first + 26])
        np.testing.assert_array_equal(window[:, 3:6], piece.velocities[first : first + 26])
        np.testing.assert_array_equal(window[:, 6:], piece.accelerations[first : first + 26])
        found.add((piece.times[0], first))
    assert found == {(0.0, k) for k in range(6)} | {(100.0, k) for k in range(16)}
    many = catalogue[np.array([[0, 3], [21, 1]])]
    np.testing.assert_array_equal(many[1, 0], catalogue[21])


def test_range_paths_are_the_radars_line_of_sight():
    track = straight(np.arange(0.0, 100.0, 10.0), start=(-5e3, 2e3, 1e3), velocity=(150.0, 20.0, 3.0))
    radar = np.array([100.0, -50.0, 20.0])
    catalogue = windows(track, 1.0, 50)
    seen = range_paths(catalogue, radar, acceleration=True)
    assert seen.names == ("r", "rdot", "rddot")
    assert len(seen) == len(catalogue)
    t = np.arange(0.0, 51.0)[:, None] + 7.0

    def r(offset):
        return np.linalg.norm((-5e3, 2e3, 1e3) + (t + offset) * (150.0, 20.0, 3.0) - radar, axis=1)

    h = 1e-2
    path = seen[7]
    np.testing.assert_allclose(path[:, 0], r(0.0), rtol=1e-9)
    np.testing.assert_allclose(path[:, 1], (r(h) - r(-h)) / (2 * h), rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(path[:, 2], (r(h) - 2 * r(0.0) + r(-h)) / h**2, rtol=1e-3, atol=1e-3)
    np.testing.assert_array_equal(range_paths(catalogue, radar)[7], path[:, :2])
    assert path[0, 1] < 0  # closing


def test_windows_beyond_the_limits_are_left_out():
    track = straight(np.arange(0.0, 110.0, 10.0), start=(-5e3, 0, 0), velocity=(100.0, 0, 0))  # through the radar
    catalogue = windows(track, 1.0, 20)
    seen = range_paths(catalogue, limits=(100.5, 4000.5))
    starts = [int(seen.locate(i)[1]) for i in range(len(seen))]
    assert starts == [k for k in range(81) if all(100.5 <= abs(-5e3 + 100 * j) <= 4000.5 for j in range(k, k + 21))]
    assert np.isfinite(range_paths(catalogue)[np.arange(5)]).all()
    with pytest.raises(InputError, match=r"no window stays between 6000 and 7000 m.*0 to 5000 m away"):
        range_paths(catalogue, limits=(6e3, 7e3))


def test_no_usable_window_says_what_was_found():
    tracks = [
        RecordedTrack(
            "a", np.array([0.0, 20, 34, 90, 100]), np.zeros((5, 3)), dropped={"repeated position": 3}, source="t.csv"
        ),
        straight([0.0, 12.0], name="b"),
    ]
    with pytest.raises(InputError) as caught:
        windows(tracks, 1.0, 51)
    message = str(caught.value)
    assert "t.csv: longest gap-free piece lasts 34 s (track 'a'), 51 s needed" in message
    assert "more than 30 s apart; reports left out: 3 for repeated position" in message
    assert "\n" not in message
    assert len(windows(tracks, 1.0, 34)) == 1


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda t: t.resample(0.0), "dt is 0.0 s"),
        (lambda t: t.resample(1.0, max_gap=-3.0), "max_gap is -3.0 s"),
        (lambda t: t.resample(1.0, smoothing=-1.0), "smoothing is -1.0 s"),
        (lambda t: t.resample(1e-9), "dt is 1e-09 s, expected a larger dt"),
        (lambda t: windows(t, 1.0, 0), "steps is 0"),
        (lambda t: windows(t, 1.0, 2.5), "steps is 2.5, expected an integer >= 1"),
        (lambda t: windows([], 1.0, 5), "tracks is empty"),
        (lambda t: range_paths(windows(t, 1.0, 5), radar=(0.0, 0.0)), "radar is"),
        (lambda t: range_paths(windows(t, 1.0, 5), limits=(0.0, 1e5)), "0 < nearest"),
        (lambda t: range_paths(range_paths(windows(t, 1.0, 5))), "expected the 9"),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(InputError, match=words) as caught:
        call(straight([0.0, 10.0, 20.0]))
    assert "\n" not in str(caught.value)


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
