"""Actions of the agile-clutter sensors: order, forms, encodings, covariances."""

from __future__ import annotations

from itertools import product

import agile_clutter_oracle as plain
import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wavegym.systems.agile_clutter.actions import ChirpActions
from wavegym.waveforms import parse_law

LAWS, DURATIONS, SWEEPS, CARRIER = ("lfm", "pfm:3", "hfm:0.3", "efm"), (10e-6, 40e-6, 100e-6), (2e6, 15e6), 9e9
FORMS = ("library", "joint", "box")
CHIRPS = list(product(range(4), DURATIONS, SWEEPS, (1, -1)))


def make_set(form, laws=LAWS, sensors=2):
    return ChirpActions(laws, DURATIONS, SWEEPS, CARRIER, sensors, form)


def covariance(law, duration, signed_sweep):
    kind, shape = parse_law(law)
    return plain.unit_covariance(kind, 0.5 if shape is None else shape, duration, signed_sweep, CARRIER)


def test_the_library_has_law_duration_sweep_direction_in_this_order():
    action_set = make_set("library")
    assert [w.kind for w in action_set.library] == [LAWS[law][:3] for law, *_ in CHIRPS]
    assert [(w.duration, w.signed_sweep) for w in action_set.library] == [(d, sign * s) for _, d, s, sign in CHIRPS]
    want = np.array([covariance(LAWS[law], d, sign * s) for law, d, s, sign in CHIRPS])
    # LFM: J is inverted in the oracle, with 1 - rho^2 of 7e-6 and less; the others have 0.05 and more
    assert oracles.covariance_distance(action_set.sensor_covariances[12:], want[12:]) < 1e-11
    assert oracles.covariance_distance(action_set.sensor_covariances[:12], want[:12]) < 1e-8


def test_the_joint_library_has_the_longest_and_widest_only():
    action_set = make_set("joint")
    assert [(w.duration, w.sweep) for w in action_set.sensor_library] == [(100e-6, 15e6)] * 8
    assert len(action_set.actions) == 64
    C = action_set.unit_covariance(np.arange(64))
    assert C.shape == (64, 2, 2, 2)
    for index, (a, b) in enumerate(product(range(8), repeat=2)):
        np.testing.assert_array_equal(C[index], action_set.sensor_covariances[[a, b]])


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("laws", [LAWS, ("hfm:0.3",)])
@pytest.mark.parametrize("sensors", [1, 2, 3])
def test_encoded_choices_transmit_what_was_chosen(form, laws, sensors):
    action_set = make_set(form, laws, sensors)
    choices = np.random.default_rng(0).integers(len(action_set.sensor_library), size=(5, 7, sensors))
    C = action_set.unit_covariance(action_set.encode(choices))
    assert C.shape == (5, 7, sensors, 2, 2)
    # the box goes by a logarithm and back; C's determinant is 7e-6 of the product of an LFM's variances
    assert oracles.covariance_distance(C, action_set.sensor_covariances[choices]) <= (1e-12 if form == "box" else 0.0)


@pytest.mark.parametrize("form", FORMS)
def test_candidates_are_all_combinations_and_constants_one_chirp_for_all(form):
    action_set = make_set(form)
    count = len(action_set.sensor_library)
    C = action_set.unit_covariance(action_set.candidates)
    pairs = np.array(list(product(range(count), repeat=2)))
    assert oracles.covariance_distance(C, action_set.sensor_covariances[pairs]) < 1e-12
    fixed = action_set.unit_covariance(action_set.constants)
    assert len(fixed) == 2 * count  # a direction for each sensor
    np.testing.assert_allclose(fixed[:, 0, 0, 0], fixed[:, 1, 0, 0], rtol=1e-12)
    np.testing.assert_allclose(np.abs(fixed[:, 0, 0, 1]), np.abs(fixed[:, 1, 0, 1]), rtol=1e-12)
    assert len(np.unique(np.sign(fixed[:4, :, 0, 1]), axis=0)) == 4
    assert len(np.unique(action_set.constants, axis=0)) == len(fixed)


@settings(max_examples=50)
@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6))
def test_the_box_means_law_duration_and_signed_sweep(point):
    action_set = make_set("box")
    got = action_set.unit_covariance(np.array([point]))[0]
    for i in range(2):
        a, b, c = point[3 * i : 3 * i + 3]
        law = LAWS[min(int(4 * (0.5 * (a + 1))), 3)]
        want = covariance(law, 10e-6 * 10 ** (0.5 * (b + 1)), 15e6 * c)
        assert oracles.covariance_distance(got[i], want) < 1e-7


@pytest.mark.parametrize("laws", [LAWS, ("efm",)])
def test_any_chirp_can_be_encoded(laws):
    action_set, rng = make_set("box", laws), np.random.default_rng(1)
    law, duration = rng.integers(len(laws), size=(9, 2)), 10e-6 * 10 ** rng.uniform(0, 1, (9, 2))
    sweep = rng.uniform(-15e6, 15e6, (9, 2))
    got = action_set.unit_covariance(action_set.encode_chirps(law, duration, sweep))
    assert oracles.covariance_distance(got, action_set.chirp_covariance(law, duration, sweep)) < 1e-9
