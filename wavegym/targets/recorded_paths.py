"""Catalogues of truth windows cut from recorded tracks, and recordings as true paths in a system's state and time step.

Windows are drawn uniformly, or by the numbers of a tape.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_int
from wavegym.targets.reader import read_tracks
from wavegym.targets.recorded import Piece, RecordedTrack

LINE_OF_SIGHT = ("r", "rdot", "rddot")
FEW_FILES = 4  # recordings kept in memory: a comparison makes the same system several times


@dataclass(frozen=True, eq=False)
class Windows:
    """All windows of ``steps`` + 1 successive samples in some recorded pieces; windows overlap.

    ``len(windows)`` is the number of windows. ``windows[index]`` holds the samples of one window, (steps + 1,
    component); an index array (...) gives (..., steps + 1, component). ``rng.integers(len(windows))`` draws uniformly.

    Args:
        samples: the samples of all pieces, piece after piece, (sample, component).
        starts: first sample of each window, (window,).
        steps: steps in a window.
        names: one name per component.
        pieces: the pieces, in the order of the samples.
    """

    samples: FloatArray
    starts: NDArray[np.int64]
    steps: int
    names: tuple[str, ...]
    pieces: tuple[Piece, ...]

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, index: int | NDArray[np.int64]) -> FloatArray:
        offsets = np.arange(self.steps + 1)
        window: FloatArray = self.samples[self.starts[index][..., None] + offsets]
        return window

    def locate(self, index: int) -> tuple[Piece, int]:
        """The piece that holds a window, and the index of the window's first sample in that piece."""
        begins = _begins(self.pieces)
        which = int(np.searchsorted(begins, self.starts[index], side="right")) - 1
        return self.pieces[which], int(self.starts[index] - begins[which])


def windows(
    tracks: RecordedTrack | Sequence[RecordedTrack],
    dt: float,
    steps: int,
    max_gap: float | None = 30.0,
    smoothing: float | None = 0.0,
) -> Windows:
    """Resample tracks and list all windows of ``steps`` + 1 samples that cross no gap.

    Args:
        tracks: one track or several.
        dt: time between samples [s].
        steps: steps in a window, >= 1.
        max_gap: longest time between reports without a cut [s]; None as in ``RecordedTrack.resample``.
        smoothing: time constant of ``RecordedTrack.resample`` [s]; None: chosen for each track.

    Returns:
        Windows with 9 components: x, y, z, their rates and their accelerations [m, m/s, m/s²].

    Raises:
        InputError: an invalid argument, or no window in any track (the message has the longest piece without a gap).
    """
    check_int("steps", steps, 1)
    sources = [tracks] if isinstance(tracks, RecordedTrack) else list(tracks)
    pieces = tuple(piece for track in sources for piece in track.resample(dt, max_gap, smoothing))
    usable = tuple(piece for piece in pieces if len(piece.times) > steps)
    if not usable:
        raise InputError(_too_short(sources, dt, steps, max_gap))
    samples = np.concatenate([np.hstack([p.positions, p.velocities, p.accelerations]) for p in usable])
    starts = np.concatenate(
        [begin + np.arange(len(p.times) - steps) for begin, p in zip(_begins(usable), usable, strict=True)]
    )
    names = tuple(axis + suffix for suffix in ("", "dot", "ddot") for axis in "xyz")
    return Windows(samples, starts, steps, names, usable)


def range_paths(
    catalogue: Windows,
    radar: ArrayLike = (0.0, 0.0, 0.0),
    acceleration: bool = False,
    limits: tuple[float, float] = (1.0, math.inf),
) -> Windows:
    """Turn windows of positions into windows of range and range-rate as seen by a radar.

    Args:
        catalogue: from ``windows``.
        radar: position in the coordinates of the tracks [m], (3,): (0, 0, 0) is the origin of the tangent plane.
        acceleration: add the range acceleration.
        limits: least (> 0) and greatest range [m]; a window with a sample outside is left out.

    Returns:
        Windows with the components r, rdot (receding positive) and, with ``acceleration``, rddot.

    Raises:
        InputError: invalid arguments, or no window within the limits.
    """
    place = np.asarray(radar, np.float64)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise InputError(f"radar is {radar!r}, expected three finite numbers [m]")
    low, high = limits
    if not 0 < low < high:
        raise InputError(f"limits is {limits!r} m, expected 0 < nearest < farthest")
    if len(catalogue.names) != 9:
        raise InputError(f"catalogue has components {catalogue.names}, expected the 9 of windows()")
    p, v, a = np.split(catalogue.samples, [3, 6], axis=1)
    p = p - place
    r = np.linalg.norm(p, axis=1)
    outside = (r < low) | (r > high)
    passed = np.concatenate([[0], np.cumsum(outside)])
    starts = catalogue.starts[passed[catalogue.starts + catalogue.steps + 1] == passed[catalogue.starts]]
    if not len(starts):
        raise InputError(
            f"no window stays between {low:g} and {high:g} m from the radar: "
            f"the targets are {r.min():.0f} to {r.max():.0f} m away"
        )
    divisor = np.where(outside, 1.0, r)  # samples outside the limits are in no window
    rdot = np.sum(p * v, axis=1) / divisor
    columns = [r, rdot]
    if acceleration:
        columns.append((np.sum(v * v + p * a, axis=1) - rdot * rdot) / divisor)
    return replace(
        catalogue, samples=np.stack(columns, axis=1), starts=starts, names=("r", "rdot", "rddot")[: len(columns)]
    )


def _begins(pieces: Sequence[Piece]) -> NDArray[np.int64]:
    """First sample of each piece, (piece,), where the samples lie piece after piece."""
    return np.cumsum([0, *(len(piece.times) for piece in pieces[:-1])])


def _too_short(tracks: Sequence[RecordedTrack], dt: float, steps: int, max_gap: float | None) -> str:
    if not tracks:
        return "tracks is empty, expected at least one recorded track"
    longest = max((part for track in tracks for part in track.pieces(max_gap)), key=lambda part: part.duration)
    counts: dict[str, int] = {}
    for track in tracks:
        for reason, count in track.dropped.items():
            counts[reason] = counts.get(reason, 0) + count
    left_out = ", ".join(f"{count} for {reason}" for reason, count in counts.items() if count)
    shorter = f" (nearest: an episode of {longest.duration // dt:g} steps)" if longest.duration >= dt else ""
    return (
        f"{longest.source or 'the recording'}: longest gap-free piece lasts {longest.duration:g} s "
        f"(track {longest.id!r}), {steps * dt:g} s needed{shorter}; "
        f"tracks are cut where reports lie more than {longest.longest_gap(max_gap):g} s apart"
        + (f"; reports left out: {left_out}" if left_out else "")
    )


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
