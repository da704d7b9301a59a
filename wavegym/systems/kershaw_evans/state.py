"""A target on one line of sight: tape, truth, belief and observation fields."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import ObservationField
from wavegym.targets import MotionModel, ScriptedPath, Segment, random_path
from wavegym.targets.recorded_paths import RecordedPaths


class World(NamedTuple):
    """One episode's tape: standard uniform and normal draws, the same for every scenario."""

    uniform: Array  # (2, n) where the target starts (or which recording it flies), and how well it is known
    # row k: manoeuvre (n) and measurement error (2) of step k; row 0: error of the first estimate
    normal: Array  # (H + 1, n + 2)


class Truth(NamedTuple):
    """The part of the state that no scheduler sees."""

    targets: Array  # (env, n)
    path: Array  # (env, H + 1, n) the truth at every step; no choice changes it


class Measurements(NamedTuple):
    """What the receiver reports of one pulse."""

    z: Array  # (env, 2) range and range-rate
    R: Array  # (env, 2, 2) covariance of their errors as the tracker assumes it


class Belief(NamedTuple):
    """The belief."""

    step: Array  # (env,) int
    mean: Array  # (env, n)
    covariance: Array  # (env, n, n)
    memory: Any = None  # of a tracker that has one; None otherwise, and in prediction
    process_noise: Array | None = None  # (env, n, n) of the next step as the tracker believes it; None: the model's Q


def covariance_fields(names: tuple[str, ...]) -> tuple[ObservationField, ...]:
    """Observation elements of a covariance of (r, rdot[, rddot]): log deviations, then correlations row by row."""
    scales = (("log10(m)", 1.0), ("log10(m/s)", 1.0), ("log10(m/s^2)", 0.5))
    deviations = (
        ObservationField(f"log10_sigma_{name}", unit, centre, 0.5, f"standard deviation of {name}")
        for name, (unit, centre) in zip(names, scales, strict=False)
    )
    correlations = (
        ObservationField(
            f"correlation_{names[i]}_{names[j]}", "1", 0.0, 0.3, f"correlation of {names[i]} and {names[j]}"
        )
        for i in range(len(names))
        for j in range(i)
    )
    return (*deviations, *correlations)


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
