"""Targets on one line of sight: tape, truth and belief; true paths drawn, scripted or recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.system import ObservationField
from wavegym.targets import MotionModel, ScriptedPath, Segment, Windows, random_path, range_paths, read_tracks, windows

if TYPE_CHECKING:
    from wavegym.systems.kershaw_evans.system import KershawEvans


class World(NamedTuple):
    """One episode's tape: standard uniform and normal draws, whatever the scenario makes of them."""

    uniform: Array  # (2, n) where the target starts (or which recording it flies), and how well it is known
    normal: (
        Array  # (H + 1, n + 2) row k: manoeuvre (n) and measurement error (2) of step k; row 0: first estimate's error
    )


class Truth(NamedTuple):
    """What no scheduler sees."""

    targets: Array  # (env, n)
    path: Array  # (env, H + 1, n) the truth at every step; no choice changes it


class Belief(NamedTuple):
    """The belief."""

    step: Array  # (env,) int
    mean: Array  # (env, n)
    covariance: Array  # (env, n, n)


class PathSource(Protocol):
    """Makes true paths of a tape's draws."""

    def __call__(self, start: Array, process: Array) -> Array:
        """Paths (env, H + 1, n), C-contiguous, from uniform draws (env, n) and normal ones (env, H, n)."""


def path_source(system: KershawEvans) -> PathSource:
    """The source of true paths that ``system.targets`` names."""
    if system.targets == "recorded":
        return _recorded(system)
    for name in ("tracks", "radar"):
        if getattr(system, name) is not None:
            given = f"{name} is {getattr(system, name)!s} with targets={system.targets!r}"
            raise InputError(f"{given}, expected it with targets='recorded' only")
    bounds = np.array([system.start_range, system.start_speed, system.start_acceleration])[: len(system.weights)].T
    if system.targets == "random":
        return RandomPath(system.motion, bounds[0], bounds[1] - bounds[0])
    segments = tuple(Segment(seconds, acceleration=(a,)) for seconds, a in system.script)
    return ScriptedRange(bounds[0], bounds[1] - bounds[0], segments, system.dt * np.arange(system.horizon + 1))


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


def _recorded(system: KershawEvans) -> RecordedRange:
    """Windows of ``system.tracks`` as seen from ``system.radar``: geographic for degrees, in metres for metres."""
    if system.tracks is None:
        raise InputError("targets='recorded' needs a recording, expected tracks='FILE.csv'")
    tracks = read_tracks(system.tracks)
    place: tuple[float, ...] = (0.0, 0.0, 0.0)
    if system.radar is not None and tracks[0].origin is not None:
        tracks = read_tracks(system.tracks, origin=system.radar)
    elif system.radar is not None:
        place = (*system.radar, 0.0)[:3]
    positions = windows(tracks, system.dt, system.horizon, smoothing=system.smoothing)
    limits = (system.nearest_range, system.farthest_range)
    return RecordedRange(range_paths(positions, place, acceleration=system.model == "ca", limits=limits))
