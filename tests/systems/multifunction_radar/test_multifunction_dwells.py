"""Dwells of the multifunction radar: existence by Bayes's rule, the intensity of undetected targets, cost."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from wavegym.systems.multifunction_radar import beam_kernels as beams
from wavegym.systems.multifunction_radar import dwell_kernels as dwells
from wavegym.systems.multifunction_radar import track_kernels as tracks

WIDTH = np.radians(1.0)
BEAM = beams.Beam(WIDTH, 40e3, 10e-3, 90.0, WIDTH / 1.6, 150.0, 5e3, 40e3, 25.0)
MODES = tracks.Modes((10.0, 2000.0), (0.05, 0.2))
AREA = dwells.Area(np.pi / 3, 5e3, 40e3, 10, 1e-8, 0.012, 500.0, 0.05, 200.0, 1.0)
SEARCH, TRACK, MOST = -np.log(1e-4), -np.log(1e-6), 2.5e5
PLACE = (15e3, 0.3)  # of the track: range and azimuth
COVERS = np.array([beams.coverage(5e3 + (b + 0.5) * 5e3, 17e-3, SEARCH, BEAM) for b in range(7)])


def scene(x=None):
    """Truth as dwells read it: one target or none."""
    here = np.array([x is not None])
    return BEAM, np.zeros((1, 4)) if x is None else x, here, 0.0, np.full(4, -1)


def empty(count=4):
    return tracks.Slots(
        np.zeros(count), np.zeros((count, 2, 4)), np.zeros((count, 2, 4, 4)), np.full((count, 2), 0.5),
        np.zeros(count), np.zeros((count, 10))
    )  # fmt: skip


def one_track(existence=0.6):
    slots = empty()
    tracks.begin_slot(0, 0.0, slots, MODES, *PLACE, np.array([200.0, 4e-6]), 50.0)
    slots.existence[0] = existence
    return slots


def findings(*rows):
    found = np.array([(*row, 0.0) for row in rows], np.float64).reshape(-1, 4)
    return len(found), found, np.zeros(len(found), np.bool_)


def look(slots, given, pointing=None):
    pointing = dwells.azimuth_of(0, 0.5, slots)[0] if pointing is None else pointing
    return dwells.look_for(0, 0.5, slots, pointing, 10e-3, TRACK, MODES, BEAM, given)


def at_half_a_second(slots):
    x, P, mu = np.empty((2, 4)), np.empty((2, 4, 4)), np.empty((1, 2))
    mean, covariance = np.empty((1, 4)), np.empty((1, 4, 4))
    tracks.predict_slot(0, 0.5, slots, MODES, x, P, mu, mean, covariance)
    return mean[0], covariance[0]


def seen_from_the_radar(covariance):
    s, c = np.sin(PLACE[1]), np.cos(PLACE[1])
    H = np.array([[s, 0, c, 0], [c / PLACE[0], 0, -s / PLACE[0], 0]])
    return H @ covariance @ H.T


def test_a_missed_track_exists_less_and_its_azimuth_widens():
    slots = one_track()
    before = seen_from_the_radar(at_half_a_second(slots)[1])
    pd, ratio = beams.expected_detection(PLACE[0], 0.0, before[1, 1], 10e-3, TRACK, BEAM)
    look(slots, findings())
    assert slots.existence[0] == pytest.approx(0.6 * (1 - pd) / (1 - 0.6 * pd), rel=1e-9)
    after = seen_from_the_radar(np.einsum("j,jab->ab", slots.probability[0], slots.covariance[0]))
    assert ratio > 1.0
    assert after[1, 1] == pytest.approx(ratio * before[1, 1], rel=1e-9)
    assert after[0, 0] == pytest.approx(before[0, 0], rel=1e-6)


def test_a_found_track_exists_by_bayes():
    """Likelihoods of the finding: of the target, with Pd and the innovation's density, against a false alarm's."""
    slots = one_track()
    covariance = seen_from_the_radar(at_half_a_second(slots)[1])
    z, y = 20.0, np.array([12.0, -1e-3])
    R = np.diag([90.0**2, (WIDTH / 1.6) ** 2]) * 0.5 / z
    pd = beams.expected_detection(PLACE[0], 0.0, covariance[1, 1], 10e-3, TRACK, BEAM)[0]
    false = 1e-6 / (150.0 * WIDTH)
    odds = 0.6 / 0.4 * (1 - pd + pd * multivariate_normal(np.zeros(2), covariance + R).pdf(y) / false)
    given = findings([PLACE[0] + 5e3, PLACE[1], z], [PLACE[0] + y[0], PLACE[1] + y[1], z])
    look(slots, given)
    assert slots.existence[0] == pytest.approx(odds / (1 + odds), rel=1e-9)
    np.testing.assert_array_equal(given[2], [False, True])
    assert slots.time[0] == 0.5


def test_a_search_beam_knows_its_axis():
    slots = one_track()
    variance = seen_from_the_radar(at_half_a_second(slots)[1])[1, 1]
    pd, _ = beams.expected_detection(PLACE[0], 0.4 * WIDTH, variance, 10e-3, TRACK, BEAM)
    assert look(slots, findings(), pointing=PLACE[1] - 0.4 * WIDTH) == -1
    assert slots.existence[0] == pytest.approx(0.6 * (1 - pd) / (1 - 0.6 * pd), rel=1e-6)


def test_undetected_targets_are_neither_made_nor_lost_inside():
    """Their number changes by the flow over the edges alone, to the rounding of a sum."""
    undetected = np.random.default_rng(0).random((12, 7))
    usual = np.array([dwells.usual_number(b, (12, 7), AREA) for b in range(-1, 8)])
    r = 5e3 + (np.arange(7) + 0.5) * 5e3
    flow = AREA.radial * (12 * (usual[0] + usual[-1]) - (undetected[:, 0] + undetected[:, -1]).sum())
    flow += (AREA.lateral / r * (2 * usual[1:-1] - undetected[0] - undetected[-1])).sum()
    before = undetected.sum()
    dwells.drift(undetected, 0.01, AREA, np.empty_like(undetected))
    assert undetected.sum() - before == pytest.approx(0.01 * flow, rel=1e-9)


def test_where_nobody_looks_the_undetected_are_the_traffic():
    """Uniform in the plane, and steady: what leaves over the edges comes over the edges."""
    usual = np.array([dwells.usual_number(b, (12, 7), AREA) for b in range(7)])
    assert usual.sum() * 12 == pytest.approx(AREA.traffic * np.pi / 3 * (40e3**2 - 5e3**2), rel=1e-12)
    undetected = np.tile(usual, (12, 1))
    dwells.drift(undetected, 0.01, AREA, np.empty_like(undetected))
    np.testing.assert_allclose(undetected, np.tile(usual, (12, 1)), rtol=1e-12)
    undetected[:] = 0.0
    for _ in range(200_000):
        dwells.drift(undetected, 0.05, AREA, np.empty_like(undetected))
    np.testing.assert_allclose(undetected, np.tile(usual, (12, 1)), rtol=1e-6)


def test_the_beams_tile_the_region():
    """120 beams side by side: each points at the middle of its 120th part."""
    axes = [dwells.axis_of(sector, turn, 12, AREA) for sector in range(12) for turn in range(10)]
    np.testing.assert_allclose(axes, -np.pi / 3 + (np.arange(120) + 0.5) * (2.0 * np.pi / 3 / 120), rtol=1e-12)


def test_an_empty_search_thins_the_undetected_of_its_sector():
    slots, undetected = empty(), np.full((12, 7), 0.1)
    found = np.empty((9, 4))
    key = next(k for k in map(np.uint64, range(99)) if beams.false_alarms(k, 0, 5e3, 4e4, SEARCH, BEAM, found, 0) == 0)
    dwells.search(0.5, slots, 4, 3, undetected, scene(), key, 17e-3, COVERS, (SEARCH, MODES, BEAM, AREA))
    np.testing.assert_allclose(undetected[4], 0.1 * (1 - COVERS / 10), rtol=1e-12)
    assert (np.delete(undetected, 4, axis=0) == 0.1).all()
    assert not slots.existence.any()


def test_search_begins_a_track_of_a_target_and_update_confirms_it():
    slots, undetected = empty(), np.full((12, 7), 0.1)
    axis = -np.pi / 3 + (4 + 0.35) * np.radians(10.0)
    x = np.array([[8e3 * np.sin(axis), 100.0, 8e3 * np.cos(axis), 0.0]])
    truth = scene(x)
    dwells.search(0.5, slots, 4, 3, undetected, truth, np.uint64(2), 17e-3, COVERS, (SEARCH, MODES, BEAM, AREA))
    assert (slots.existence > 0).sum() == 1
    k = int(np.argmax(slots.existence))
    expected = 0.1 / 10 * COVERS[0] / (5e3 * WIDTH)
    assert slots.existence[k] == pytest.approx(expected / (expected + 1e-4 / (150.0 * WIDTH)), rel=1e-9)
    assert truth[4][k] == 0
    dwells.update(0.6, slots, k, truth, np.uint64(3), 10e-3, (TRACK, MODES, BEAM, AREA))
    assert slots.existence[k] > 0.999
    assert abs(slots.probability[k] @ slots.mean[k][:, 0] - x[0, 0]) < 100.0


def test_dropped_tracks_are_undetected_again():
    slots, undetected = one_track(0.03), np.zeros((12, 7))
    dwells.drop_tracks(0.1, slots, undetected, MODES, MOST, AREA)
    assert slots.existence[0] == 0.0
    assert undetected[int((PLACE[1] + np.pi / 3) / np.radians(10.0)), 2] == pytest.approx(0.03, rel=1e-12)
    gone = one_track(0.9)
    gone.mean[0, :, 2] += 50e3
    dwells.drop_tracks(0.1, gone, undetected, MODES, MOST, AREA)
    assert gone.existence[0] == 0.0
    assert undetected.sum() == pytest.approx(0.03, rel=1e-12)  # what leaves the region is not undetected
    wide = one_track(0.9)
    wide.moments[0, 2] = 4.1 * MOST
    dwells.drop_tracks(0.0, wide, undetected, MODES, MOST, AREA)
    assert wide.existence[0] == 0.0
    assert undetected.sum() == pytest.approx(0.93, rel=1e-12)


@pytest.mark.parametrize("existence", [0.2, 0.6, 1.0])
@pytest.mark.parametrize("seconds", [0.5, 1e4])
def test_cost_is_the_expected_gospa_of_the_best_report(existence, seconds):
    """By Monte Carlo of existence: the lower of two costs, with and without a report of the track."""
    slots = one_track(existence)
    trace = sum(tracks.spread_at(slots.moments[0], MODES, seconds)[::2])
    there = np.random.default_rng(0).random(400_000) < existence
    reported, silent = np.where(there, trace, MOST).mean(), np.where(there, MOST, 0.0).mean()
    rates = dwells.rates_of_cost(seconds, slots, MODES, MOST, AREA)
    assert rates[existence == 1.0] == pytest.approx(min(reported, silent), rel=5e-3)
    assert rates[existence != 1.0] == 0.0
