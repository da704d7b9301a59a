"""Recorded targets in a system: shared parameters, and the windows that a world draws."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from scipy.special import ndtr

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.parameters import parameter
from wavegym.core.traits import RecordedTargets
from wavegym.targets.recorded_paths import RecordedPaths, recorded_paths


def targets_parameter() -> Any:
    """The parameter ``targets`` of a system that draws them from its motion model, unless they are recorded."""
    return parameter("random", "paths drawn from the motion model, or windows of ``tracks``", unit="", truth=True)


def tracks_parameter(condition: str = "with targets='recorded'") -> Any:
    """The parameter ``tracks``."""
    return parameter(None, f"recording {condition}: a CSV file", unit="", truth=True)


def radar_parameter() -> Any:
    """The parameter ``radar``."""
    meaning = (
        "origin of the scene in the recording: latitude, longitude (degrees) and altitude (m), or x, y, z (m) if the "
        "file gives metres; by default the middle of the recording, or its origin"
    )
    return parameter(None, meaning, unit="", truth=True)


def farthest_range_parameter(metres: float) -> Any:
    """The parameter ``farthest_range``."""
    return parameter(metres, "recorded windows beyond this range are not used", unit="m", truth=True, gt=0)


def smoothing_parameter() -> Any:
    """The parameter ``smoothing``."""
    meaning = "time constant of the smoothing of recorded tracks; by default chosen for each track"
    return parameter(None, meaning, unit="s", truth=True, ge=0)


class PlaysRecordings(RecordedTargets):
    """A system whose true targets may follow recordings.

    The system has the parameters above and a ``motion`` whose names are the elements of the state. Its truth keeps the
    paths, or the windows and looks each state up.
    """

    @property
    def _recorded_shape(self) -> tuple[int, int]:
        """Number of targets, and steps of their paths."""
        raise NotImplementedError

    @cached_property
    def _recorded(self) -> RecordedPaths | None:
        """The windows of ``tracks``; None where targets follow the motion model. InputError if too few fit."""
        system: Any = self
        by_name = isinstance(system.targets, str)  # otherwise it is the number of targets, and ``tracks`` decides
        if system.targets != "recorded" if by_name else system.tracks is None:
            wanted = "targets='recorded'" if by_name else "tracks='FILE.csv'"
            for name in ("tracks", "radar"):
                if getattr(system, name) is not None:
                    raise InputError(f"{name} is {getattr(system, name)!s}, expected it with {wanted} only")
            return None
        if system.tracks is None:
            raise InputError("targets='recorded' needs a recording, expected tracks='FILE.csv'")
        targets, steps = self._recorded_shape
        return recorded_paths(
            system.tracks, system.motion.names, system.dt, steps, system.radar, system.smoothing,
            (0.0, system.farthest_range), targets,
        )  # fmt: skip

    @property
    def recorded_windows(self) -> Any:
        """The windows of ``tracks`` that are played, a ``wavegym.targets.Windows``; None without a recording."""
        return self._recorded and self._recorded.catalogue


def drawn_windows(recorded: RecordedPaths, normal: Array) -> Array:
    """Windows (env, target) from standard normal draws (env, target), which a motion model would use otherwise."""
    return recorded.draw(ndtr(normal))
