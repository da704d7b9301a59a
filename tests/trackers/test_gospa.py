"""GOSPA against Stone Soup and against all assignments, and the axioms of a metric."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stonesoup.metricgenerator.ospametric import GOSPAMetric
from stonesoup.types.state import State

from wavegym.core.errors import InputError
from wavegym.trackers import gospa


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
