"""True paths on one line of sight: drawn from the model, scripted or recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from wavegym.core.arrays import Array
from wavegym.targets import MotionModel, ScriptedPath, Segment, random_path
from wavegym.targets.recorded_paths import RecordedPaths


class PathSource(Protocol):
    """Makes true paths from a tape's draws."""

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
        """See ``PathSource``. If the state has an acceleration, it is that of the script."""
        first, n = self.low + self.width * start, len(self.low)
        scripted = (ScriptedPath((x[0],), (x[1],), self.segments).sample(self.times) for x in first)
        return np.stack([np.concatenate(motion, axis=1)[:, :n] for motion in scripted])


@dataclass(frozen=True)
class RecordedRange:
    """A window of a recording, every window of the length wanted equally likely."""

    recorded: RecordedPaths

    def __call__(self, start: Array, process: Array) -> Array:
        """See ``PathSource``."""
        return self.recorded.paths(self.recorded.draw(start[:, :1]))[:, 0]
