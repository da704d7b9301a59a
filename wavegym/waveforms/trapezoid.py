"""Generalised FM chirps with a trapezoid envelope, the waveforms of Sira et al., with exact moments."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.action_sets import Library, quantity
from wavegym.core.arrays import FloatArray, check_broadcast, check_elements, check_finite
from wavegym.core.errors import InputError, check_choice, check_positive
from wavegym.waveforms.chirp_laws import CHIRP_LAWS, parse_law, resolve_shape
from wavegym.waveforms.fisher import FisherFactors
from wavegym.waveforms.gaussian import DIRECTIONS
from wavegym.waveforms.numeric import resolve
from wavegym.waveforms.waveform import Waveform

_TWO_PI = 2.0 * np.pi
_RISE = 0.05  # of the duration
_BEND = 1e-6  # of the sweep: below it the bend of a law is rounding noise


@dataclass(frozen=True)
class ChirpLaw:
    """A frequency law with a trapezoid envelope: the moments that determine the Fisher information.

    u in [0, 1] is the elapsed fraction of the pulse, f(u) the reached fraction of the sweep and a(u) the unit-energy
    envelope. Averages are weighted by a^2.

    Attributes:
        kind: ``"lfm"``, ``"pfm"``, ``"hfm"`` or ``"efm"``.
        shape: kappa for ``"pfm"``, g for ``"hfm"`` and ``"efm"``, 0 for ``"lfm"``.
        rise_fraction: fraction of the pulse in which the envelope rises, equal to that in which it falls.
        spread: variance of u.
        slope: slope of the regression of f on u; 1 for ``"lfm"``.
        residual: residual variance of f in the regression; exactly 0 for ``"lfm"``.
        bandwidth: integral of a'^2.
    """

    kind: str
    shape: float
    rise_fraction: float
    spread: float
    slope: float
    residual: float
    bandwidth: float

    @property
    def moments(self) -> FloatArray:
        """(spread, slope, residual, bandwidth), the argument of ``trapezoid_fisher_factors``; (4,)."""
        return np.array([self.spread, self.slope, self.residual, self.bandwidth])

    @property
    def name(self) -> str:
        """``"LFM"``, ``"PFM3"``, ``"HFM"`` or, where the shape is not the usual one, ``"HFM0.3"``."""
        shown = self.kind == "pfm" or self.shape != CHIRP_LAWS.get(self.kind).default
        return self.kind.upper() + (f"{self.shape:g}" if shown else "")


def chirp_law(kind: str, shape: float | None = None, rise_fraction: float = _RISE) -> ChirpLaw:
    """Frequency law with its moments by Gauss-Legendre quadrature to rounding error; results are cached.

    Args:
        kind: ``"lfm"``, ``"pfm"``, ``"hfm"`` or ``"efm"`` or a registered law.
        shape: kappa in [2, 64] for ``"pfm"`` (default 3), g in [0.01, 100] for ``"hfm"`` and ``"efm"`` (default 0.5).
        rise_fraction: tf/lam in (0, 0.5].

    Raises:
        InputError: an unknown kind, or a shape or rise fraction out of range.
    """
    value = resolve_shape(kind, shape)
    if not 0 < rise_fraction <= 0.5:
        raise InputError(
            f"rise_fraction is {rise_fraction!r}, expected a fraction of the pulse in (0, 0.5] (nearest: "
            f"{0.5 if rise_fraction > 0 else _RISE:g})"
        )
    return _law(kind, value, float(rise_fraction))


@lru_cache(maxsize=4096)
def _law(kind: str, shape: float, rise: float) -> ChirpLaw:
    edges = np.array([0.0, rise, 1.0 - rise, 1.0] if rise < 0.5 else [0.0, 0.5, 1.0])
    kinks = np.sqrt(np.sqrt(edges))
    frequency = CHIRP_LAWS.get(kind).frequency

    def bend(x: FloatArray) -> FloatArray:  # difference from a linear law: exactly 0 for LFM
        u = _fourth_power(x)
        return (frequency(u, shape) - u)[None]

    # In x = u^(1/4): a power law of fractional kappa is not smooth at u = 0, but smooth enough in x.
    samples = resolve(bend, kinks[:-1], kinks[1:], np.array([_BEND]), f"law {kind!r} of shape {shape:g}")
    x = samples.times
    u = _fourth_power(x)
    ramp = np.clip(np.minimum(u, 1.0 - u) / rise, 0.0, 1.0)
    square = 1.0 / (1.0 - 4.0 * rise / 3.0)  # a^2 where the envelope is flat
    density = square * (ramp * ramp) * (4.0 * x * x * x) * samples.weights
    h, time = samples.values[0], u - 0.5
    h = h - (h * density).sum()
    spread = (time * time * density).sum()
    excess = (time * h * density).sum() / spread
    left = h - excess * time
    return ChirpLaw(
        kind=kind,
        shape=shape,
        rise_fraction=rise,
        spread=float(spread),
        slope=float(1.0 + excess),
        residual=float((left * left * density).sum()),
        bandwidth=float(2.0 * square / rise),
    )


def _fourth_power(x: FloatArray) -> FloatArray:
    square = x * x
    return square * square


def trapezoid_fisher_factors(moments: ArrayLike, duration: ArrayLike, signed_sweep: ArrayLike) -> FisherFactors:
    """Factored Fisher information of trapezoid chirps at SNR 1.

    r = bandwidth/lam^2 + (2 pi D)^2 residual, b = 2 pi d D slope/lam, v = spread lam^2.

    Args:
        moments: (spread, slope, residual, bandwidth) of each chirp's law, (..., 4): ``ChirpLaw.moments``.
        duration: lam, s, (...).
        signed_sweep: d D, Hz, negative for a down-chirp, (...); the three broadcast.

    Raises:
        InputError: an invalid shape or value.
    """
    m, length = check_finite("moments", moments, 4), check_elements(check_positive, "duration", duration)
    sweep = check_finite("signed_sweep", signed_sweep)
    check_broadcast(moments=m[..., 0], duration=length, signed_sweep=sweep)
    return FisherFactors(*unchecked_trapezoid_factors(m, length, sweep))


def unchecked_trapezoid_factors(
    m: FloatArray, length: FloatArray, sweep: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The fields of ``trapezoid_fisher_factors`` without checks, for ``unchecked_covariance``."""
    swing = _TWO_PI * sweep  # rad/s
    square = length * length
    return (
        m[..., 3] / square + (swing * swing) * m[..., 2],
        swing * m[..., 1] / length,
        m[..., 0] * square,
    )


