"""Clutter of scatterers: what a pulse or a train receives of a field of many small ones.

The scatterers lie densely over range. Their range-rates have a Gaussian law: narrow about 0 for ground, shifted and
wider for sea or rain. A matched filter for range r and range-rate v receives the share |chi(2 (r - r') / c,
-2 fc (v - v') / c)|^2 of the energy of a scatterer at r' with v'. With noise of unit power, the mean power of clutter
in its output is

    c(r, v) = int int kappa(r') f(v') |chi|^2 dr' dv'.

kappa is the mean E/N0 of all scatterers within a metre of range, and f the density of their range-rates. An echo of
energy E has a signal-to-clutter-and-noise ratio of E / N0 / (1 + c).

Pulses of a train that are m apart receive scatterers m unambiguous ranges farther away or nearer. The sum over such
pairs has a closed form for a Gaussian law.

Clutter of few strong scatterers is spiky: its local power is c g, with a texture g of mean 1. In K-distributed clutter
g has a gamma law, in Weibull clutter the inverse of a positive stable law (Kanter 1975). A receiver that knows only the
mean has a threshold of T times 1 + c (``exceedance``). One that measures the local power in the cells around has T
times 1 + c g: its false alarms are those of noise, and the texture changes the echo's SNR from look to look.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal, special
from scipy.constants import speed_of_light

from wavegym.core.arrays import Array, check_broadcast, check_elements, check_finite
from wavegym.core.errors import InputError, check_choice, check_non_negative, check_positive, check_within
from wavegym.sensors.scatterers_kernels import ClutterField
from wavegym.waveforms import PulseTrain
from wavegym.waveforms.waveform import Waveform

Kind = Literal["ground", "sea", "rain"]
Amplitude = Literal["rayleigh", "k", "weibull"]
"""The names of the laws of the clutter's amplitude."""
AMPLITUDES = get_args(Amplitude)
RATE_STEPS = 16  # of range-rates, in a Doppler filter's width
RANGE_STEPS = 16  # of a table, for a factor of e
RATE_NODES = 15  # of a mean over range-rates, within a pulse
DELAYS = 6  # of an integral over delays, in 1 / sqrt(J)
TEXTURE_NODES = 64  # of a mean over textures, on each axis
LIKELY_TEXTURES = 256
LEAST_SHAPE = 0.2


@dataclass(frozen=True, kw_only=True)
class Scatterers:
    """A field of scatterers around a radar.

    Args:
        density: kappa at the reference range, 1/m, >= 0.
        reference_range: m.
        exponent: kappa falls with this power of the range: 3 for a surface, 2 for rain, 0 for a uniform field.
        nearest: range below which there are none, m.
        rate: mean range-rate, m/s.
        spread: standard deviation of the range-rates, m/s, >= 0.
        amplitude: "rayleigh" for very many small scatterers, "k" or "weibull" for fewer and stronger ones.
        shape: of "k" (of its gamma law) or "weibull" (at most 2); the smaller, the spikier. At least 0.2.

    Raises:
        InputError: a value out of range, or a shape of Rayleigh clutter, which has none.
    """

    density: float
    reference_range: float
    exponent: float = 3.0
    nearest: float = 100.0
    rate: float = 0.0
    spread: float = 0.5
    amplitude: Amplitude = "rayleigh"
    shape: float | None = None

    def __post_init__(self) -> None:
        check_non_negative("density", self.density, "1/m")
        check_positive("reference_range", self.reference_range, "m")
        check_non_negative("exponent", self.exponent)
        check_positive("nearest", self.nearest, "m")
        check_within("rate", self.rate, -speed_of_light, speed_of_light, "m/s")
        check_non_negative("spread", self.spread, "m/s")
        check_choice("amplitude", self.amplitude, AMPLITUDES)
        if (self.shape is None) != (self.amplitude == "rayleigh"):
            wanted = "None" if self.shape is not None else "a number"
            raise InputError(f"shape is {self.shape!r}, expected {wanted} with amplitude={self.amplitude!r}")
        if self.shape is not None:
            check_within("shape", self.shape, LEAST_SHAPE, 2.0 if self.amplitude == "weibull" else math.inf)

    def per_metre(self, ranges: ArrayLike) -> Array:
        """kappa, 1/m, at ranges in m, (...)."""
        r = np.asarray(ranges, np.float64)
        kappa = self.density * (self.reference_range / np.maximum(r, self.nearest)) ** self.exponent
        return np.where(r >= self.nearest, kappa, 0.0)


