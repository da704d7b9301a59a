"""Coherent pulse train: one repeated pulse with the Doppler resolution of the whole dwell."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.action_sets import quantity
from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_positive
from wavegym.waveforms.fisher import FisherFactors
from wavegym.waveforms.numeric import sample
from wavegym.waveforms.waveform import Waveform

_NEGLIGIBLE = 1e-5  # amplitude relative to the peak, -100 dB


@dataclass(frozen=True)
class PulseTrain(Waveform):
    """``count`` coherent copies of a pulse at intervals of ``interval``, centred on t = 0, with unit energy in total.

    Pulses must not overlap: half an interval from its centre, a pulse must have fallen by 100 dB (for a Gaussian pulse:
    interval >= 9.6 durations). The Fisher information treats the pulses as disjoint; its error is then below 1e-9. The
    ambiguity function is that of the sum of whole pulses; ``envelope`` and ``phase`` are those of the nearest pulse.

    Args:
        pulse: the single pulse.
        count: B, number of pulses.
        interval: T1, pulse repetition interval, s.

    Raises:
        InputError: an invalid value, or pulses that overlap.
    """

    pulse: Waveform
    count: int = field(kw_only=True)
    interval: float = field(kw_only=True)

    def __post_init__(self) -> None:
        if not isinstance(self.pulse, Waveform):
            raise InputError(f"pulse is {self.pulse!r}, expected a Waveform such as GaussianChirp(duration=1e-6)")
        if isinstance(self.count, bool) or not isinstance(self.count, (int, np.integer)) or self.count < 1:
            raise InputError(f"count is {self.count!r}, expected an integer >= 1 (nearest: 1)")
        check_positive("interval", self.interval, "s")
        if self.count > 1:
            _check_disjoint(self.pulse, self.interval)

    @property
    def label(self) -> str:
        """``"16 x (up 1 us 10 MHz) every 1 ms"``."""
        return f"{self.count} x ({self.pulse.label}) every {quantity(self.interval, 's')}"

    @property
    def support(self) -> tuple[float, float]:
        """From the start of the first pulse to the end of the last, s."""
        low, high = self.pulse.support
        return (low + float(self._centres[0]), high + float(self._centres[-1]))

    @property
    def pieces(self) -> tuple[tuple[float, float], ...]:
        """The repeated pieces of the pulse, cut half-way between two pulses."""
        borders = self._centres[:-1] + 0.5 * self.interval + _middle(self.pulse)
        begins, ends = np.concatenate([[-np.inf], borders]), np.concatenate([borders, [np.inf]])
        low, high = np.array(self.pulse.pieces, dtype=np.float64).T
        low = np.maximum(self._centres[:, None] + low, begins[:, None]).ravel()
        high = np.minimum(self._centres[:, None] + high, ends[:, None]).ravel()
        return tuple((float(a), float(b)) for a, b in zip(low, high, strict=True) if a < b)

    def envelope(self, t: ArrayLike) -> FloatArray:
        """Real amplitude a(t), s^-1/2; t in s, any shape."""
        return self.pulse.envelope(self._pulse_time(t)) / math.sqrt(self.count)

    def phase(self, t: ArrayLike) -> FloatArray:
        """Phase, rad, the same in each pulse; t in s, any shape."""
        return self.pulse.phase(self._pulse_time(t))

    def fisher_factors(self) -> FisherFactors:
        """Closed form: the pulse's variance of t grows by T1^2 (B^2 - 1)/12; cov(t, w) and the mean of w^2 stay."""
        one = self.pulse.fisher_factors()
        residual, slope, pulse_spread = np.asarray(one.residual), np.asarray(one.slope), np.asarray(one.spread)
        dwell = self.interval * self.interval * (float(self.count) * self.count - 1.0) / 12.0
        spread = pulse_spread + dwell
        return FisherFactors(
            residual=residual + slope * slope * (pulse_spread * dwell / spread),
            slope=slope * (pulse_spread / spread),
            spread=spread,
        )

    def ambiguity_row(self, delay: float, dopplers: FloatArray) -> NDArray[np.complex128]:
        """chi(delay, nu): the sum of the pulse's own chi over pulse pairs m apart, weighted by a Dirichlet kernel."""
        low, high = self.pulse.support
        first = max(1 - self.count, int(np.ceil((delay - (high - low)) / self.interval)))
        last = min(self.count - 1, int(np.floor((delay + (high - low)) / self.interval)))
        row = np.zeros(len(dopplers), dtype=np.complex128)
        for apart in range(first, last + 1):
            lag = apart * self.interval
            pairs = _dirichlet(dopplers * self.interval, self.count - abs(apart)) * np.exp(-1j * np.pi * dopplers * lag)
            row += self.pulse.ambiguity_row(delay - lag, dopplers) * pairs
        return row / self.count

    def energy_interval(self, energy: float) -> tuple[float, float]:
        """That of the single pulse, in the pulse's own time."""
        return self.pulse.energy_interval(energy)

    def level_interval(self, ratio: float) -> tuple[float, float]:
        """That of the single pulse, in the pulse's own time."""
        return self.pulse.level_interval(ratio)

    @property
    def _centres(self) -> FloatArray:
        return (np.arange(self.count, dtype=np.float64) - 0.5 * (self.count - 1)) * self.interval

    def _pulse_time(self, t: ArrayLike) -> FloatArray:
        """Time within the nearest pulse."""
        t = np.asarray(t, dtype=np.float64)
        middle = 0.5 * (self.count - 1)
        nearest = np.clip(np.rint((t - _middle(self.pulse)) / self.interval + middle), 0, self.count - 1)
        return t - (nearest - middle) * self.interval


def _middle(pulse: Waveform) -> float:
    low, high = pulse.support
    return 0.5 * (low + high)


def _check_disjoint(pulse: Waveform, interval: float) -> None:
    """Raise an InputError if the pulse is not yet negligible half an interval from its centre."""
    samples = sample(pulse)
    middle = _middle(pulse)
    distance = np.abs(samples.times - middle).ravel()
    amplitude = np.abs(samples.values[0]).ravel()
    audible = _NEGLIGIBLE * amplitude.max()
    at_border = np.abs(pulse.envelope(middle + 0.5 * interval * np.array([-1.0, 1.0]))).max()
    if at_border <= audible and amplitude[distance >= 0.5 * interval].max(initial=0.0) <= audible:
        return
    reach = distance[amplitude > audible].max()
    shortest = 2.0 * distance[distance > reach].min(initial=0.5 * (pulse.support[1] - pulse.support[0]))
    raise InputError(
        f"interval is {interval!r} s, expected one in which the pulse falls by 100 dB before the next pulse "
        f"(nearest: {shortest:.6g})"
    )


def _dirichlet(turns: FloatArray, count: int) -> FloatArray:
    """sin(pi n x)/sin(pi x), exact at and near whole x."""
    whole = np.rint(turns)
    rest = turns - whole
    sign = np.where(np.mod(whole * (count - 1), 2) == 1, -1.0, 1.0)
    return sign * count * np.sinc(count * rest) / np.sinc(rest)
