"""What was read of a recorded track: reports used and dropped, gaps, speeds, and how far smoothing moves the path."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import check_non_negative
from wavegym.targets.recorded import RecordedTrack
from wavegym.targets.smoothing import FEWEST, smoothed


class TrackSummary(NamedTuple):
    """A recorded track in figures; see ``summarise``."""

    id: str
    reports: int  # in the file
    used: int
    dropped: Mapping[str, int]  # reports left out, by reason
    start: float  # time of the first report used [s]
    duration: float  # from the first report used to the last [s]
    spacing: float  # median time between reports [s]
    gaps: int  # longer than the longest gap allowed: the track is cut there
    longest_gap: float  # [s]
    longest_piece: float  # longest stretch without a gap [s]
    least_speed: float  # of the path at the times of the reports [m/s]
    median_speed: float
    greatest_speed: float
    smoothing: float  # time constant [s]
    moved: float  # RMS distance from the reports to the smoothed path [m]
    height_known: bool


def summarise(track: RecordedTrack, max_gap: float | None = None, smoothing: float | None = None) -> TrackSummary:
    """A recorded track in figures.

    Args:
        track: the track.
        max_gap: longest time between reports without a cut [s]; None as in ``RecordedTrack.resample``.
        smoothing: time constant [s]; None: chosen from the reports.

    Raises:
        InputError: max_gap not > 0, or a negative smoothing.
    """
    if smoothing is not None:
        check_non_negative("smoothing", smoothing, "s")
    pieces = [piece for piece in track.pieces(max_gap) if len(piece.times) > 1]
    tau = track.choose_smoothing(max_gap) if smoothing is None else smoothing
    waits = np.diff(track.times)
    cut = waits[waits > track.longest_gap(max_gap)]
    speeds = np.concatenate([np.zeros(0), *(_speeds(piece, tau) for piece in pieces)])
    slowest, usual, fastest = np.quantile(speeds, (0.0, 0.5, 1.0)) if len(speeds) else (0.0, 0.0, 0.0)
    return TrackSummary(
        track.id,
        len(track.times) + sum(track.dropped.values()),
        len(track.times),
        dict(track.dropped),
        float(track.times[0]),
        track.duration,
        track.spacing,
        len(cut),
        float(waits.max()) if len(waits) else 0.0,
        max((piece.duration for piece in pieces), default=0.0),
        float(slowest),
        float(usual),
        float(fastest),
        tau,
        _moved(pieces, tau),
        track.height_known,
    )


def _speeds(piece: RecordedTrack, tau: float) -> FloatArray:
    """Speeds between the reports of a stretch, about one for each report [m/s]."""
    (path,) = piece.resample(piece.duration / len(piece.times), piece.duration + 1.0, tau)
    return np.asarray(np.linalg.norm(path.velocities, axis=1))


def _moved(pieces: list[RecordedTrack], tau: float) -> float:
    """RMS distance from the reports to the smoothed path [m]."""
    long = [piece for piece in pieces if len(piece.times) >= FEWEST]
    if not tau or not long:
        return 0.0
    away = [smoothed(piece.times - piece.times[0], piece.positions, tau) - piece.positions for piece in long]
    return float(np.sqrt(np.square(np.concatenate(away)).sum(axis=1).mean()))
