"""GOSPA, OSPA and SIAP against Stone Soup and against all assignments, and the axioms of a metric."""

from __future__ import annotations

from datetime import datetime, timedelta
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stonesoup.measures import Euclidean
from stonesoup.metricgenerator.manager import MultiManager
from stonesoup.metricgenerator.ospametric import GOSPAMetric, OSPAMetric
from stonesoup.metricgenerator.tracktotruthmetrics import SIAPMetrics
from stonesoup.types.association import AssociationSet, TimeRangeAssociation
from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
from stonesoup.types.state import State
from stonesoup.types.time import TimeRange
from stonesoup.types.track import Track

from wavegym.core.errors import InputError
from wavegym.trackers import gospa, ospa, siap


def scene(T, N, seed, spread=15.0):
    rng = np.random.default_rng(seed)
    return rng.normal(scale=spread, size=(T, 2)), rng.normal(scale=spread, size=(N, 2))


@given(st.integers(1, 5), st.integers(1, 6), st.integers(0, 9999), st.sampled_from([1.0, 2.0, 3.0]))
def test_equals_stone_soup(T, N, seed, p):
    targets, tracks = scene(T, N, seed)
    theirs, _ = GOSPAMetric(p=p, c=20.0).compute_gospa_metric(
        [State(x[:, None]) for x in tracks], [State(x[:, None]) for x in targets]
    )
    ours = gospa(targets, tracks, cutoff=20.0, order=p)
    for name in ("distance", "localisation", "missed", "false"):
        assert getattr(ours, name) == pytest.approx(float(theirs.value[name]), rel=1e-9, abs=1e-9)


@given(st.integers(1, 4), st.integers(1, 4), st.integers(0, 9999))
def test_is_the_least_over_all_assignments(T, N, seed):
    targets, tracks = scene(T, N, seed)
    few, many = sorted([targets, tracks], key=len)
    sums = [
        sum(min(np.linalg.norm(a - many[j]), 10.0) ** 2 for a, j in zip(few, order, strict=True))
        for order in permutations(range(len(many)), len(few))
    ]
    expected = np.sqrt(min(sums) + 50.0 * (len(many) - len(few)))
    assert gospa(targets, tracks, cutoff=10.0).distance == pytest.approx(expected)


@given(st.integers(0, 4), st.integers(0, 4), st.integers(0, 4), st.integers(0, 9999))
def test_is_a_metric(T, N, K, seed):
    a, b = scene(T, N, seed)
    c, _ = scene(K, 0, seed + 1)
    assert gospa(a, a).distance == 0.0
    assert gospa(a, b).distance == pytest.approx(gospa(b, a).distance)
    assert gospa(a, c).distance <= gospa(a, b).distance + gospa(b, c).distance + 1e-9


@pytest.mark.parametrize("p", [1.0, 2.0, 8.0, 14.0, 100.0])
@pytest.mark.parametrize("apart", [0.1, 1.0, 19.0])
def test_one_track_near_its_target_is_as_far_as_it_is(apart, p):
    """At any order; with two targets the nearer is assigned and the other costs c^p / 2."""
    assert gospa([[0.0, 0.0]], [[apart, 0.0]], order=p).distance == pytest.approx(apart, rel=1e-9)
    two = gospa([[apart, 0.0], [0.5 * apart, 0.0]], [[0.0, 0.0]], order=p)
    assert two.localisation ** (1.0 / p) == pytest.approx(0.5 * apart, rel=1e-9)


def test_absent_targets_and_tracks_do_not_count():
    targets, tracks = np.zeros((6, 3, 2)), np.zeros((3, 2))
    present = [[True, False, False], [True, True, False]] * 3
    found = gospa(targets, tracks, present, [True, False, False], cutoff=4.0)
    np.testing.assert_array_equal(found.localisation, 0.0)
    np.testing.assert_array_equal(found.missed, [0.0, 8.0] * 3)
    np.testing.assert_array_equal(found.false, 0.0)
    assert gospa(np.zeros((0, 2)), np.zeros((2, 2)), cutoff=4.0).false == 16.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((2, 2)), np.zeros((2, 3))), r"shapes \(2, 2\) and \(2, 3\), expected"),
        ((np.zeros(2), np.zeros(2)), "expected"),
        ((np.zeros((13, 2)), np.zeros((2, 2))), "targets holds 13 targets, expected at most 12"),
        ((np.zeros((2, 2)), np.zeros((2, 2)), [True] * 3), r"present and alive have shapes \(3,\)"),
        ((np.zeros((2, 2)), np.zeros((2, 2)), True, True, 0.0), "cutoff is 0.0 m"),
        ((np.zeros((2, 2)), np.zeros((2, 2)), True, True, 1.0, 0.5), "order is 0.5"),
        ((np.zeros((2, 2)), np.zeros((2, 2)), True, True, 1e4, 100.0), "order is 100.0, expected at most 77"),
    ],
)
def test_mistakes(arguments, message):
    with pytest.raises(InputError, match=message):
        gospa(*arguments)


NOW = datetime(2026, 11, 23)
TWICE = (NOW, NOW + timedelta(seconds=1))  # Stone Soup wants a range of times
CUTOFF = 20.0
sizes, seeds = st.integers(0, 5), st.integers(0, 9999)


