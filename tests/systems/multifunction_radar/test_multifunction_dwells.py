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
AREA = dwells.Area(np.pi / 3, 5e3, 40e3, 10, 0.01, 0.012, 500.0, 0.05, 200.0)
SEARCH, TRACK, MOST = -np.log(1e-4), -np.log(1e-6), 2.5e5
PLACE = (15e3, 0.3)  # of the track: range and azimuth
NOBODY = (np.zeros((1, 4)), np.zeros(1, np.bool_), 0.0)


def empty(count=4):
    return tracks.Slots(
        np.zeros(count), np.zeros((count, 2, 4)), np.zeros((count, 2, 4, 4)), np.full((count, 2), 0.5),
        np.zeros(count), np.zeros((count, 4))
    )  # fmt: skip


def one_track(existence=0.6):
    slots = empty()
    tracks.begin_slot(0, 0.0, slots, MODES, *PLACE, np.array([200.0, 4e-6]), 50.0)
    slots.existence[0] = existence
    return slots


def findings(*rows):
    found = np.array(rows, np.float64).reshape(-1, 3)
    return len(found), found, np.zeros(len(found), np.bool_)


def look(slots, given, pointing=np.nan):
    dwells.look_for(0, 0.5, slots, pointing, 10e-3, TRACK, MODES, BEAM, given)


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
    pd, ratio = beams.expected_detection(PLACE[0], before[1, 1], 10e-3, TRACK, BEAM)
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
    pd = beams.expected_detection(PLACE[0], covariance[1, 1], 10e-3, TRACK, BEAM)[0]
    false = 1e-6 / (150.0 * WIDTH)
    odds = 0.6 / 0.4 * (1 - pd + pd * multivariate_normal(np.zeros(2), covariance + R).pdf(y) / false)
    given = findings([PLACE[0] + 5e3, PLACE[1], z], [PLACE[0] + y[0], PLACE[1] + y[1], z])
    look(slots, given)
    assert slots.existence[0] == pytest.approx(odds / (1 + odds), rel=1e-9)
    np.testing.assert_array_equal(given[2], [False, True])
    assert slots.time[0] == 0.5


def test_a_search_beam_knows_its_axis():
    slots = one_track()
    pd = beams.detection(beams.energy(PLACE[0], 0.4 * WIDTH, 10e-3, BEAM), TRACK)
    look(slots, findings(), pointing=PLACE[1] - 0.4 * WIDTH)
    assert slots.existence[0] == pytest.approx(0.6 * (1 - pd) / (1 - 0.6 * pd), rel=1e-6)


def test_undetected_targets_are_neither_made_nor_lost_inside():
    """Their number changes by the births and by the flow over the edges, to the rounding of a sum."""
    undetected = np.random.default_rng(0).random((12, 7))
    r = 5e3 + (np.arange(7) + 0.5) * 5e3
    out = AREA.radial * (undetected[:, 0] + undetected[:, -1]).sum()
    out += (AREA.lateral / r * (undetected[0] + undetected[-1])).sum()
    before = undetected.sum()
    dwells.drift(undetected, 0.01, AREA, np.empty_like(undetected))
    assert undetected.sum() - before == pytest.approx(0.01 * (12 * AREA.births - out), rel=1e-9)


def test_an_empty_search_thins_the_undetected_of_its_sector():
    slots, undetected = empty(), np.full((12, 7), 0.1)
    found = np.empty((9, 3))
    key = next(k for k in map(np.uint64, range(99)) if beams.false_alarms(k, 0, 5e3, 4e4, SEARCH, BEAM, found, 0) == 0)
    dwells.search(0.5, slots, 4, 3, undetected, NOBODY, key, 17e-3, (SEARCH, MODES, BEAM, AREA))
    r = 5e3 + (np.arange(7) + 0.5) * 5e3
    pd = np.exp(-SEARCH / (1 + (40e3 / r) ** 4 * 1.7))
    np.testing.assert_allclose(undetected[4], 0.1 * (1 - pd / 10), rtol=1e-12)
    assert (np.delete(undetected, 4, axis=0) == 0.1).all()
    assert not slots.existence.any()


def test_search_begins_a_track_of_a_target_and_update_confirms_it():
    slots, undetected = empty(), np.full((12, 7), 0.1)
    axis = -np.pi / 3 + (4 + 0.35) * np.radians(10.0)
    x = np.array([[8e3 * np.sin(axis), 100.0, 8e3 * np.cos(axis), 0.0]])
    truth = (x, np.ones(1, np.bool_), 0.0)
    dwells.search(0.5, slots, 4, 3, undetected, truth, np.uint64(2), 17e-3, (SEARCH, MODES, BEAM, AREA))
    assert (slots.existence > 0).sum() == 1
    k = int(np.argmax(slots.existence))
    pd = float(beams.detection(beams.energy(8e3, 0.0, 17e-3, BEAM), SEARCH))
    expected = 0.1 / 10 * pd / (5e3 * WIDTH)
    assert slots.existence[k] == pytest.approx(expected / (expected + 1e-4 / (150.0 * WIDTH)), rel=0.05)
    dwells.update(0.6, slots, k, truth, np.uint64(3), 10e-3, (TRACK, MODES, BEAM, AREA))
    assert slots.existence[k] > 0.999
    assert abs(slots.probability[k] @ slots.mean[k][:, 0] - x[0, 0]) < 100.0


def test_dropped_tracks_are_undetected_again():
    slots, undetected = one_track(0.03), np.zeros((12, 7))
    dwells.drop_tracks(0.1, slots, undetected, AREA)
    assert slots.existence[0] == 0.0
    assert undetected[int((PLACE[1] + np.pi / 3) / np.radians(10.0)), 2] == pytest.approx(0.03, rel=1e-12)
    gone = one_track(0.9)
    gone.mean[0, :, 2] += 50e3
    dwells.drop_tracks(0.1, gone, undetected, AREA)
    assert gone.existence[0] == 0.0
    assert undetected.sum() == pytest.approx(0.03, rel=1e-12)  # what leaves the region is not undetected


def test_cost_is_bounded_for_each_target():
    """A precise track costs its trace, a lost one c0, an uncertain one between, an undetected target c0."""
    slots, undetected = one_track(0.6), np.full((12, 7), 0.01)
    p, c, v, q = slots.moments[0]
    now = 0.6 * tracks.trace_at(p, c, v, q, MODES, 0.5) + 0.4 * MOST + 0.84 * MOST
    assert dwells.rate_of_cost(0.5, slots, undetected, MODES, MOST) == pytest.approx(now, rel=1e-12)
    assert dwells.rate_of_cost(1e4, slots, undetected, MODES, MOST) == pytest.approx(1.84 * MOST, rel=1e-12)
