"""The urban tracker: tracks are started, held, separated from ghosts and ended as they should be."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from wavegym.core.errors import InputError
from wavegym.core.parameters import make_checked
from wavegym.sensors import Road, UrbanMap, mean_inverse_detected_snr, multistatic_range_and_rate
from wavegym.sensors.multipath import Antenna
from wavegym.sensors.multistatic import Multistatic
from wavegym.systems.urban import tracker_kernels
from wavegym.systems.urban.scan_kernels import claim_ghosts
from wavegym.systems.urban.tracker import CONFIRMED, EMPTY, TENTATIVE, Tracks, UrbanTracker
from wavegym.trackers import imm_combine, predict, ukf_update

CROSSING = UrbanMap.load("intersection")
TX, RX = (2085.0, 1470.5), ((2088.0, 1475.0), (2078.0, 1467.0))
PLAIN = UrbanMap(roads=(Road(((1900.0, 1530.0), (2200.0, 1530.0)), 60.0),))
R, SNR = np.diag([39.2, 0.0069]), 200.0  # of a train of 249 pulses of 40 MHz at 4 GHz
TRACKER = UrbanTracker(CROSSING, (TX,), RX, error_snr="mean")
OPEN = UrbanTracker(PLAIN, (TX,), RX, error_snr="mean")


def scan_of(states, noise=None, most=6):
    """Direct measurements of targets (target, 4) at both receivers, with or without errors: z, count of one scan."""
    z = np.zeros((1, 2, most, 2))
    for m, place in enumerate(RX):
        exact = multistatic_range_and_rate(np.reshape(states, (-1, 4)), TX, place)
        eta = SNR * (100.0 / exact[:, 0]) ** 4
        spread = np.stack([np.sqrt(R[0, 0] / eta), np.sqrt(R[1, 1] / eta + 0.01)], axis=1)
        z[0, m, : len(exact)] = exact + (0.0 if noise is None else spread * noise.standard_normal(exact.shape))
    return z, np.full((1, 2), len(np.reshape(states, (-1, 4))))


NOTHING = np.zeros((1, 2, 6, 2)), np.zeros((1, 2), np.int64)


def held(tracker, state, existence=0.99, status=CONFIRMED, age=10, slot=0, tracks=None, spread=1.0):
    """Tracks with one at ``state`` (4,), known to ``spread`` m."""
    tracks = tracker.empty(1) if tracks is None else tracks
    tracks.x[0, slot, :, :4] = state
    tracks.P[0, slot] = np.diag([spread**2, spread**2, 1.0, 1.0, 0.25, 0.25])
    tracks.existence[0, slot], tracks.status[0, slot], tracks.age[0, slot] = existence, status, age
    return tracks


def test_a_visible_target_is_found_confirmed_and_followed():
    """A target driving past at 8 m/s is soon confirmed in most runs, with consistent errors."""
    first, nees = [], []
    for seed in range(40):
        noise, tracks = np.random.default_rng(seed), OPEN.empty(1)
        for k in range(40):
            state = np.array([2050.0 + 2.0 * k, 1530.0, 8.0, 0.0])
            tracks = OPEN.scan(tracks, *scan_of(state, noise), R, SNR)
            assert tracks.refused.sum() == 0
            if (tracks.status[0] == CONFIRMED).any() and len(first) == seed:
                first.append(k)
        (slot,) = np.flatnonzero(tracks.status[0] == CONFIRMED)
        assert tracks.existence[0, slot] > 0.99
        x, P = (leaf[0, slot] for leaf in tracks.combined())
        off = x[:4] - state
        nees.append(off @ np.linalg.solve(P[:4, :4], off))
    assert min(first) >= OPEN.confirm_after - 1
    assert np.median(first) <= OPEN.confirm_after + 1
    assert np.mean(nees) < 4.0 + 4 * np.sqrt(
        8.0 / 40
    )  # chi-square with 4 degrees of freedom; turn models overstate the covariance


def test_a_batch_is_its_environments_and_nothing_given_is_changed():
    noise = np.random.default_rng(3)
    states = np.array([[2040.0, 1500.0, 8.0, 0.0], [2069.0, 1530.0, 1.0, 4.0]])
    moved = np.concatenate([0.25 * states[:, 2:], np.zeros((2, 2))], axis=1)
    scans = [scan_of(states + k * moved, noise) for k in range(5) for _ in range(2)]
    z, count = (np.concatenate(parts).reshape(5, 2, *parts[0].shape[1:]) for parts in zip(*scans, strict=True))
    both, alone = TRACKER.empty(2), [TRACKER.empty(1), TRACKER.empty(1)]
    for k in range(5):
        before = Tracks(*(leaf.copy() for leaf in both))
        both = TRACKER.scan(after := both, z[k], count[k], R, SNR)
        for a, b in zip(after, before, strict=True):
            np.testing.assert_array_equal(a, b)
        for e in range(2):
            alone[e] = TRACKER.scan(alone[e], z[k, e : e + 1], count[k, e : e + 1], R, SNR)
            for a, b in zip(both, alone[e], strict=True):
                np.testing.assert_array_equal(a[e], b[0])
    assert (both.status == CONFIRMED).any()


def test_missed_detections_count_where_the_target_is_visible():
    seen, hidden = (2069.0, 1530.0, 0.0, 5.0), (1950.0, 1500.0, 0.0, 0.0)  # the second behind a corner
    after = []
    for state in (seen, hidden):
        tracks = held(TRACKER, state)
        for _ in range(8):
            tracks = TRACKER.scan(tracks, *NOTHING, R, SNR)
        after.append(tracks)
    assert after[0].status[0, 0] == EMPTY
    assert after[0].existence[0, 0] == 0.0
    assert after[1].status[0, 0] == CONFIRMED
    assert after[1].existence[0, 0] > 0.5


def test_a_track_that_leaves_the_roads_ends():
    for state, left in (((2110.0, 1430.0, 0.0, 0.0), EMPTY), ((2069.0, 1530.0, 0.0, 0.0), CONFIRMED)):
        tracks = TRACKER.scan(held(TRACKER, state), *scan_of(state), R, SNR)
        assert tracks.status[0, 0] == left


def test_of_two_tracks_at_one_place_the_confirmed_then_the_older_stays():
    here, beside = (2069.0, 1530.0, 0.0, 5.0), (2070.0, 1531.0, 0.5, 5.0)
    for status, age, existence, stays in ((TENTATIVE, 50, 0.1, 0), (CONFIRMED, 5, 0.99, 0), (CONFIRMED, 50, 0.99, 1)):
        tracks = held(TRACKER, beside, existence, status, age, slot=1, tracks=held(TRACKER, here))
        tracks = TRACKER.scan(tracks, *scan_of([here, beside]), R, SNR)
        assert np.flatnonzero(tracks.status[0] == CONFIRMED).tolist() == [stays]
    apart = held(TRACKER, (2069.0, 1545.0, 0.0, 5.0), slot=1, tracks=held(TRACKER, here))
    tracks = TRACKER.scan(apart, *scan_of([here, (2069.0, 1545.0, 0.0, 5.0)]), R, SNR)
    assert np.flatnonzero(tracks.status[0]).tolist() == [0, 1]


def test_no_more_tracks_than_slots():
    """A new track replaces the tentative track of least existence, never a confirmed one."""
    few = UrbanTracker(CROSSING, (TX,), RX, slots=2)
    new, old = (2040.0, 1500.0, 8.0, 0.0), (2069.0, 1530.0, 0.0, 5.0)
    tracks = held(few, (1950.0, 1500.0, 0.0, 0.0), 0.5, TENTATIVE, slot=1, tracks=held(few, old))
    tracks = few.scan(tracks, *scan_of([old, new]), R, SNR)
    assert tracks.refused.tolist() == [1]
    assert tracks.status[0].tolist() == [CONFIRMED, TENTATIVE]
    assert np.abs(tracks.x[0, 1, 0, :2] - new[:2]).max() < 0.5
    tracks = held(few, (1950.0, 1500.0, 0.0, 0.0), slot=1, tracks=held(few, old))
    tracks = few.scan(tracks, *scan_of([old, new]), R, SNR)
    assert tracks.refused.tolist() == [1]
    assert tracks.status[0].tolist() == [CONFIRMED, CONFIRMED]


def test_returns_over_walls_start_no_tracks_once_their_target_is_known():
    """All returns of one target at both receivers, direct and over walls, with and without the map."""
    state, before = np.array([2069.0, 1600.0, 0.0, 10.0]), np.array([2069.0, 1597.5, 0.0, 10.0])
    z, count = np.zeros((1, 2, 40, 2)), np.zeros((1, 2), np.int64)
    for m, place in enumerate(RX):
        pair = Multistatic(Antenna(CROSSING, TX), Antenna(CROSSING, place))
        returns = pair.measure(state)[pair.visible(state[:2])]
        z[0, m, : len(returns)], count[0, m] = returns, len(returns)
    assert count.min() >= 4
    begun = {}
    for ghosts in (True, False):
        tracker = UrbanTracker(CROSSING, (TX,), RX, ghosts=ghosts, vaguest=60.0)
        tracks = tracker.scan(held(tracker, before, spread=0.3), z, count, R, SNR)
        begun[ghosts] = int((tracks.status[0] == TENTATIVE).sum())
    assert begun[True] == 0
    assert begun[False] > 0


def snr_of_covariances(error_snr, eta):
    """SNR at which a tracker has the covariance of a Rayleigh echo of the mean SNR eta."""
    return eta if error_snr == "mean" else 1.0 / mean_inverse_detected_snr(eta, 1e-3, least=1.0)


@pytest.mark.parametrize("error_snr", ["mean", "realised"])
def test_the_expected_scan_is_the_update_times_the_detection_probability(error_snr):
    tracker = UrbanTracker(PLAIN, (TX,), RX, models="ncv", error_snr=error_snr)
    state = np.array([2060.0, 1540.0, 3.0, 4.0])
    tracks = held(tracker, state)
    x, P = predict(tracks.x[0, 0, 0], tracks.P[0, 0, 0], tracker.motion[0].F, tracker.motion[0].Q)
    for place in RX:
        z = multistatic_range_and_rate(x[:4], TX, place)
        # the SNR is evaluated at the predicted measurement, the unscented mean
        eta = SNR * (100.0 / z[0]) ** 4
        covariance = R / snr_of_covariances(error_snr, eta) + np.diag([0.0, 0.01])
        _, updated, _ = ukf_update(x, P, z, covariance, TX, place)
        P = P - 0.99 * 1e-3 ** (1.0 / (1.0 + eta / 2.0)) * (P - updated)
    expected = tracker.expect(tracks, R, SNR)
    np.testing.assert_allclose(expected.P[0, 0, 0], P, atol=1e-4 * np.diag(P).max())
    np.testing.assert_allclose(expected.x[0, 0, 0], x)
    assert expected.existence[0, 0] == pytest.approx(0.99 * 0.99)
    weak = tracker.expect(tracks, R, 1.0)
    assert np.trace(weak.P[0, 0, 0]) > np.trace(expected.P[0, 0, 0])


def test_combined_is_the_mixture():
    tracks = held(TRACKER, (2069.0, 1530.0, 0.0, 5.0))
    for ours, theirs in zip(tracks.combined(), imm_combine(tracks.x, tracks.P, tracks.mu), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("error_snr", ["mean", "realised"])
def test_ghosts_have_the_covariance_of_the_snr_of_errors(error_snr):
    """Returns of a track that is known exactly: each path adds N(z; h, R) / Pg, times c / (1 - c) with c = Pg Pd."""
    tracker = UrbanTracker(CROSSING, (TX,), RX, models="ncv", error_snr=error_snr)
    state, pair = np.array([2069.0, 1560.0, 1.0, 4.0]), Multistatic(Antenna(CROSSING, TX), Antenna(CROSSING, RX[0]))
    over_walls = pair.visible(state[:2]) & (pair.walls >= 1)
    returns, reflected = pair.measure(state)[over_walls], pair.reflected[over_walls]
    assert len(returns) > 1
    tracks = held(tracker, state, existence=1.0)
    own = tracker_kernels.slots_of(0, *tracks._replace(P=1e-12 * tracks.P)[:6])
    scratch, zeros = tracker_kernels.scratch_for(tracker.slots, 1, 6, 2), ((0,) * 6, (0,), (0,) * 2)
    for z in returns:
        wanted, ghosts, claims = 0.0, np.zeros(1), np.zeros(1)
        for h, left in zip(returns, reflected, strict=True):
            eta = SNR * left * (100.0 / h[0]) ** 4
            law = multivariate_normal(h, R / snr_of_covariances(error_snr, eta) + np.diag([0.0, 0.01]))
            pd = 0.99 * 1e-3 ** (1.0 / (1.0 + eta / 2.0))
            inside = -2.0 * (law.logpdf(z) - law.logpdf(h)) <= chi2.ppf(0.99, 2)
            wanted += inside * law.pdf(z) / 0.99 * pd / (1.0 - pd)
        claim_ghosts(own, tracker.constants, 0, R, SNR, z[None].copy(), 1, ghosts, claims, scratch, *zeros)
        assert ghosts[0] == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"transmitters": ()}, r"transmitters is \(\), expected at least one"),
        ({"receivers": RX[:1]}, "expected at least two"),
        ({"receivers": ((2086.0, 1471.5), (2084.0, 1469.5))}, "stand in one line, expected a triangle"),
        ({"transmitters": ((2000.0, 1600.0),)}, "inside a building"),
        ({"slots": 0}, "slots is 0, expected an integer >= 1"),
        ({"false_alarm": 0.0}, "false_alarm is 0"),
        ({"false_alarm": 1.0}, r"false_alarm is 1\.0, expected a probability above 0 and below 1"),
        ({"clutter_density": -1.0}, "clutter_density is -1"),
        ({"survival": 1.1}, r"survival is 1\.1"),
        ({"stay": 1.0}, r"stay is 1\.0"),
        ({"axes": ((1.0, 0.0),)}, "axes has 1 entries, expected 2: one for each receiver"),
        ({"axes": ((1.0, 0.0), (0.0, 2.0))}, "expected a unit vector"),
        ({"axes": ((1.0, 0.0), (0.0, 1.0)), "elements": 1}, "elements is 1, expected an integer >= 2"),
        ({"models": "vsim"}, "models is 'vsim'"),
        ({"error_snr": "means"}, "error_snr is 'means', expected one of 'mean', 'realised'; did you mean 'mean'"),
        ({"reech": 3.0}, "UrbanTracker got an unexpected keyword argument 'reech'; did you mean 'reach'"),
    ],
)
def test_mistakes(change, message):
    arguments = {"urban_map": CROSSING, "transmitters": (TX,), "receivers": RX, **change}
    with pytest.raises(InputError, match=message):
        make_checked(UrbanTracker, arguments)
    if "unexpected keyword" not in message:
        with pytest.raises(InputError, match=message):
            UrbanTracker(**arguments)


def test_shapes_that_do_not_fit():
    with pytest.raises(
        InputError, match=r"z and count have shapes \(1, 3, 6, 2\) and \(1, 2\), expected \(1, 2, most, 2\)"
    ):
        TRACKER.scan(TRACKER.empty(1), np.zeros((1, 3, 6, 2)), np.zeros((1, 2)), R, SNR)
    for count in (7, -1, 1.5, np.nan):
        with pytest.raises(InputError, match=f"count is {count}, expected an integer from 0 to 6"):
            TRACKER.scan(TRACKER.empty(1), NOTHING[0], np.full((1, 2), count), R, SNR)


@pytest.mark.parametrize(
    "other", [UrbanTracker(CROSSING, (TX,), RX, models="ncv"), UrbanTracker(CROSSING, (TX,), RX, slots=3)]
)
def test_another_tracker_s_tracks_are_refused(other):
    for use in (lambda tracks: TRACKER.scan(tracks, *NOTHING, R, SNR), lambda tracks: TRACKER.expect(tracks, R, SNR)):
        with pytest.raises(InputError, match=r"tracks\.\w+ has shape .*for this tracker"):
            use(other.empty(1))


@pytest.mark.parametrize(
    ("R", "snr", "message"),
    [
        (-R, SNR, "expected positive definite matrices"),
        (np.ones((2, 2)), SNR, "expected positive definite matrices"),
        (np.full((2, 2), np.nan), SNR, "expected positive definite matrices"),
        (R, 0.0, "snr is 0"),
        (R, -1.0, "snr is -1"),
        (R, np.nan, "snr is nan"),
        (R, np.ones(3), r"snr have shapes"),
    ],
)
def test_impossible_waveforms_are_refused(R, snr, message):
    for use in (
        lambda: TRACKER.scan(TRACKER.empty(1), *NOTHING, R, snr),
        lambda: TRACKER.expect(TRACKER.empty(1), R, snr),
    ):
        with pytest.raises(InputError, match=message):
            use()


AXES = ((1.0, 0.0), (0.0, 1.0))
IN_LINE = ((2088.0, 1470.5), (2078.0, 1470.5))  # antennas on a line along x


def pointed(state, receivers=RX, axes=AXES):
    """Direct measurements of one target (4,) with directions of arrival, without errors: z, count of one scan."""
    z = np.zeros((1, 2, 1, 3))
    for m, (place, axis) in enumerate(zip(receivers, axes, strict=True)):
        pair = Multistatic(Antenna(PLAIN, TX), Antenna(PLAIN, place, axis))
        z[0, m, 0] = *pair.measure(state)[0], pair.directions(state[:2])[0]
    return z, np.ones((1, 2), np.int64)


@pytest.mark.parametrize("error_snr", ["mean", "realised"])
@pytest.mark.parametrize("place", [(2000.0, 1540.0), (2085.0, 1520.0), (2150.0, 1505.0)])
def test_with_directions_a_track_starts_at_its_target_alone(place, error_snr):
    """Two orthogonal arrays leave one position, and its covariance is that of all measured quantities together."""
    state = np.array([*place, 3.0, -2.0])
    tracker = UrbanTracker(PLAIN, (TX,), RX, axes=AXES, stay=0.97, vaguest=8.0, error_snr=error_snr)
    tracks = tracker.scan(tracker.empty(1), *pointed(state), R, SNR)
    (slot,) = np.flatnonzero(tracks.status[0])
    x, P = (leaf[0, slot] for leaf in tracks.combined())
    np.testing.assert_allclose(x[:2], place, atol=0.05)
    information = np.diag([0.0, 0.0, 1e-2, 1e-2])
    for m in range(2):
        eta = snr_of_covariances(error_snr, SNR * (100.0 / multistatic_range_and_rate(state, TX, RX[m])[0]) ** 4)
        variances = np.array([R[0, 0] / eta, R[1, 1] / eta + 0.01, 12.0 / (np.pi**2 * 8.0 * eta)])
        H = np.stack(
            [(pointed(x[:4] + s)[0] - pointed(x[:4] - s)[0])[0, m, 0] / 2e-4 for s in 1e-4 * np.eye(4)], axis=1
        )
        information += H.T @ (H / variances[:, None])
    np.testing.assert_allclose(P[:4, :4], np.linalg.inv(information), rtol=0.02, atol=1e-3)


def test_arrays_on_the_line_of_the_antennas_cannot_tell_left_from_right():
    """Arrays along the line keep both hypotheses; turned by 90 degrees one is left."""
    wide = UrbanMap(roads=(Road(((1900.0, 1470.0), (2200.0, 1470.0)), 200.0),))
    state = np.array([2040.0, 1530.0, 3.0, 4.0])
    for axes, wanted in ((((1.0, 0.0),) * 2, 2), (AXES, 1)):
        tracker = UrbanTracker(wide, (TX,), IN_LINE, axes=axes)
        tracks = tracker.scan(tracker.empty(1), *pointed(state, IN_LINE, axes), R, SNR)
        places = tracks.x[0, tracks.status[0] != EMPTY, 0, :2]
        assert len(places) == wanted
        assert np.abs(places - state[:2]).sum(axis=1).min() < 0.1
        if wanted == 2:
            assert np.abs(places - [2040.0, 2 * 1470.5 - 1530.0]).sum(axis=1).min() < 0.1


def test_a_measurement_of_larger_covariance_counts_less():
    """One scan with the covariances doubled is the update with R doubled."""
    state = np.array([2060.0, 1540.0, 3.0, 4.0])
    z, count = pointed(np.array([2061.0, 1540.5, 3.0, 4.0]))
    tracker = UrbanTracker(PLAIN, (TX,), RX, axes=AXES, clutter_density=1e-9, rate_floor=1e-6, error_snr="mean")
    waves = np.tile(R, (1, 2, 1, 1)), np.full((1, 2), SNR)
    given = tracker.direct_errors(z, count, *waves)
    plain, doubled = (tracker.scan(held(tracker, state), z, count, R, SNR, k * given) for k in (1.0, 2.0))
    assert np.trace(doubled.P[0, 0, 0]) > np.trace(plain.P[0, 0, 0])
    half = tracker.scan(held(tracker, state), z, count, R, SNR / 2.0)
    np.testing.assert_allclose(doubled.x[0, 0, 0], half.x[0, 0, 0], atol=1e-6)
    np.testing.assert_allclose(doubled.P[0, 0, 0], half.P[0, 0, 0], atol=1e-6)