@settings(deadline=None)
@given(st.integers(1, 5), st.integers(1, 6), seeds)
def test_ospa_equals_stone_soup(T, N, seed):
    targets, tracks = scene(T, N, seed)
    states = [[State(x[:, None], timestamp=NOW) for x in points] for points in (tracks, targets)]
    theirs = [OSPAMetric(p=p, c=CUTOFF).compute_OSPA_distance(*states).value for p in (1.0, 2.0)]
    assert ospa(targets, tracks, cutoff=CUTOFF, order=1.0) == pytest.approx(theirs[0], rel=1e-9)
    # Stone Soup assigns by the distances, not by their powers
    assert ospa(targets, tracks, cutoff=CUTOFF) <= theirs[1] + 1e-9


@settings(deadline=None)
@given(sizes, sizes, seeds, st.sampled_from([1.0, 2.0, 5.0]))
def test_ospa_is_the_least_over_all_assignments(T, N, seed, p):
    targets, tracks = scene(T, N, seed)
    few, many = sorted([targets, tracks], key=len)
    sums = [
        sum(min(np.linalg.norm(a - many[j]), CUTOFF) ** p for a, j in zip(few, order, strict=True))
        for order in permutations(range(len(many)), len(few))
    ]
    missing = CUTOFF**p * (len(many) - len(few))
    expected = ((min(sums) + missing) / max(len(many), 1)) ** (1 / p)
    assert ospa(targets, tracks, cutoff=CUTOFF, order=p) == pytest.approx(expected)


@settings(deadline=None)
@given(sizes, sizes, sizes, seeds)
def test_ospa_is_a_metric(T, N, K, seed):
    a, b = scene(T, N, seed)
    c, _ = scene(K, 0, seed + 1)
    assert ospa(a, a) == 0.0
    assert ospa(a, b) == pytest.approx(ospa(b, a))
    assert ospa(a, c) <= ospa(a, b) + ospa(b, c) + 1e-9


def test_as_many_tracks_as_targets_are_as_far_as_by_gospa():
    targets, tracks = scene(3, 3, 1, spread=1.0)
    assert ospa(targets, tracks) == pytest.approx(gospa(targets, tracks).distance / np.sqrt(3.0))


def stone_soup_siap(targets, tracks):
    """The metrics of a picture that lasts, each track associated with the nearest target within the cutoff."""
    truths = [GroundTruthPath([GroundTruthState(x[:, None], timestamp=t) for t in TWICE]) for x in targets]
    found = [Track([State(x[:, None], timestamp=t) for t in TWICE]) for x in tracks]
    pairs = set()
    for track, x in zip(found, tracks, strict=True):
        away = np.linalg.norm(targets - x, axis=1)
        if len(away) and away.min() < CUTOFF:
            pairs.add(TimeRangeAssociation({track, truths[away.argmin()]}, TimeRange(*TWICE)))
    measure = Euclidean((0, 1))
    generator = SIAPMetrics(measure, measure)
    manager = MultiManager([generator])
    manager.add_data({"groundtruth_paths": set(truths), "tracks": set(found)})
    manager.association_set = AssociationSet(pairs)
    values = {metric.title: metric.value for metric in generator.compute_metric(manager)}
    return [values[f"SIAP {name}"] for name in ("Completeness", "Ambiguity", "Spuriousness", "Position Accuracy")]


@settings(deadline=None, max_examples=40)
@given(st.integers(1, 5), st.integers(1, 6), seeds)
def test_siap_equals_stone_soup(T, N, seed):
    targets, tracks = scene(T, N, seed, spread=25.0)
    ours, theirs = siap(targets, tracks, cutoff=CUTOFF), stone_soup_siap(targets, tracks)
    for value, expected in zip(ours, theirs, strict=True):
        if not np.isnan(value):  # Stone Soup has 0 or 1 where nothing counts
            assert value == pytest.approx(expected)
    assert np.isnan(ours.ambiguity) == np.isnan(ours.position_accuracy) == (ours.completeness == 0.0)


def test_absent_targets_and_tracks_do_not_count_in_ospa_and_siap():
    targets, tracks = np.zeros((6, 3, 2)), np.zeros((3, 2))
    present = [[True, False, False], [True, True, False]] * 3
    alive = [True, False, False]
    np.testing.assert_allclose(ospa(targets, tracks, present, alive, cutoff=4.0), [0.0, np.sqrt(8.0)] * 3)
    found = siap(targets, tracks, present, alive, cutoff=4.0)
    np.testing.assert_array_equal(found.completeness, [1.0, 0.5] * 3)
    np.testing.assert_array_equal(found.spuriousness, 0.0)
    nothing = siap(targets, tracks, False, [False] * 3)
    assert all(np.isnan(each).all() for each in nothing)
    assert (ospa(targets, tracks, [False] * 3, [False] * 3) == 0.0).all()


@pytest.mark.parametrize("metric", [ospa, siap])
def test_shapes_that_do_not_fit(metric):
    with pytest.raises(InputError, match=r"expected \(..., T, d\) and \(..., N, d\)"):
        metric(np.zeros((2, 2)), np.zeros((2, 3)))
    with pytest.raises(InputError, match="that broadcast"):
        metric(np.zeros((2, 2)), np.zeros((3, 2)), present=[True, True, True])
