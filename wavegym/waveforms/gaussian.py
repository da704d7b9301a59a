"""Gaussian pulse with linear FM, the waveform of Kershaw and Evans, in closed form."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.action_sets import Library, quantity
from wavegym.core.arrays import FloatArray, check_broadcast, check_elements, check_finite
from wavegym.core.errors import InputError, check_choice, check_non_negative, check_positive
from wavegym.waveforms.fisher import FisherFactors
from wavegym.waveforms.waveform import Waveform

DIRECTIONS = ("up", "down")
_HALF_SUPPORT = 7.5  # durations; the amplitude there is 6e-13 of the peak
_EFFECTIVE_LENGTH = 2.0 * np.sqrt(2.0 * np.log(1000.0))  # durations, 7.4338


@dataclass(frozen=True, kw_only=True)
class GaussianChirp(Waveform):
    """Gaussian pulse with linear FM, s(t) = (pi k^2)^(-1/4) exp(-(1/(2 k^2) - j d g) t^2), d = +1 up, -1 down.

    The amplitude is above 1/1000 of its peak over the effective pulse length of 7.4338 k. Source: Kershaw and Evans,
    Optimal waveform selection for tracking systems, IEEE Trans. Inf. Theory 40(5), 1994.

    Args:
        duration: k, s.
        chirp_rate: g >= 0, rad/s^2; the instantaneous angular frequency is 2 d g t.
        direction: ``"up"`` or ``"down"``.

    Raises:
        InputError: a duration not > 0, a chirp_rate not >= 0, or an unknown direction.
    """

    duration: float
    chirp_rate: float = 0.0
    direction: str = "up"

    def __post_init__(self) -> None:
        check_positive("duration", self.duration, "s")
        check_non_negative("chirp_rate", self.chirp_rate, "rad/s^2")
        check_choice("direction", self.direction, DIRECTIONS)

    @property
    def signed_chirp_rate(self) -> float:
        """Chirp rate d g, rad/s^2, negative for a down-chirp."""
        return self.chirp_rate if self.direction == "up" else -self.chirp_rate

    @property
    def sweep(self) -> float:
        """Frequency swept during two durations, 2 k g/pi, Hz (see ``sweep_for_chirp_rate``)."""
        return float(sweep_for_chirp_rate(self.chirp_rate, self.duration))

    @property
    def effective_length(self) -> float:
        """Effective pulse length, s, over which the amplitude is above 1/1000 of its peak: 7.4338 k."""
        return float(_EFFECTIVE_LENGTH * self.duration)

    @property
    def label(self) -> str:
        """``"up 100 us 1 MHz"``: direction, duration k, sweep; ``"unmodulated 100 us"`` without chirp."""
        duration = quantity(self.duration, "s")
        return (
            f"{self.direction} {duration} {quantity(self.sweep, 'Hz')}"
            if self.chirp_rate
            else f"unmodulated {duration}"
        )

    @property
    def support(self) -> tuple[float, float]:
        """+-7.5 k, s."""
        half = _HALF_SUPPORT * self.duration
        return (-half, half)

    def envelope(self, t: ArrayLike) -> FloatArray:
        """Real amplitude a(t), s^-1/2; t in s, any shape."""
        x = np.asarray(t, dtype=np.float64) / self.duration
        return np.exp(-0.5 * (x * x)) / np.sqrt(np.sqrt(np.pi) * self.duration)

    def phase(self, t: ArrayLike) -> FloatArray:
        """Phase d g t^2, rad; t in s, any shape."""
        t = np.asarray(t, dtype=np.float64)
        return self.signed_chirp_rate * (t * t)

    def fisher_factors(self) -> FisherFactors:
        """Closed form (see ``gaussian_fisher_factors``)."""
        k, rate = np.array([self.duration, self.signed_chirp_rate], np.float64)
        return FisherFactors(*unchecked_gaussian_factors(k, rate))

    def energy_interval(self, energy: float) -> tuple[float, float]:
        """Closed form: +-k erfinv(energy), at most the support; 99 % of the energy lie in 3.643 k."""
        from scipy.special import erfinv  # the waveforms load without SciPy

        return self._within_support(self.duration * float(erfinv(energy)))

    def level_interval(self, ratio: float) -> tuple[float, float]:
        """Closed form: +-k sqrt(-2 ln ratio), at most the support; a ratio of 1/1000 gives ``effective_length``."""
        return self._within_support(self.duration * float(np.sqrt(-2.0 * np.log(ratio))))

    def _within_support(self, half: float) -> tuple[float, float]:
        half = min(half, self.support[1])
        return (-half, half)


def gaussian_fisher_factors(duration: ArrayLike, signed_chirp_rate: ArrayLike) -> FisherFactors:
    """Factored Fisher information of Gaussian chirps at SNR 1: r = 1/(2 k^2), b = 2 d g, v = k^2/2.

    Durations (s) and signed chirp rates (rad/s^2) broadcast. det J = r v = 1/4 for all of them.

    Raises:
        InputError: a duration that is not a finite number > 0, or a chirp rate that is not finite.
    """
    k, rate = check_elements(check_positive, "duration", duration), check_finite("signed_chirp_rate", signed_chirp_rate)
    check_broadcast(duration=k, signed_chirp_rate=rate)
    return FisherFactors(*unchecked_gaussian_factors(k, rate))


def unchecked_gaussian_factors(k: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The fields of ``gaussian_fisher_factors`` without checks, for ``unchecked_covariance``."""
    square = k * k
    return 0.5 / square, 2.0 * rate, 0.5 * square


