"""Recordings as true paths in a system's state, frame and time step, drawn by the numbers of a tape."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError
from wavegym.targets.catalogue import Windows, range_paths, windows
from wavegym.targets.reader import read_tracks

LINE_OF_SIGHT = ("r", "rdot", "rddot")
FEW_FILES = 4  # recordings kept in memory: a comparison makes the same system several times


@dataclass(frozen=True, eq=False)
class RecordedPaths:
    """Windows of a recording whose components are the elements of a system's state.

    The targets of one world come from different tracks.
    """

    catalogue: Windows

    @cached_property
    def bounds(self) -> NDArray[np.int64]:
        """First window of each track that has windows, and the number of all windows at the end, (track + 1,)."""
        begins = np.cumsum([0, *(len(piece.times) for piece in self.catalogue.pieces)])
        first = np.searchsorted(self.catalogue.starts, begins)  # of each piece, and the end
        ids = [piece.id for piece in self.catalogue.pieces]
        new = [0, *(k + 1 for k, (before, here) in enumerate(pairwise(ids)) if before != here), len(ids)]
        return np.unique(first[new])

    def draw(self, uniform: FloatArray) -> NDArray[np.int64]:
        """Windows of each target, (env, target), from uniform draws (env, target).

        Every window of the remaining tracks is equally likely.
        """
        lengths = np.diff(self.bounds)
        is_free = np.ones((len(uniform), len(lengths)), np.bool_)
        chosen, rows = np.empty(uniform.shape, np.int64), np.arange(len(uniform))
        for target in range(uniform.shape[1]):
            last = np.cumsum(np.where(is_free, lengths, 0), axis=1)
            total = last[:, -1]
            nth = np.minimum((uniform[:, target] * total).astype(np.int64), total - 1)
            track = (last <= nth[:, None]).sum(axis=1)
            chosen[:, target] = self.bounds[track] + nth - (last[rows, track] - lengths[track])
            is_free[rows, track] = False
        return chosen

    def paths(self, window: NDArray[np.int64]) -> FloatArray:
        """Whole paths (env, target, steps + 1, n) of windows (env, target)."""
        return self.catalogue[window]

    def states(self, window: NDArray[np.int64], step: NDArray[np.int64]) -> FloatArray:
        """States (env, target, n) of windows (env, target) at ``step`` (env,)."""
        states: FloatArray = self.catalogue.samples[self.catalogue.starts[window] + step[:, None]]
        return states


def recorded_paths(
    file: Path,
    names: tuple[str, ...],
    dt: float,
    steps: int,
    radar: tuple[float, ...] | None = None,
    smoothing: float | None = None,
    limits: tuple[float, float] = (0.0, math.inf),
    targets: int = 1,
) -> RecordedPaths:
    """Windows of a recording as a system sees them.

    Args:
        file: the recording, a CSV file.
        names: elements of the state: ``r``, ``rdot`` and ``rddot``, as a radar sees the target; or of ``x``, ``y`` and
            ``z`` (east, north and up of the radar in a file in degrees) the coordinates and rates that the system has.
        dt: time step [s].
        steps: steps of a window.
        radar: its position in the units of the file, which is the origin of the system's frame; None for the middle of
            a recording in degrees, or the origin of a recording in metres.
        smoothing: time constant [s]; None: chosen for each track.
        limits: nearest and farthest distance [m] of a window's samples from the radar, over the axes of the state.
        targets: targets of one world, each from a different track.

    Raises:
        InputError: a file that cannot be read, too few tracks with a window within the limits, or an unknown element.
    """
    stamp = file.stat().st_mtime_ns if file.is_file() else 0
    positions, place = _windows(file, stamp, dt, steps, radar, smoothing)
    if names[:2] == LINE_OF_SIGHT[:2]:
        catalogue = range_paths(positions, place, acceleration=len(names) == 3, limits=limits)
    else:
        catalogue = _state_paths(positions, place, names, limits)
    found = RecordedPaths(catalogue)
    tracks = len(found.bounds) - 1
    if tracks < targets:
        raise InputError(
            f"{file}: {tracks} {'track has' if tracks == 1 else 'tracks have'} a window of {steps * dt:g} s within "
            f"{limits[1]:g} m of the radar, expected {targets}, one for each target (nearest: {tracks} targets)"
        )
    return found


@lru_cache(maxsize=FEW_FILES)
def _windows(
    file: Path, stamp: int, dt: float, steps: int, radar: tuple[float, ...] | None, smoothing: float | None
) -> tuple[Windows, tuple[float, ...]]:
    """Windows of positions, and where the radar is in their frame; ``stamp`` is the time of the file's last change."""
    tracks = read_tracks(file)
    place: tuple[float, ...] = (0.0, 0.0, 0.0)
    if radar is not None and tracks[0].origin is not None:
        tracks = read_tracks(file, origin=radar)
    elif radar is not None:
        place = (*radar, 0.0)[:3]
    return windows(tracks, dt, steps, max_gap=None, smoothing=smoothing), place


def _state_paths(
    catalogue: Windows, place: tuple[float, ...], names: tuple[str, ...], limits: tuple[float, float]
) -> Windows:
    """Windows whose components are ``names``, relative to ``place``; windows beyond the limits are left out."""
    unknown = [name for name in names if name not in catalogue.names]
    if unknown:
        raise InputError(f"state has {unknown[0]!r}, expected elements of {', '.join(catalogue.names)}")
    columns = [catalogue.names.index(name) for name in names]
    shift = np.array([dict(zip("xyz", place, strict=True)).get(name, 0.0) for name in names])
    samples = catalogue.samples[:, columns] - shift
    axes = [column for column, name in enumerate(names) if name in "xyz"]
    away = np.sqrt(np.square(samples[:, axes]).sum(axis=1))
    low, high = limits
    outside = np.concatenate([[0], np.cumsum((away < low) | (away > high))])
    starts = catalogue.starts[outside[catalogue.starts + catalogue.steps + 1] == outside[catalogue.starts]]
    if not len(starts):
        raise InputError(
            f"no window stays between {low:g} and {high:g} m from the radar: the targets are {away.min():.0f} to "
            f"{away.max():.0f} m away"
        )
    return replace(catalogue, samples=samples, starts=starts, names=names)
