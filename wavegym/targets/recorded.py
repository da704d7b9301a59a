"""Recorded tracks: reports of one target, cut at gaps and resampled to a smooth true path, and a track in figures.

A smoothing spline goes near the reports; its time constant is chosen from the reports themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh, solveh_banded

from wavegym.core.arrays import FloatArray, check_finite, check_shape
from wavegym.core.errors import InputError, check_non_negative, check_positive

FEWEST = 5  # reports of a stretch that is smoothed
# Time constants that are tried, in mean times between reports, up to a sixth of a block.
FACTORS = (0.0, *(2.0 ** (k / 2) for k in range(-4, 7)))
BLOCK = 48  # reports of a stretch that are tried together
MOST_BLOCKS = 8  # of a track, spread over its whole length
NEGLIGIBLE = 1e-3  # m
ENDS = 2  # reports at either end of a block that do not count: their prediction is an extrapolation
MOST_SAMPLES = 10_000_000
SHORTEST_GAP = 30.0  # s
GAP = 3.0  # a longer gap, in usual times between the reports of a track, where that is more than SHORTEST_GAP


def smoothed(times: FloatArray, positions: FloatArray, tau: float) -> FloatArray:
    """Positions (report, 3) that minimise Σ|report - curve|² + (τ⁴/h)∫|curve''|² dt, h the mean time between reports.

    The minimum is a natural cubic spline through the positions returned. Its second derivatives γ at the inner reports
    solve (R + λ QᵀQ) γ = Qᵀ y with λ = τ⁴/h (Green and Silverman 1994, section 2.3.3): five diagonals, so the effort is
    linear in the reports.

    Args:
        times: ascending [s], (report,), at least 3.
        positions: metres, (report, 3).
        tau: time constant [s], > 0.
    """
    h = np.diff(times)
    weight = tau**4 / h.mean()
    second = np.diff(np.diff(positions, axis=0) / h[:, None], axis=0)  # Qᵀ y
    before, after = 1.0 / h[:-1], 1.0 / h[1:]
    middle = -(before + after)
    bands = np.zeros((3, len(middle)))  # upper diagonals as LAPACK takes them, the main diagonal last
    bands[2] = (h[:-1] + h[1:]) / 3.0 + weight * (before**2 + middle**2 + after**2)
    bands[1, 1:] = h[1:-1] / 6.0 + weight * (middle[:-1] * before[1:] + after[:-1] * middle[1:])
    bands[0, 2:] = weight * after[:-2] * before[2:]
    bend = solveh_banded(bands, second)
    shift = np.zeros_like(positions)  # Q γ
    shift[:-2] += before[:, None] * bend
    shift[1:-1] += middle[:, None] * bend
    shift[2:] += after[:, None] * bend
    return positions - weight * shift


def choose_factor(stretches: Sequence[tuple[FloatArray, FloatArray]]) -> float:
    """The time constant, in mean times between reports, that predicts left-out reports best; 0 for few reports.

    Each report is left out in turn and predicted by the smoothing spline of the others. Independent errors of the
    reports are predicted better by a longer time constant, manoeuvres by a shorter one. The least mean squared error of
    prediction decides between ``FACTORS``.

    Args:
        stretches: times (report,) [s] and positions (report, 3) [m] of each stretch without a gap.
    """
    errors = [errors_of_prediction(*block) for block in _blocks(stretches)]
    if not errors:
        return 0.0
    squares = np.concatenate(errors, axis=1).mean(axis=1)
    return FACTORS[int((squares <= squares.min() + NEGLIGIBLE**2).argmax())]  # of equal errors the least smoothing


def errors_of_prediction(times: FloatArray, positions: FloatArray) -> FloatArray:
    """Squared distance of each inner report from its prediction by the others, (factor, report - 2 ENDS), m².

    A report's error of prediction is its residual over one minus its leverage. Residuals are A y, and one minus the
    leverages are the diagonal of A = Q (R/λ + QᵀQ)⁻¹ Qᵀ. The generalised eigenvectors of QᵀQ and R make A diagonal for
    all λ at once. Without smoothing both vanish alike; the factor R/λ is then R.
    """
    h = np.diff(times)
    h = h / h.mean()
    inner = np.arange(len(h) - 1)
    Q = np.zeros((len(times), len(inner)))
    Q[inner, inner], Q[inner + 2, inner] = 1.0 / h[:-1], 1.0 / h[1:]
    Q[inner + 1, inner] = -Q[inner, inner] - Q[inner + 2, inner]
    R = np.diag((h[:-1] + h[1:]) / 3.0)
    R[inner[:-1], inner[1:]] = R[inner[1:], inner[:-1]] = h[1:-1] / 6.0
    values, vectors = eigh(Q.T @ Q, R)
    basis = Q @ vectors  # (report, inner)
    gain = 1.0 / (1.0 + np.multiply.outer(np.array(FACTORS) ** 4, values))  # (factor, inner)
    residual = np.einsum("ij,fj,jk->fik", basis, gain, basis.T @ positions, optimize=True)
    leverage = gain @ np.square(basis).T
    error = residual / leverage[:, :, None]
    return np.square(error).sum(axis=2)[:, ENDS:-ENDS]


def _blocks(stretches: Sequence[tuple[FloatArray, FloatArray]]) -> list[tuple[FloatArray, FloatArray]]:
    """Blocks of up to ``BLOCK`` successive reports; of many blocks a few, evenly spread."""
    blocks = []
    for times, positions in stretches:
        count = max(1, len(times) // BLOCK)
        parts = zip(np.array_split(times, count), np.array_split(positions, count), strict=True)
        blocks += [part for part in parts if len(part[0]) >= FEWEST + 2 * ENDS]
    if len(blocks) > MOST_BLOCKS:
        blocks = [blocks[i] for i in np.linspace(0, len(blocks) - 1, MOST_BLOCKS).round().astype(int)]
    return blocks


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