def gaussian_measurement_covariance(
    duration: ArrayLike, signed_chirp_rate: ArrayLike, carrier_hz: ArrayLike
) -> FloatArray:
    """Measurement covariance of Gaussian chirps at SNR 1, for grids of parameters.

    R = [[c^2 k^2/2, -d c^2 g k^2/wc], [., (c/wc)^2 (1/(2 k^2) + 2 g^2 k^2)]], wc = 2 pi fc (Kershaw and Evans 1994).

    Args:
        duration: k, s.
        signed_chirp_rate: d g, rad/s^2, negative for a down-chirp.
        carrier_hz: fc, Hz; all three broadcast.

    Returns:
        (..., 2, 2) covariances of (range in m, range-rate in m/s), bit for bit independent of the batch.

    Raises:
        InputError: a duration or carrier that is not a finite number > 0, or a chirp rate that is not finite.
    """
    return gaussian_fisher_factors(duration, signed_chirp_rate).measurement_covariance(carrier_hz)


def chirp_rate_for_sweep(sweep_hz: ArrayLike, duration: ArrayLike) -> FloatArray:
    """Chirp rate g = pi sweep/(2 k), rad/s^2, that sweeps ``sweep_hz`` (Hz) in two durations k (s); they broadcast.

    InputError for a duration that is not a finite number > 0, or a sweep that is not finite.
    """
    k = check_elements(check_positive, "duration", duration)
    return np.pi * check_finite("sweep_hz", sweep_hz) / (2.0 * k)


def sweep_for_chirp_rate(chirp_rate: ArrayLike, duration: ArrayLike) -> FloatArray:
    """Sweep 2 k g/pi, Hz, of a chirp rate g (rad/s^2) at duration k (s): the inverse of ``chirp_rate_for_sweep``.

    InputError for a duration that is not a finite number > 0, or a chirp rate that is not finite.
    """
    k = check_elements(check_positive, "duration", duration)
    return 2.0 * k * check_finite("chirp_rate", chirp_rate) / np.pi


def gaussian_chirp_library(durations: Iterable[float], sweeps: Iterable[float]) -> Library:
    """All Gaussian chirps of the given durations and sweeps; the sweep varies fastest.

    Args:
        durations: k, s.
        sweeps: Hz swept in two durations, g = pi |sweep|/(2 k); positive for an up-chirp, negative for a down-chirp,
            0 (once) for an unmodulated pulse.

    Raises:
        InputError: a duration not > 0, a sweep that is not finite, a repeated value, or no values.
    """
    rows, columns = [float(k) for k in durations], [float(sweep) for sweep in sweeps]
    for k in rows:
        check_positive("duration", k, "s")
    for sweep in columns:
        if not math.isfinite(sweep):
            raise InputError(f"sweep is {sweep} Hz, expected a finite number")
    return Library(
        tuple(
            GaussianChirp(
                duration=k,
                chirp_rate=float(chirp_rate_for_sweep(abs(sweep), k)),
                direction="down" if sweep < 0 else "up",
            )
            for k in rows
            for sweep in columns
        )
    )
