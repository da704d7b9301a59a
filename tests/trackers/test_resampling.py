"""Systematic resampling against filterpy, the bounds of its counts, and effective sample sizes."""

from __future__ import annotations

import filterpy.monte_carlo.resampling
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.trackers import rbpf_kernels as kernels
from wavegym.trackers import systematic_resample


def test_effective_sample_size_and_ancestors_of_known_weights():
    weight, index = np.empty(4), np.empty(4, np.int64)
    for p in ([0.25, 0.25, 0.25, 0.25], [0.5, 0.5, 0.0, 0.0], [0.7, 0.1, 0.1, 0.1]):
        with np.errstate(divide="ignore"):
            effective = kernels.normalise(np.log(p) + 700.0, weight)
        np.testing.assert_allclose(weight, p, rtol=1e-12)
        np.testing.assert_allclose(effective, 1.0 / np.square(p).sum(), rtol=1e-12)
        assert kernels.systematic(0.5, weight, index) == len(set(index))
    assert index.tolist() == [0, 0, 0, 2]  # 0.125, 0.375, 0.625, 0.875 in shares that end at 0.7, 0.8, 0.9, 1
    assert kernels.normalise(np.full(4, -np.inf), weight) == 4.0
    assert (weight == 0.25).all()


def test_systematic_resampling_equals_filterpy(monkeypatch):
    rng = np.random.default_rng(0)
    w, u = rng.exponential(size=(3, 50, 200)) ** 3, rng.random(50)
    w /= w.sum(-1, keepdims=True)
    ours = systematic_resample(w, u)
    for i, j in np.ndindex(3, 50):
        monkeypatch.setattr(filterpy.monte_carlo.resampling, "random", lambda u=u[j]: u)
        assert (ours[i, j] == filterpy.monte_carlo.systematic_resample(w[i, j])).all()
        assert (ours[i, j] == systematic_resample(w[i, j], u[j])).all()


@settings(max_examples=100)
@given(w=st.lists(st.floats(0.0, 1e3), min_size=1, max_size=40), u=st.floats(0.0, 1.0, exclude_max=True))
def test_a_particle_survives_as_often_as_its_weight_says(w, u):
    p = np.array(w) + 1e-3
    share = len(p) * p / p.sum()
    times = np.bincount(systematic_resample(p, u), minlength=len(p))
    assert times.sum() == len(p)
    assert (times >= np.floor(share - 1e-9)).all()
    assert (times <= np.ceil(share + 1e-9)).all()


@pytest.mark.parametrize(
    ("weights", "u", "message"),
    [
        ([[0.0, 0.0]], 0.5, "expected numbers >= 0 with a positive sum"),
        ([-1.0, 2.0], 0.5, "least value -1"),
        ([np.nan, 2.0], 0.5, "expected numbers >= 0"),
        ([], 0.5, "expected numbers >= 0 with a positive sum"),
        ([1.0, 2.0], 1.0, r"u is 1.0, expected numbers in \[0, 1\)"),
        (np.ones((3, 2)), [0.5, 0.5], r"the shapes \(3, 2\) and \(2,\)"),
    ],
)
def test_bad_weights_are_named(weights, u, message):
    with pytest.raises(InputError, match=message) as caught:
        systematic_resample(weights, u)
    assert "\n" not in str(caught.value)
