"""Recordings as paths of a system: three dimensions, the line of sight, and windows drawn from different tracks."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.targets import constant_velocity, range_paths, read_tracks, windows
from wavegym.targets.recorded_paths import recorded_paths

LENGTHS = (40, 90, 25, 60)  # reports of each track, one a second
SPACE = constant_velocity(1.0, 1.0, axes=("x", "y", "z")).names


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("paths") / "lines.csv"
    rows = [f"{t},{k},{1000 * k + 20 * t},{500 - 10 * t},{100 + t}" for k, n in enumerate(LENGTHS) for t in range(n)]
    file.write_text("\n".join(["t,id,x,y,z", *rows]) + "\n")
    return file


def test_states_in_three_dimensions(recording):
    assert SPACE == ("x", "xdot", "y", "ydot", "z", "zdot")
    paths = recorded_paths(recording, SPACE, 0.5, 20, radar=(5.0, 6.0, 7.0), targets=3)
    window = paths.draw(np.random.default_rng(1).random((50, 3)))
    whole = paths.paths(window)
    assert whole.shape == (50, 3, 21, 6)
    rates = np.broadcast_to((20.0, -10.0, 1.0), (50, 3, 21, 3))
    np.testing.assert_allclose(whole[..., 1::2], rates, atol=1e-9)
    t = whole[..., 4] + 7.0 - 100.0
    np.testing.assert_allclose(whole[..., 2], 500.0 - 10.0 * t - 6.0, atol=1e-6)
    for step in (0, 7, 20):
        np.testing.assert_array_equal(paths.states(window, np.full(50, step)), whole[:, :, step])


def test_the_line_of_sight_is_that_of_range_paths(recording):
    expected = range_paths(windows(read_tracks(recording), 1.0, 20, max_gap=None, smoothing=None), (5.0, 6.0, 7.0))
    found = recorded_paths(recording, ("r", "rdot"), 1.0, 20, radar=(5.0, 6.0, 7.0), limits=(1.0, np.inf))
    np.testing.assert_array_equal(found.catalogue.samples, expected.samples)
    np.testing.assert_array_equal(found.catalogue.starts, expected.starts)
    u = np.random.default_rng(2).random((100, 1))
    np.testing.assert_array_equal(found.draw(u)[:, 0], (u[:, 0] * len(expected)).astype(int))


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_targets_of_a_world_are_of_different_tracks(recording, targets, seed):
    paths = recorded_paths(recording, SPACE, 1.0, 20)
    counts = [n - 20 for n in LENGTHS]
    assert np.diff(paths.bounds).tolist() == counts
    u = np.random.default_rng(seed).random((30, targets))
    window = paths.draw(np.minimum(u, 1.0))
    tracks = np.searchsorted(paths.bounds, window, side="right") - 1
    for chosen, row, uniform in zip(tracks, window, u, strict=True):
        assert len(set(chosen.tolist())) == targets
        left = [w for k, n in enumerate(counts) for w in range(paths.bounds[k], paths.bounds[k] + n)]
        for track, w, draw in zip(chosen, row, uniform, strict=True):
            assert w == left[int(draw * len(left))]
            left = [x for x in left if not paths.bounds[track] <= x < paths.bounds[track + 1]]


def test_too_few_tracks_and_unknown_elements(recording):
    with pytest.raises(InputError, match=r"1 track has a window of 80 s within .* expected 2, one for each target"):
        recorded_paths(recording, SPACE, 1.0, 80, targets=2)
    with pytest.raises(InputError, match="state has 'w', expected elements of x, y, z, xdot"):
        recorded_paths(recording, ("x", "w"), 1.0, 20)


def test_a_file_that_changes_is_read_again(recording, tmp_path):
    file = tmp_path / "changing.csv"
    lines = recording.read_text().splitlines()
    file.write_text("\n".join(lines) + "\n")
    assert len(recorded_paths(file, SPACE, 1.0, 20).bounds) == 5
    time.sleep(0.01)
    file.write_text("\n".join(lines[: 1 + LENGTHS[0]]) + "\n")
    assert len(recorded_paths(file, SPACE, 1.0, 20).bounds) == 2