def chirp_measurement_covariance(
    moments: ArrayLike, duration: ArrayLike, signed_sweep: ArrayLike, carrier_hz: ArrayLike
) -> FloatArray:
    """Measurement covariance of trapezoid chirps of any laws at SNR 1, for grids of parameters.

    Args:
        moments: (spread, slope, residual, bandwidth) of each chirp's law, (..., 4). Stack ``ChirpLaw.moments`` to mix
            laws in a batch.
        duration: lam, s, (...).
        signed_sweep: d D, Hz, negative for a down-chirp, (...).
        carrier_hz: fc, Hz, (...); all four broadcast.

    Returns:
        (..., 2, 2) covariances of (range in m, range-rate in m/s), bit for bit independent of the batch.

    Raises:
        InputError: as ``trapezoid_fisher_factors``, and for a carrier that is not a finite number > 0.
    """
    return trapezoid_fisher_factors(moments, duration, signed_sweep).measurement_covariance(carrier_hz)


@dataclass(frozen=True, kw_only=True)
class TrapezoidChirp(Waveform):
    """Chirp that sweeps D Hz by one of four laws, with a trapezoid envelope of total duration lam.

    The envelope rises in tf, is flat for T and falls in tf: lam = T + 2 tf. With alpha^2 = 1/(T + 2 tf/3) the energy is
    1.
    The frequency is zero in the middle of the sweep. It runs from -D/2 to D/2 (up), or has the opposite sign (down).
    Source: Sira, Papandreou-Suppappola, Morrell and Cochran, Waveform-agile sensing for tracking multiple targets in
    clutter, Table 1 and eq. (7), whose rising edge is read as (alpha/tf)(t + T/2 + tf).

    Args:
        kind: ``"lfm"``, ``"pfm"`` (power), ``"hfm"`` (hyperbolic) or ``"efm"`` (exponential).
        duration: lam, s.
        sweep: D >= 0, Hz.
        shape: kappa for ``"pfm"`` (default 3), g = gamma/lam for ``"hfm"`` and ``"efm"`` (default 0.5).
        direction: ``"up"`` (frequency rises over the pulse) or ``"down"`` (its negative).
        rise: tf, s, at most half the duration; default lam/20.

    Raises:
        InputError: a value out of range, or a chirp that would fold.
    """

    kind: str
    duration: float
    sweep: float
    shape: float | None = None
    direction: str = "up"
    rise: float | None = None
    law: ChirpLaw = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_positive("duration", self.duration, "s")
        if not 0 <= self.sweep < np.inf:
            hint = "; for a falling frequency use direction='down'" if self.sweep < 0 else ""
            raise InputError(f"sweep is {self.sweep!r} Hz, expected a finite number >= 0{hint}")
        check_choice("direction", self.direction, DIRECTIONS)
        object.__setattr__(self, "law", chirp_law(self.kind, self.shape, self._rise_fraction()))

    def _rise_fraction(self) -> float:
        if self.rise is None:
            return _RISE
        half = 0.5 * self.duration
        if not 0 < self.rise <= half:
            wanted = f"a time > 0 and at most half the duration (nearest: {half if self.rise > 0 else 0.1 * half:g})"
            raise InputError(f"rise is {self.rise!r} s, expected {wanted}")
        # To 15 digits: the rounding error of a product with the duration must not make a new law.
        return float(f"{self.rise / self.duration:.15g}")

    @property
    def signed_sweep(self) -> float:
        """Sweep d D, Hz, negative for a down-chirp."""
        return self.sweep if self.direction == "up" else -self.sweep

    @property
    def label(self) -> str:
        """``"PFM3 up 100 us 15 MHz"``: law, direction, duration, sweep, and the rise if it is not lam/20."""
        duration = quantity(self.duration, "s")
        chirp = f"{self.law.name} {self.direction} {duration} {quantity(self.sweep, 'Hz')}"
        rise = self.law.rise_fraction
        edges = "" if rise == _RISE else f" rise {quantity(rise * self.duration, 's')}"
        return (chirp if self.sweep else f"unmodulated trapezoid {duration}") + edges

    @property
    def support(self) -> tuple[float, float]:
        """+-lam/2, s."""
        return (-0.5 * self.duration, 0.5 * self.duration)

    @property
    def pieces(self) -> tuple[tuple[float, float], ...]:
        """Rising edge, flat top, falling edge, s; a triangle has no top."""
        outer = 0.5 * self.duration
        inner = (0.5 - self.law.rise_fraction) * self.duration
        edges = ((-outer, -inner), (-inner, inner), (inner, outer))
        return edges if inner > 0 else edges[::2]

    def envelope(self, t: ArrayLike) -> FloatArray:
        """Real amplitude a(t), s^-1/2; t in s, any shape."""
        rise = self.law.rise_fraction * self.duration
        ramp = (0.5 * self.duration - np.abs(np.asarray(t, dtype=np.float64))) / rise
        return np.clip(ramp, 0.0, 1.0) / np.sqrt(self.duration - 4.0 * rise / 3.0)

    def phase(self, t: ArrayLike) -> FloatArray:
        """Phase, rad, constant outside the pulse; t in s, any shape."""
        u = np.clip(np.asarray(t, dtype=np.float64) / self.duration + 0.5, 0.0, 1.0)
        turns = CHIRP_LAWS.get(self.kind).phase(u, self.law.shape) - 0.5 * u
        return _TWO_PI * self.signed_sweep * self.duration * turns

    def fisher_factors(self) -> FisherFactors:
        """From the moments of the law (see ``trapezoid_fisher_factors``)."""
        return trapezoid_fisher_factors(self.law.moments, self.duration, self.signed_sweep)

    def energy_interval(self, energy: float) -> tuple[float, float]:
        """Closed form; the whole pulse at ``energy`` = 1."""
        rise, left_out = self.law.rise_fraction, 0.5 * (1.0 - energy) * (1.0 - 4.0 * self.law.rise_fraction / 3.0)
        in_rise = rise / 3.0  # energy of the rise, in units of the flat top's density
        cut = float(np.cbrt(3.0 * rise * rise * left_out)) if left_out <= in_rise else rise + left_out - in_rise
        return self._cut(cut)

    def level_interval(self, ratio: float) -> tuple[float, float]:
        """Closed form; the whole pulse as ``ratio`` goes to 0."""
        return self._cut(self.law.rise_fraction * ratio)

    def _cut(self, share: float) -> tuple[float, float]:
        """The pulse without this share of its duration at each end."""
        half = (0.5 - share) * self.duration
        return (-half, half)

    def measurement_covariance(self, carrier_hz: float, snr: float) -> FloatArray:
        """Cramer-Rao covariance of (range in m, range-rate in m/s), (2, 2).

        Args:
            carrier_hz: carrier frequency, Hz, above the sweep: a lower carrier would fold through zero frequency.
            snr: eta = 2E/N0, linear.

        Raises:
            InputError: an argument that is not a finite number > 0, or a sweep that reaches the carrier.
        """
        covariance = super().measurement_covariance(carrier_hz, snr)
        if not self.sweep < carrier_hz:
            raise InputError(
                f"sweep of {self.label} is {self.sweep!r} Hz, expected less than the carrier, {carrier_hz!r} Hz: "
                "the chirp folds through zero frequency"
            )
        return covariance


def trapezoid_chirp_library(
    kinds: Iterable[str],
    durations: Iterable[float],
    sweeps: Iterable[float],
    directions: Iterable[str] = DIRECTIONS,
) -> Library:
    """All trapezoid chirps of the given laws, durations, sweeps and directions; the direction varies fastest.

    Args:
        kinds: laws such as ``"lfm"``, ``"pfm"``, ``"pfm:2.5"``, ``"hfm:0.3"``: a kind, and its shape if not default.
        durations: lam, s.
        sweeps: D, Hz.
        directions: ``"up"``, ``"down"`` or both.

    Raises:
        InputError: a value that ``TrapezoidChirp`` refuses, a repeated waveform (sweep 0 gives the same waveform for
            each kind and direction), or no values.
    """
    laws = [parse_law(kind) for kind in kinds]
    lengths, widths, senses = [float(k) for k in durations], [float(sweep) for sweep in sweeps], list(directions)
    return Library(
        tuple(
            TrapezoidChirp(kind=kind, shape=shape, duration=duration, sweep=sweep, direction=direction)
            for kind, shape in laws
            for duration in lengths
            for sweep in widths
            for direction in senses
        )
    )
