"""Recorded tracks: reports of one target, cut at gaps and resampled to a smooth true path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline

from wavegym.core.array_checks import check_finite, check_shape
from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_non_negative, check_positive
from wavegym.targets.smoothing import FEWEST, choose_factor, smoothed

MOST_SAMPLES = 10_000_000
SHORTEST_GAP = 30.0  # s
GAP = 3.0  # a longer gap, in usual times between the reports of a track, where that is more than SHORTEST_GAP


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
        smoothing: time constant of the smoothing [s]; 0 for a curve that meets every report.
    """

    id: str
    dt: float
    times: FloatArray
    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray
    smoothing: float = 0.0


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

    @property
    def spacing(self) -> float:
        """The median time between reports [s]; 0 for a single report."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else 0.0

    def longest_gap(self, max_gap: float | None = 30.0) -> float:
        """``max_gap``; or, for None, three times the usual time between reports, at least 30 s."""
        return max(SHORTEST_GAP, GAP * self.spacing) if max_gap is None else check_positive("max_gap", max_gap, "s")

    def pieces(self, max_gap: float | None = 30.0) -> list[RecordedTrack]:
        """Cut the track between reports more than ``max_gap`` seconds apart; None: see ``longest_gap``.

        Raises:
            InputError: max_gap not > 0.
        """
        cuts = np.flatnonzero(np.diff(self.times) > self.longest_gap(max_gap)) + 1
        parts = zip(np.split(self.times, cuts), np.split(self.positions, cuts), strict=True)
        return [replace(self, times=times, positions=positions) for times, positions in parts]

    def choose_smoothing(self, max_gap: float | None = 30.0) -> float:
        """The time constant [s] for ``resample`` that predicts left-out reports best.

        Time constants of 0 to 8 times the usual time between reports are tried. Each report is left out in turn and
        predicted from the others. Errors of the reports that are independent, such as those of time stamps, are
        predicted better with more smoothing, manoeuvres with less. The least mean squared error decides. So smoothing
        moves the path by no more than the reports' own errors.

        Raises:
            InputError: max_gap not > 0.
        """
        parts = [(part.times - part.times[0], part.positions) for part in self.pieces(max_gap)]
        return choose_factor([part for part in parts if len(part[0]) >= FEWEST]) * self.spacing

    def resample(self, dt: float, max_gap: float | None = 30.0, smoothing: float | None = 0.0) -> list[Piece]:
        """Sample each gap-free stretch uniformly from its first report to its last.

        The curve between reports is the natural cubic spline. Of all curves through the reports it has the least
        integral of squared acceleration. It is the most probable path of the constant velocity model with white
        acceleration (Wahba 1978), the model of the trackers. Its acceleration is continuous, unlike PCHIP's. It does
        not depend on the direction of the axes; PCHIP is flat wherever one coordinate turns. Velocity and acceleration
        are derivatives of the curve, so all samples are consistent.

        Args:
            dt: time between samples [s].
            max_gap: longest time between reports without a cut [s]; None: three times the usual time between reports,
                at least 30 s.
            smoothing: time constant τ [s] of a smoothing spline that minimises Σ|report - curve|² +
                (τ⁴/h)∫|acceleration|² dt, h the mean time between reports. Motion faster than τ counts as error of the
                reports. 0: the curve meets every report. None: ``choose_smoothing``. Stretches of fewer than 5 reports
                are not smoothed.

        Returns:
            The stretches with at least two reports and two samples.

        Raises:
            InputError: dt or max_gap not > 0, a negative smoothing, or a dt that gives more than ten million samples.
        """
        check_positive("dt", dt, "s")
        if smoothing is not None:
            check_non_negative("smoothing", smoothing, "s")
        if self.duration / dt > MOST_SAMPLES:
            raise InputError(
                f"dt is {dt!r} s, expected a larger dt: track {self.id!r} would have over {MOST_SAMPLES} samples"
            )
        tau = self.choose_smoothing(max_gap) if smoothing is None else smoothing
        stretches = [part for part in self.pieces(max_gap) if part.duration >= dt]
        return [_resampled(part, dt, tau) for part in stretches]


def _resampled(part: RecordedTrack, dt: float, smoothing: float) -> Piece:
    # Times from the first report: times since 1970 would cost the spline half of its digits.
    t = part.times - part.times[0]
    tau = smoothing if len(t) >= FEWEST else 0.0
    curve = CubicSpline(t, smoothed(t, part.positions, tau) if tau else part.positions, bc_type="natural")
    count = int(np.floor(t[-1] / dt + 1e-9)) + 1
    samples = np.minimum(dt * np.arange(count), t[-1])
    positions, velocities, accelerations = (curve(samples, order) for order in range(3))
    return Piece(part.id, dt, part.times[0] + samples, positions, velocities, accelerations, tau)
