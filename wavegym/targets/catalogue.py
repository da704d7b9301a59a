"""Catalogues of truth windows cut from recorded tracks, for uniform random draws."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_int
from wavegym.targets.recorded import Piece, RecordedTrack


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