KINDS: dict[Kind, Scatterers] = {
    "ground": Scatterers(density=0.5, reference_range=20e3, spread=0.3),
    "sea": Scatterers(density=0.2, reference_range=20e3, rate=2.0, spread=1.5),
    "rain": Scatterers(density=0.05, reference_range=20e3, exponent=2.0, rate=8.0, spread=3.0),
}
"""Fields by name. 0.5 / m at 20 km is the ground's where eta of 1 m^2 is 16 dB there, in a beam of 1 deg, with a
reflectivity of -40 dB."""


def clutter_field(
    scatterers: Scatterers, waveforms: Sequence[Waveform], carrier_hz: float, farthest: float, fastest: float
) -> ClutterField:
    """``clutter_power`` of several waveforms, tabulated for kernels.

    Args:
        scatterers: the field.
        waveforms: pulses or trains.
        carrier_hz: fc, Hz.
        farthest: greatest range of a filter, m; farther away the clutter is the same.
        fastest: greatest range-rate of a filter, m/s; beyond it the clutter is the same.
    """
    check_positive("fastest", fastest, "m/s")
    nearest = scatterers.nearest
    count = 1 + math.ceil(RANGE_STEPS * math.log(max(farthest / nearest, math.e)))
    ranges = np.geomspace(nearest, max(farthest, math.e * nearest), count)
    filters = [waveform.count * waveform.interval for waveform in waveforms if isinstance(waveform, PulseTrain)]
    width = speed_of_light / (2.0 * carrier_hz * max(filters)) if filters else fastest
    rates = np.linspace(-fastest, fastest, 1 + 2 * math.ceil(RATE_STEPS * fastest / width))
    power = [clutter_power(scatterers, waveform, carrier_hz, ranges, rates) for waveform in waveforms]
    per_e = (count - 1) / math.log(ranges[-1] / nearest)
    per_speed = (len(rates) - 1) / (2.0 * fastest)
    return ClutterField(np.array(power), nearest, per_e, -fastest, per_speed, likely_textures(scatterers))


def clutter_power(
    scatterers: Scatterers, waveform: Waveform, carrier_hz: float, ranges: ArrayLike, rates: ArrayLike
) -> Array:
    """c(r, v): mean power of clutter in a filter's output, over that of the noise, (range, rate).

    Args:
        scatterers: the field.
        waveform: a pulse, or a ``PulseTrain``.
        carrier_hz: fc, Hz.
        ranges: of the filter, m, (range,) or a number.
        rates: of the filter, m/s, (rate,) or a number.

    Raises:
        InputError: ranges or rates that are not finite, or a carrier_hz that is not > 0.
    """
    check_positive("carrier_hz", carrier_hz, "Hz")
    r, v = (np.atleast_1d(check_finite(name, x)) for name, x in (("ranges", ranges), ("rates", rates)))
    train = waveform if isinstance(waveform, PulseTrain) else PulseTrain(waveform, count=1, interval=1.0)
    v, fold = v - scatterers.rate, 0.5 * speed_of_light * train.interval
    nodes = _pulse_rates(train.pulse, carrier_hz, v)
    farther, passed = _passed_energy(train.pulse, carrier_hz, scatterers.spread, nodes)
    shares = _pair_shares(train, carrier_hz, scatterers.spread, v)
    power = np.zeros((len(r), len(v)))
    for apart, share in zip(range(1 - train.count, train.count), shares, strict=True):
        received = scatterers.per_metre(r[:, None] + farther + apart * fold) @ passed  # (range, node)
        power += share * [np.interp(v, nodes, row) for row in received]
    return power


def _pulse_rates(pulse: Waveform, carrier_hz: float, rates: Array) -> Array:
    """Rising range-rates between which a single pulse's filter hardly changes: ``rates``, or fewer."""
    begin, end = pulse.support
    steps = 2.0 * carrier_hz / speed_of_light * (end - begin) * np.ptp(rates)
    count = 2 + math.ceil(RATE_STEPS * steps)
    return np.linspace(rates.min(), rates.max(), count) if count < len(rates) else np.unique(rates)


