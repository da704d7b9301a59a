"""True paths on one line of sight: drawn from the model, scripted or recorded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from wavegym.core.arrays import Array
from wavegym.targets import (
    MotionModel,
    ScriptedPath,
    Segment,
    Windows,
    random_path,
    range_paths,
    read_tracks,
    windows,
)


class PathSource(Protocol):
    """Makes true paths of a tape's draws."""

    def __call__(self, start: Array, process: Array) -> Array:
        """Paths (env, H + 1, n), C-contiguous, from uniform draws (env, n) and normal ones (env, H, n)."""


@dataclass(frozen=True)
class RandomPath:
    """A start drawn uniformly between bounds, then the motion model with its process noise."""

    motion: MotionModel
    low: Array  # (n,)
    width: Array  # (n,)

    def __call__(self, start: Array, process: Array) -> Array:
        """See ``PathSource``."""
        return random_path(self.motion, self.low + self.width * start, process)


@dataclass(frozen=True)
class ScriptedRange:
    """A start drawn uniformly between bounds, then prescribed accelerations."""

    low: Array  # (n,)
    width: Array  # (n,)
    segments: tuple[Segment, ...]
    times: Array  # (H + 1,)

    def __call__(self, start: Array, process: Array) -> Array:
        """See ``PathSource``. Where the state has an acceleration, the script's own stands in its place."""
        first, n = self.low + self.width * start, len(self.low)
        scripted = (ScriptedPath((x[0],), (x[1],), self.segments).sample(self.times) for x in first)
        return np.stack([np.concatenate(motion, axis=1)[:, :n] for motion in scripted])


@dataclass(frozen=True)
class RecordedRange:
    """A window of a recording, every window of the length wanted equally likely."""

    catalogue: Windows

    def __call__(self, start: Array, process: Array) -> Array:
        """See ``PathSource``."""
        return self.catalogue[(start[:, 0] * len(self.catalogue)).astype(np.int64)]


def recorded_range(
    file: Path,
    radar: tuple[float, ...] | None,
    dt: float,
    steps: int,
    smoothing: float,
    limits: tuple[float, float],
    acceleration: bool,
) -> RecordedRange:
    """Windows of a recording as seen from a radar: geographic for degrees, in metres for metres.

    Args:
        file: the recording, a CSV file.
        radar: its position in the units of the file; None for the middle of the recording, or its origin.
        dt: time step, s.
        steps: steps of a window.
        smoothing: time constant against the jitter of time stamps, s.
        limits: nearest and farthest range of a window, m.
        acceleration: whether the state has the second derivative of range.

    Raises:
        InputError: a file that cannot be read, or without a window that fits.
    """
    tracks = read_tracks(file)
    place: tuple[float, ...] = (0.0, 0.0, 0.0)
    if radar is not None and tracks[0].origin is not None:
        tracks = read_tracks(file, origin=radar)
    elif radar is not None:
        place = (*radar, 0.0)[:3]
    positions = windows(tracks, dt, steps, smoothing=smoothing)
    return RecordedRange(range_paths(positions, place, acceleration=acceleration, limits=limits))
