"""Recorded tracks: reports of one target, cut at gaps and resampled to a smooth true path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_smoothing_spline

from wavegym.core.array_checks import check_finite, check_shape
from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_non_negative, check_positive

MOST_SAMPLES = 10_000_000


@dataclass(frozen=True, eq=False)
class Piece:
    """A gap-free stretch of a track, sampled uniformly.

    Args:
        id: id of the recorded track.
        dt: time between samples [s].
        times: as recorded [s], (n,).
        positions: metres, (n, 3).
        velocities: m/s, (n, 3), the derivative of the curve that gives the positions.
        accelerations: m/s², (n, 3), its second derivative.
    """

    id: str
    dt: float
    times: FloatArray
    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray


@dataclass(frozen=True, eq=False)
class RecordedTrack:
    """The reports of one target in order of time.

    Args:
        id: as recorded.
        times: ascending [s], (report,).
        positions: metres, (report, 3): x, y, z as recorded, or east, north, up of the local tangent plane.
        height_known: False if no report had a height: the whole track then lies at height 0.
        dropped: number of dropped reports by reason: ``repeated time``, ``repeated position``, ``too fast``.
        source: file that holds the track.
        origin: latitude [deg], longitude [deg] and height [m] of the tangent plane's origin; None for x, y, z files.

    Raises:
        InputError: no reports, times that do not ascend, shapes that do not fit, or numbers that are not finite.
    """

    id: str
    times: FloatArray
    positions: FloatArray
    height_known: bool = True
    dropped: Mapping[str, int] = field(default_factory=dict)
    source: str = ""
    origin: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        times = check_finite("times", self.times)
        check_shape("times", times, (times.size,))
        check_shape("positions", check_finite("positions", self.positions), (len(times), 3))
        if not len(times) or (np.diff(times) <= 0.0).any():
            raise InputError(f"times of track {self.id!r} has {len(times)} values, expected at least one, ascending")

    @property
    def duration(self) -> float:
        """Time from the first report to the last [s]."""
        return float(self.times[-1] - self.times[0])

    def pieces(self, max_gap: float = 30.0) -> list[RecordedTrack]:
        """Cut the track between reports more than ``max_gap`` seconds apart.

        Raises:
            InputError: max_gap not > 0.
        """
        check_positive("max_gap", max_gap, "s")
        cuts = np.flatnonzero(np.diff(self.times) > max_gap) + 1
        parts = zip(np.split(self.times, cuts), np.split(self.positions, cuts), strict=True)
        return [replace(self, times=times, positions=positions) for times, positions in parts]

    def resample(self, dt: float, max_gap: float = 30.0, smoothing: float = 0.0) -> list[Piece]:
        """Sample each gap-free stretch uniformly from its first report to its last.

        The curve between reports is the natural cubic spline. Of all curves through the reports it has the least
        integral of squared acceleration. It is the most probable path of the constant velocity model with white
        acceleration (Wahba 1978), the model of the trackers. Its acceleration is continuous, unlike PCHIP's. It does
        not depend on the direction of the axes; PCHIP is flat wherever one coordinate turns. Velocity and acceleration
        are derivatives of the curve, so all samples are consistent.

        Args:
            dt: time between samples [s].
            max_gap: longest time between reports without a cut [s].
            smoothing: time constant τ [s] of a smoothing spline that minimises Σ|report - curve|² +
                (τ⁴/h)∫|acceleration|² dt, h the mean time between reports. Motion faster than τ counts as error of the
                reports. For aircraft reports every 10 s with time stamps to about 1 s, 5 to 7 s work well. 0: the curve
                meets every report. Stretches of fewer than 5 reports are not smoothed.

        Returns:
            The stretches with at least two reports and two samples.

        Raises:
            InputError: dt or max_gap not > 0, a negative smoothing, or a dt that gives more than ten million samples.
        """
        check_positive("dt", dt, "s")
        check_non_negative("smoothing", smoothing, "s")
        if self.duration / dt > MOST_SAMPLES:
            raise InputError(
                f"dt is {dt!r} s, expected a larger dt: track {self.id!r} would have over {MOST_SAMPLES} samples"
            )
        stretches = [part for part in self.pieces(max_gap) if part.duration >= dt]
        return [_resampled(part, dt, smoothing) for part in stretches]


def _resampled(part: RecordedTrack, dt: float, smoothing: float) -> Piece:
    # Times from the first report: times since 1970 would cost the spline half of its digits.
    t = part.times - part.times[0]
    if smoothing and len(t) >= 5:
        weight = smoothing**4 * (len(t) - 1) / t[-1]
        axes = [make_smoothing_spline(t, axis, lam=weight) for axis in part.positions.T]
        curve = BSpline(axes[0].t, np.stack([axis.c for axis in axes], axis=-1), axes[0].k)
    else:
        curve = CubicSpline(t, part.positions, bc_type="natural")
    count = int(np.floor(t[-1] / dt + 1e-9)) + 1
    samples = np.minimum(dt * np.arange(count), t[-1])
    return Piece(
        part.id, dt, part.times[0] + samples, curve(samples), curve.derivative(1)(samples), curve.derivative(2)(samples)
    )