def _passed_energy(pulse: Waveform, carrier_hz: float, spread: float, rates: Array) -> tuple[Array, Array]:
    """How much farther than the filter's range scatterers are, m, (n,), and |chi|^2 times the distance of two of them.

    The second, (n, rate), is the mean over range-rates; rates: of the filter, less the mean of the scatterers.
    """
    begin, end = pulse.support
    count = math.ceil(DELAYS * (end - begin) * math.sqrt(pulse.fisher_information()[0, 0]))
    t, step = np.linspace(begin, end, count, retstep=True)
    sent = pulse.signal(t)
    widths = 2.0 * carrier_hz / speed_of_light * (end - begin) * spread  # of a pulse's filter, in the spread
    nodes, weights = np.polynomial.hermite_e.hermegauss(min(1 + math.ceil(RATE_STEPS * widths), RATE_NODES))
    turns = 4.0j * np.pi * carrier_hz / speed_of_light * t  # rad in t, at 1 m/s
    passed = np.empty((2 * count - 1, len(rates)))
    for n, rate in enumerate(rates):
        chi = [signal.correlate(sent * np.exp(turns * (rate - spread * node)), sent, method="fft") for node in nodes]
        passed[:, n] = weights / weights.sum() @ np.square(np.abs(step * np.array(chi)))
    farther = 0.5 * speed_of_light * step * np.arange(count - 1, -count, -1)
    return farther, 0.5 * speed_of_light * step * passed


def _pair_shares(train: PulseTrain, carrier_hz: float, spread: float, rates: Array) -> Array:
    """Share of the energy that comes through pulses that are m apart, (m from 1 - count to count - 1, rate).

    The mean over scatterers of |sum of n - |m| turning phasors|^2 over the square of the n pulses.
    """
    lag = np.arange(train.count)[:, None]
    turns = 4.0 * np.pi * carrier_hz * train.interval / speed_of_light * lag  # rad in a second, at 1 m/s
    mean = np.where(lag == 0, 1.0, 2.0) * np.cos(turns * rates) * np.exp(-0.5 * np.square(turns * spread))
    pairs = np.maximum(train.count - lag - lag.T, 0)  # (m, lag)
    later = np.maximum(pairs @ mean, 0.0) / train.count**2
    return np.concatenate([later[:0:-1], later])


def exceedance(
    threshold: ArrayLike, clutter: ArrayLike, snr: ArrayLike, amplitude: Amplitude = "rayleigh", shape: float = 1.0
) -> Array:
    """Probability that the power of echo, clutter and noise exceeds T (1 + c).

    With an echo of SNR 0 it is that of a false alarm. The echo fluctuates as Swerling 1.

    Args:
        threshold: T, over the mean power of clutter and noise, >= 0, any shape.
        clutter: c, over the power of the noise, >= 0, any shape that broadcasts.
        snr: eta = 2E/N0 of the echo, without clutter, >= 0, any shape that broadcasts.
        amplitude, shape: see ``Scatterers``.

    Raises:
        InputError: an invalid shape or value.
    """
    T, c, eta = check_broadcast(
        threshold=check_elements(check_non_negative, "threshold", threshold),
        clutter=check_elements(check_non_negative, "clutter", clutter),
        snr=check_elements(check_non_negative, "snr", snr),
    )
    g, weights = texture(check_choice("amplitude", amplitude, AMPLITUDES), shape)
    power = 1.0 + c[..., None] * g + 0.5 * eta[..., None]
    return np.asarray(np.exp(-(T * (1.0 + c))[..., None] / power) @ weights)


def likely_textures(scatterers: Scatterers) -> Array:
    """Equally likely values of the local over the mean power, rising, of mean 1, (value,)."""
    g, weights = texture(scatterers.amplitude, scatterers.shape or 1.0)
    order = np.argsort(g)
    below = np.cumsum(weights[order]) - 0.5 * weights[order]
    values = np.interp((np.arange(LIKELY_TEXTURES) + 0.5) / LIKELY_TEXTURES, below, g[order])
    return values / values.mean()


@lru_cache(maxsize=64)
def texture(amplitude: Amplitude, shape: float) -> tuple[Array, Array]:
    """Values (node,) of the local over the mean power of clutter, and their probabilities."""
    if amplitude == "rayleigh":
        return np.ones(1), np.ones(1)
    if amplitude == "k":
        x, weights = special.roots_genlaguerre(TEXTURE_NODES, shape - 1.0)
        return x / shape, weights / weights.sum()
    alpha = 0.5 * shape
    u, of_u = np.polynomial.legendre.leggauss(TEXTURE_NODES)
    x, of_x = np.polynomial.laguerre.laggauss(TEXTURE_NODES)
    u = 0.5 * np.pi * (1.0 + u[:, None])
    stable = np.sin(alpha * u) / np.sin(u) ** (1.0 / alpha) * (np.sin((1.0 - alpha) * u) / x) ** (1.0 / alpha - 1.0)
    g = 1.0 / (special.gamma(1.0 + 1.0 / alpha) * stable)
    return g.ravel(), (0.5 * of_u[:, None] * of_x).ravel()
