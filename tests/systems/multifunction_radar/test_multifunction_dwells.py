"""Dwells of the multifunction radar: existence by Bayes's rule, the intensity of undetected targets, cost."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import gamma, multivariate_normal, norm

from wavegym.sensors.trains import acceleration_loss
from wavegym.systems.multifunction_radar import area_kernels as areas
from wavegym.systems.multifunction_radar import beam_kernels as beams
from wavegym.systems.multifunction_radar import dwell_kernels as dwells
from wavegym.systems.multifunction_radar import flight_kernels as targets
from wavegym.systems.multifunction_radar import track_kernels as tracks

WIDTH = np.sin(np.radians(1.0))
KEPT = acceleration_loss(1.0, 1.0, beams.FINEST * np.arange(400))
BEAM = beams.Beam(WIDTH, 40e3, 94.0, 80.0, KEPT, np.array([0.3, 1.0]), 5e3, 40e3, 25.0)
MODES = tracks.Modes((10.0, 2000.0), (0.05, 0.2))
FIRST = np.arange(0, 101, 10)  # ten sectors of ten beams
EDGES = np.sin(np.pi / 3) * np.linspace(-1, 1, 101)
AREA = areas.Area(np.pi / 3, 5e3, 40e3, FIRST, EDGES, np.diff(np.arcsin(EDGES)), 1e-8, 0.012, 500.0, 0.05, 200.0, 1.0)
MOST = 2.5e5
LAWS = dwells.Laws(MODES, BEAM, AREA, MOST)
LOOK = beams.Look(1, 1.7, 14.0, 64 / 150.0, 0.7, 0.008, np.array([1.0, 0.9]))
PLACE = (15e3, np.sin(0.3))  # of the track: range and sine of the azimuth
COVERS = np.linspace(0.3, 0.01, 42).reshape(3, 7, 2)


def scene(x=None):
    """Truth as dwells read it: one target or none."""
    x = np.zeros((1, 4)) if x is None else x
    here, none = np.array([x.any()]), np.zeros(1, np.int64)
    flying = targets.Flying(x, np.zeros((1, 2)), none, here)
    return dwells.Scene(BEAM, flying, np.ones(1, np.int64), 0.0, np.uint64(2), none.copy(), np.full(4, -1))


def empty(count=4):
    return tracks.Slots(
        np.zeros(count), np.zeros((count, 2, 4)), np.zeros((count, 2, 4, 4)), np.full((count, 2), 0.5),
        np.zeros(count), np.full((count, 2), 0.5), np.zeros((count, 10))
    )  # fmt: skip


def one_track(existence=0.6, variance=(200.0, 4e-6)):
    slots = empty()
    tracks.begin_slot(0, 0.0, slots, MODES, *PLACE, np.array(variance), 50.0)
    slots.existence[0], slots.section[0] = existence, (0.7, 0.3)
    return slots


def findings(*rows):
    found = np.array([(*row, 0.0) for row in rows], np.float64).reshape(-1, 5)
    return dwells.Findings(len(found), found, np.zeros(len(found), np.bool_))


def look(slots, given, axis=PLACE[1], laws=LAWS):
    return dwells.look_for(0, 0.5, slots, axis, LOOK, laws, given)


def strength(kept, axis=PLACE[1]):
    """S on the axis of both classes, by the radar equation."""
    return kept * 1.7 * (40e3 / PLACE[0]) ** 4 * (1 - axis**2) ** 1.5 * np.array([0.3, 1.0])


def at_half_a_second(slots):
    x, P, mu = np.empty((2, 4)), np.empty((2, 4, 4)), np.empty((1, 2))
    mean, covariance = np.empty((1, 4)), np.empty((1, 4, 4))
    tracks.predict_slot(0, 0.5, slots, MODES, x, P, mu, mean, covariance)
    return mean[0], covariance[0]


def gradients(x):
    px, vx, py, vy = x
    r = np.hypot(px, py)
    s, c = px / r, py / r
    across = (c * vx - s * vy) / r
    return np.array([[s, 0, c, 0], [c * c / r, 0, -s * c / r, 0], [c * across, s, -s * across, c]])


def seen_from_the_radar(mean, covariance):
    H = gradients(mean)
    return H @ covariance @ H.T


def kept_by(slots):
    """Mean share of the energy kept, over the modes half a second later."""
    gone = 1 - np.exp(-0.25 * 0.5)
    second = slots.probability[0, 1] * (1 - 0.8 * gone) + slots.probability[0, 0] * 0.2 * gone
    return 1.0 - 0.1 * second


@pytest.mark.parametrize("off", [0.0, 0.4])
def test_a_missed_track_exists_less_its_azimuth_widens_and_it_is_probably_smaller(off):
    slots = one_track()
    mean, covariance = at_half_a_second(slots)
    before, axis = seen_from_the_radar(mean, covariance), PLACE[1] - off * WIDTH
    S = strength(kept_by(slots), axis)
    each = [beams.expected_detection(one, off, before[1, 1] / WIDTH**2, LOOK) for one in S]
    pd, square = np.array([0.7, 0.3]) @ np.array(each)
    assert look(slots, findings(), axis) == -1
    assert slots.existence[0] == pytest.approx(0.6 * (1 - pd) / (1 - 0.6 * pd), rel=1e-6)
    np.testing.assert_allclose(slots.section[0] / [0.7, 0.3], (1 - np.array(each)[:, 0]) / (1 - pd), rtol=1e-6)
    after = seen_from_the_radar(mean, np.einsum("j,jab->ab", slots.probability[0], slots.covariance[0]))
    ratio = (1 - square) / (1 - pd)
    assert after[1, 1] == pytest.approx(ratio * before[1, 1], rel=2e-3)
    assert after[0, 0] == pytest.approx(before[0, 0], rel=1e-3)


def test_no_track_is_so_sure_that_it_outlives_misses_of_a_strong_echo():
    """Many detections round the probability of existence to 1, where the rule of Bayes ends."""
    slots, laws = one_track(1.0, variance=(20.0, 1e-8)), LAWS._replace(beam=BEAM._replace(reference=700e3))
    for _ in range(3):
        assert look(slots, findings(), PLACE[1], laws=laws) == -1
    assert slots.existence[0] < 0.05


@pytest.mark.parametrize(("fold", "n"), [(80.0, 2), (800.0, 3)])
def test_a_found_track_exists_by_bayes(fold, n):
    """Densities of power, place and, where the fold is known, range-rate: of the target against a false alarm's.

    The beam's loss is averaged over the pointing error before the rule of Bayes, in the code as here.
    """
    slots, laws = one_track(1e-20), LAWS._replace(beam=BEAM._replace(fold=fold))
    gone, first = 1 - np.exp(-0.25 * 0.5), slots.probability[0].copy()
    mu = first + gone * (np.array([0.8, 0.2]) - first)
    x, P, _ = plain_modes(slots)
    mean, covariance = at_half_a_second(slots)
    z, y = 60.0, np.array([12.0, 6e-4, 0.3])
    h = np.array([np.hypot(mean[0], mean[2]), PLACE[1], (mean[0] * mean[1] + mean[2] * mean[3]) / PLACE[0]])
    spread = seen_from_the_radar(mean, covariance)[1, 1] / WIDTH**2
    lost = 1 / np.sqrt(1 + 16 * np.log(2) * spread)
    S = strength(1.0 - 0.1 * mu[1]) * lost
    likelihood = gamma.pdf(z, 1, scale=1 + S)
    section = np.array([0.7, 0.3]) * likelihood
    seen = section / section.sum() @ (S / (1 + S))
    R = np.diag([94.0**2, (WIDTH / 1.6) ** 2 * (1 + 1.6**2 * spread * seen), 0.7**2]) * 0.5 / z
    density = 0.0
    for j in range(2):
        H = gradients(x[j]) * np.array([1.0, seen, 1.0])[:, None]
        innovation = (H @ P[j] @ H.T + R)[:n, :n]
        density += mu[j] * multivariate_normal(np.zeros(n), innovation).pdf(y[:n])
    offset = y[1] / WIDTH
    false = 64 / 150.0 * gamma.pdf(z, 1) * norm.pdf(offset, scale=1 / (1.6 * np.sqrt(2 * z))) / WIDTH
    false /= fold if n == 3 else 1.0
    pd = np.array([0.7, 0.3]) @ [beams.expected_detection(s, 0.0, spread, LOOK)[0] for s in S / lost]
    odds = 1e-20 * (1 - pd + section.sum() * density / false)
    far = [PLACE[0] + 5e3, PLACE[1], 0.0, z]
    given = findings(far, [h[0] + y[0], h[1] + y[1], h[2] + y[2] + 2 * fold, z])
    assert look(slots, given, laws=laws) == 1
    np.testing.assert_array_equal(given.used, [False, True])
    assert (1 - slots.existence[0]) * odds == pytest.approx(slots.existence[0], rel=1e-6)
    np.testing.assert_allclose(slots.section[0], section / section.sum(), rtol=1e-9)
    assert slots.time[0] == 0.5


def plain_modes(slots):
    """x (m, n), P (m, n, n) and mu (1, m) half a second later."""
    x, P, mu = np.empty((2, 4)), np.empty((2, 4, 4)), np.empty((1, 2))
    mean, covariance = np.empty((1, 4)), np.empty((1, 4, 4))
    tracks.predict_slot(0, 0.5, slots, MODES, x, P, mu, mean, covariance)
    return x, P, mu


@pytest.mark.parametrize("reference", [40e3, 700e3])  # the second one detects all but certainly
def test_probabilities_stay_probabilities_over_many_looks(reference):
    """Where rounding would take one beyond 1, the rule of Bayes runs away."""
    slots, rng = one_track(1.0, variance=(20.0, 1e-8)), np.random.default_rng(0)
    laws = LAWS._replace(beam=BEAM._replace(reference=reference))
    for _ in range(300):
        if rng.random() < 0.5:
            look(slots, findings([PLACE[0], PLACE[1], 0.0, 14.0 + 60.0 * rng.exponential()]), laws=laws)
        else:
            look(slots, findings(), laws=laws)
        assert 0.0 <= slots.existence[0] <= 1.0
        assert slots.section[0].min() >= 0.0
        assert abs(slots.section[0].sum() - 1.0) <= 2.0 * np.finfo(float).eps


@pytest.mark.parametrize(("seconds", "usable"), [(0.02, 3), (0.3, 2)])
def test_a_range_rate_is_used_only_where_no_mode_may_be_a_fold_away(seconds, usable):
    """A calm track that is known to 2 m/s: in 0.3 s only a hard turn, of probability 0.03, could take it so far."""
    slots = one_track(1.0)
    P, mu = slots.covariance[0].copy(), np.array([[0.97, 0.03]])
    P[:, [1, 3], :], P[:, :, [1, 3]] = 0.0, 0.0
    P[:, [1, 3], [1, 3]] = 4.0
    tracks.keep_slot(0, 0.0, slots, MODES, slots.mean[0].copy(), P, mu)
    made = dwells.predicted(0, seconds, slots, MODES)
    toward = made.H[tracks.RATE]
    sd = np.sqrt([toward @ made.P[j] @ toward for j in range(2)])
    assert 2.0 * norm.sf(0.5 * BEAM.fold / sd[0]) < 1e-6
    away = made.mu[0] @ (2.0 * norm.sf(0.5 * BEAM.fold / sd))
    assert (away <= dwells.ANOTHER_FOLD) == (usable == 3)
    assert dwells.usable(made, BEAM) == usable


def test_powers_teach_the_class_of_cross_section():
    """Over repeated looks at simulated echoes of either class, its probability rises to nearly one."""
    for true in range(2):
        slots, rng = one_track(1.0, variance=(20.0, 1e-8)), np.random.default_rng(true)
        for _ in range(400):
            S = strength(1.0)[true]
            z = LOOK.threshold + rng.exponential(1 + S)
            if rng.random() < np.exp(-LOOK.threshold / (1 + S)):
                look(slots, findings([PLACE[0], PLACE[1], 0.0, z]))
            else:
                look(slots, findings())
        assert slots.section[0, true] > 1.0 - 2.0 * dwells.RARE  # a rarer class is not followed


def test_a_new_track_is_the_posterior_of_offset_and_class():
    """Against the mean, spread and classes of drawn targets that gave nearly the measured power and offset."""
    rng, count = np.random.default_rng(0), 3_000_000
    off, section = rng.uniform(-1, 1, count), rng.integers(0, 2, count)
    S = strength(0.98, areas.axis_of(65, AREA))[section] * np.exp(-8 * np.log(2) * off**2)
    z = (1 + S) * rng.exponential(size=count)
    seen = S / (1 + S)
    m = off * seen + rng.standard_normal(count) * np.sqrt((1 + (1.6 * off) ** 2 * seen) / (2 * z)) / 1.6
    near = (np.abs(z - 40.0) < 3.0) & (np.abs(m - 0.35) < 0.03)
    beam = 65
    axis = areas.axis_of(beam, AREA)
    undetected, slots = np.full((100, 7, 2), 1e-17), empty()  # as rare as a false alarm of such power
    given = findings([PLACE[0], axis + 0.35 * WIDTH, 0.0, 40.0])
    dwells.begin_tracks(0.0, slots, given, beam, undetected, np.full(4, -1), LOOK, LAWS)
    got = (slots.mean[0, 0, 0] / np.hypot(*slots.mean[0, 0, ::2]) - axis) / WIDTH
    spread = seen_from_the_radar(slots.mean[0, 0], slots.covariance[0, 0])[1, 1] / WIDTH**2
    many = near.sum()
    assert many > 1000
    assert abs(got - off[near].mean()) < 5 * off[near].std() / np.sqrt(many)
    assert spread == pytest.approx(off[near].var(), rel=0.1)
    assert abs(slots.section[0, 1] - section[near].mean()) < 5 * 0.5 / np.sqrt(many)
    drawn = 1e-17 / 5e3 * WIDTH / np.diff(EDGES)[0] * 2 * 2 * near.mean()  # each metre, over two classes and widths
    false = 64 / 150.0 * 6.0 * gamma.pdf(40.0, 1)  # within 3 of the power, and 0.03 of the offset
    false *= 0.06 * norm.pdf(0.35, scale=1 / (1.6 * np.sqrt(80.0)))
    assert 0.1 < slots.existence[0] < 0.9
    assert slots.existence[0] / (1.0 - slots.existence[0]) == pytest.approx(drawn / false, rel=0.15)


USUAL = np.array([[areas.usual_number(i, b, (100, 7, 2), AREA) for b in range(-1, 8)] for i in range(100)])


def test_undetected_targets_are_neither_made_nor_lost_inside():
    """Their number changes by the flow over the edges alone, to the rounding of a sum."""
    undetected = np.random.default_rng(0).random((100, 7, 2))
    r = 5e3 + (np.arange(7) + 0.5) * 5e3
    flow = AREA.radial * (2 * USUAL[:, [0, -1]].sum() - undetected[:, [0, -1]].sum())
    for i in (0, -1):
        flow += (AREA.lateral / r / AREA.angle[i] * (2 * USUAL[i, 1:-1] - undetected[i].sum(axis=1))).sum()
    before = undetected.sum()
    areas.drift(undetected, 0.01, AREA, np.empty_like(undetected))
    assert undetected.sum() - before == pytest.approx(0.01 * flow, rel=1e-9)


def test_where_nobody_looks_the_undetected_are_the_traffic():
    """Uniform in the plane, and steady: what leaves over the edges comes over the edges."""
    usual = np.repeat(USUAL[:, 1:-1, None], 2, axis=2)
    assert usual.sum() == pytest.approx(AREA.traffic * np.pi / 3 * (40e3**2 - 5e3**2), rel=1e-12)
    undetected = usual.copy()
    areas.drift(undetected, 0.01, AREA, np.empty_like(undetected))
    np.testing.assert_allclose(undetected, usual, rtol=1e-12)
    edges = EDGES[::10]
    wide = AREA._replace(first=FIRST[:2], edges=edges, angle=np.diff(np.arcsin(edges)))
    usual = np.array([[[areas.usual_number(i, b, (10, 7, 2), wide)] * 2 for b in range(7)] for i in range(10)])
    undetected = np.zeros((10, 7, 2))
    for _ in range(200):
        areas.drift(undetected, 30.0, wide, np.empty_like(undetected))
    np.testing.assert_allclose(undetected, usual, rtol=1e-6)


def test_the_beams_tile_the_region_and_a_sector_takes_its_beams_in_turn():
    axes = np.array([areas.axis_of(i, AREA) for i in range(100)])
    np.testing.assert_allclose(np.diff(axes), np.sin(np.pi / 3) / 50, rtol=1e-9)
    assert [areas.beam_of(sine, AREA) for sine in axes] == list(range(100))
    assert areas.beam_of(-1.0, AREA) == 0
    assert areas.beam_of(1.0, AREA) == 99
    assert areas.next_beam(3, 4, AREA) == 34
    assert [areas.next_turn(3, turn, AREA) for turn in (0, 8, 9)] == [1, 9, 0]


@pytest.mark.parametrize("i", [0, 43, 99])
def test_an_empty_search_thins_the_undetected_in_and_beside_its_beam(i):
    slots, undetected = empty(), np.full((100, 7, 2), 0.1)
    found = np.empty((9, 5))
    key = next(k for k in map(np.uint64, range(99)) if beams.false_alarms(k, 0.0, LOOK, BEAM, found, 0) == 0)
    dwells.search(0.5, slots, i, undetected, scene(), key, LOOK, COVERS, LAWS)
    want = np.full((102, 7, 2), 0.1)
    want[i : i + 3] *= 1 - COVERS
    np.testing.assert_allclose(undetected, want[1:-1], rtol=1e-12)
    assert not slots.existence.any()


def test_search_begins_a_track_of_a_target_and_update_confirms_it():
    slots, undetected = empty(), np.full((100, 7, 2), 0.1)
    s = areas.axis_of(43, AREA) + 0.2 * WIDTH
    x = np.array([[8e3 * s, 100.0, 8e3 * np.sqrt(1 - s * s), 0.0]])
    truth = scene(x)
    dwells.search(0.5, slots, 43, undetected, truth, np.uint64(2), LOOK, COVERS, LAWS)
    assert (slots.existence > 0).sum() == 1
    k = int(np.argmax(slots.existence))
    assert truth.origin[k] == 0
    assert truth.looks[0] == 1
    dwells.update(0.6, slots, k, truth, np.uint64(3), LOOK, LAWS)
    assert slots.existence[k] > 0.999
    assert abs(slots.probability[k] @ slots.mean[k][:, 0] - x[0, 0]) < 100.0


def test_a_search_finds_a_track_beside_its_reach_whose_target_is_within():
    """Otherwise the target would have a second track."""
    slots, axis = one_track(1.0), PLACE[1] - 1.1 * WIDTH
    s = axis + 0.95 * WIDTH
    x = np.array([[PLACE[0] * s, 0.0, PLACE[0] * np.sqrt(1 - s * s), 0.0]])
    i = areas.beam_of(axis, AREA)
    area = AREA._replace(edges=EDGES + axis - areas.axis_of(i, AREA))
    big = scene(x)._replace(beam=BEAM._replace(reference=400e3))
    laws = LAWS._replace(beam=big.beam, area=area)
    dwells.search(0.5, slots, i, np.full((100, 7, 2), 0.1), big, np.uint64(3), LOOK, COVERS, laws)
    assert big.looks[0] == 1
    assert slots.time[0] == 0.5
    assert (slots.existence > 0).sum() == 1


def test_dropped_tracks_are_undetected_again():
    slots, undetected = one_track(0.03), np.zeros((100, 7, 2))
    dwells.drop_tracks(0.1, slots, undetected, MODES, MOST, AREA)
    assert slots.existence[0] == 0.0
    cell = undetected[np.searchsorted(EDGES, PLACE[1]) - 1, 2]
    np.testing.assert_allclose(cell, [0.021, 0.009], rtol=1e-12)
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
    tentative, confirmed = dwells.rates_of_cost(seconds, slots, MODES, MOST, AREA)
    part, other = (confirmed, tentative) if existence == 1.0 else (tentative, confirmed)
    assert part == pytest.approx(min(reported, silent), rel=5e-3)
    assert other == 0.0
