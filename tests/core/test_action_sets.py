"""Action sets for several sensors: their order, their labels, their refusals."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core.action_sets import JointLibrary, PerSensorLibrary
from wavegym.core.errors import InputError
from wavegym.waveforms import gaussian_chirp_library

DURATIONS = (1e-6, 2e-6, 5e-6, 10e-6)


@given(st.integers(1, 4), st.integers(1, 3))
def test_every_combination_comes_once_and_the_first_sensor_slowest(count, sensors):
    library = gaussian_chirp_library(DURATIONS[:count], [0.0])
    each, joint = PerSensorLibrary(library, sensors), JointLibrary(library, sensors)
    want = list(product(range(count), repeat=sensors))
    for indices in (each.combinations(), joint.indices):
        assert [tuple(row) for row in indices.tolist()] == want
        assert indices.dtype == np.int64
        assert indices.flags.c_contiguous
    assert (len(each), each.labels) == (count, library.labels)
    assert len(joint) == len(joint.labels) == len(want)
    assert joint.labels == tuple(" | ".join(library.labels[i] for i in row) for row in want)
    assert joint.encode(np.array(want)).tolist() == list(range(len(want)))


def test_the_combinations_are_the_callers_own():
    each = PerSensorLibrary(gaussian_chirp_library(DURATIONS, [0.0]), 2)
    each.combinations()[:] = 0
    assert each.combinations()[-1].tolist() == [3, 3]


@pytest.mark.parametrize("kind", [PerSensorLibrary, JointLibrary])
@pytest.mark.parametrize(("sensors", "closest"), [(0, 1), (-2, 1), (2.5, 2), ("2", 1), (True, 1)])
def test_a_number_of_sensors_below_one_is_refused(kind, sensors, closest):
    with pytest.raises(InputError, match=f"sensors is {sensors!r}, expected an integer >= 1 .nearest: {closest}"):
        kind(gaussian_chirp_library(DURATIONS, [0.0]), sensors)


def test_equal_sets_are_equal():
    library = gaussian_chirp_library(DURATIONS, [0.0])
    assert (
        PerSensorLibrary(library, 2)
        == PerSensorLibrary(gaussian_chirp_library(DURATIONS, [0.0]), 2)
        != PerSensorLibrary(library, 3)
    )
    assert JointLibrary(library, 2) != PerSensorLibrary(library, 2)
