"""Fisher information and ambiguity function of any waveform by spectral quadrature."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError
from wavegym.waveforms.fisher import FisherFactors
from wavegym.waveforms.legendre import NODES, Expansion, resolve

ComplexArray = NDArray[np.complex128]

_ENERGY_TOLERANCE = 1e-9
_INSET = 1e-9  # of a piece's length
_JUMP = 1e-5  # of the peak: far above a taper's value at the inset, far below a relevant jump
_CHUNK = 2**19  # (order, Doppler) and (panel, Doppler) table elements per chunk: about 30 MB


class _Pulse(Protocol):
    """The members of ``Waveform`` that quadrature uses."""

    @property
    def label(self) -> str: ...

    @property
    def support(self) -> tuple[float, float]: ...

    @property
    def pieces(self) -> tuple[tuple[float, float], ...]: ...

    def envelope(self, t: FloatArray) -> FloatArray: ...

    def phase(self, t: FloatArray) -> FloatArray: ...


def numeric_fisher_information(waveform: _Pulse) -> FloatArray:
    """Fisher information of (delay in s, Doppler in Hz) at SNR 1 by quadrature, never by a closed form; (2, 2).

    Raises:
        InputError: a waveform that is not smooth between the ends of its ``pieces``, or whose energy is not 1.
    """
    return numeric_fisher_factors(waveform).information()


def numeric_fisher_factors(waveform: _Pulse) -> FisherFactors:
    """Factored Fisher information at SNR 1 by quadrature.

    Unknown amplitude and phase remove the means of t and w, so the moments are centred: J_tt = int a'^2 + var(w),
    J_tw = -cov(t, w), J_ww = var(t). The regression of w on t is subtracted before squaring: a long chirp keeps its
    last digits.

    Raises:
        InputError: a waveform that is not smooth within its ``pieces``, or not of energy 1, or with a jump.
    """
    samples = sample(waveform)
    _check_no_jump(waveform)
    envelope = samples.values[0]
    envelope_rate, frequency = samples.derivative()
    density = envelope * envelope * samples.weights
    energy = density.sum()
    if not abs(energy - 1) <= _ENERGY_TOLERANCE:
        raise InputError(f"energy of {waveform.label} is {energy:.12g}, expected 1 (scale its envelope)")
    density /= energy
    time = samples.times - (samples.times * density).sum()
    frequency = frequency - (frequency * density).sum()
    spread = (time * time * density).sum()
    slope = (time * frequency * density).sum() / spread
    left = frequency - slope * time
    residual = (envelope_rate * envelope_rate * samples.weights).sum() / energy + (left * left * density).sum()
    return FisherFactors(residual, slope, spread)


def numeric_energy_interval(waveform: _Pulse, energy: float) -> tuple[float, float]:
    """Central interval (s) with this share of the energy: (1 - energy)/2 of it lies before, as much after.

    The quantiles of a^2 are found by root finding; the quadrature is exact to rounding.
    """
    from scipy.optimize import brentq  # the waveforms load without SciPy

    samples = sample(waveform)
    density = samples.values[0] ** 2 * samples.weights
    panels = density.sum(axis=-1).ravel()
    half = np.broadcast_to(samples.half[:, None], samples.centres.shape).ravel()
    begins = samples.centres.ravel() - half
    x, w = leggauss(NODES)

    def part(low: float, high: float) -> float:
        """Energy between two times of one panel."""
        width = 0.5 * (high - low)
        return float((waveform.envelope(low + width * (x + 1.0)) ** 2 * w).sum() * width)

    def tail(sizes: FloatArray, order: NDArray[np.intp]) -> float:
        """The time at which the energy, summed over the panels in this order, reaches the share that is left out."""
        left_out = 0.5 * (1.0 - energy) * sizes.sum()
        before = np.concatenate([[0.0], np.cumsum(sizes[order])])
        at = min(int(np.searchsorted(before, left_out, side="right")) - 1, len(order) - 1)
        k, rest = order[at], left_out - before[at]
        low, high = float(begins[k]), float(begins[k] + 2.0 * half[k])
        forward = len(order) < 2 or order[0] < order[1]
        inside = (lambda t: part(low, t) - rest) if forward else (lambda t: part(t, high) - rest)
        if inside(low) * inside(high) >= 0.0:  # the end of a panel, up to rounding
            return low if abs(inside(low)) <= abs(inside(high)) else high
        return float(brentq(inside, low, high, xtol=1e-15 * (high - low), rtol=1e-14))

    order = np.arange(len(panels))
    return tail(panels, order), tail(panels, order[::-1])


def numeric_level_interval(waveform: _Pulse, ratio: float) -> tuple[float, float]:
    """From the first to the last time (s) at which the envelope exceeds ``ratio`` times its peak."""
    from scipy.optimize import brentq

    low, high = waveform.support
    times = np.unique(np.concatenate([sample(waveform).times.ravel(), np.linspace(low, high, 4097)]))
    amplitude = np.abs(waveform.envelope(times))
    level = ratio * float(amplitude.max())
    above = np.flatnonzero(amplitude > level)

    def crossing(inner: float, outer: float) -> float:
        if inner == outer:
            return float(inner)

        def excess(t: float) -> float:
            return float(np.abs(waveform.envelope(np.asarray(t)))) - level

        if excess(outer) >= 0.0:  # the end of the support
            return float(outer)
        return float(brentq(excess, inner, outer, xtol=1e-15 * (high - low), rtol=1e-14))

    first, last = above[0], above[-1]
    return crossing(times[first], times[max(first - 1, 0)]), crossing(times[last], times[min(last + 1, len(times) - 1)])


def _check_no_jump(waveform: _Pulse) -> None:
    """The envelope is continuous from piece to piece, and zero where there is none."""
    low, high = np.array(waveform.pieces, dtype=np.float64).T
    inset = _INSET * (high - low)  # an envelope may count its very ends as inside or outside
    rise, fall = waveform.envelope(low + inset), waveform.envelope(high - inset)
    joined = low[1:] == high[:-1]
    before = np.concatenate([[0.0], np.where(joined, fall[:-1], 0.0)])
    after = np.concatenate([np.where(joined, rise[1:], 0.0), [0.0]])
    jump = max(np.abs(rise - before).max(), np.abs(fall - after).max())
    peak = np.abs(waveform.envelope(np.linspace(*waveform.support, 257))).max()
    if jump > _JUMP * peak:
        raise InputError(
            f"envelope of {waveform.label} jumps by {jump / peak:.2g} of its peak, expected it continuous: "
            "delay information is infinite at a jump (taper the edges)"
        )


def sample(waveform: _Pulse) -> Expansion:
    """Envelope and phase (components 0 and 1) of a waveform, sampled finely enough to determine both.

    Raises:
        InputError: an envelope or phase that is not smooth between the ends of the waveform's ``pieces``.
    """
    low, high = np.array(waveform.pieces, dtype=np.float64).T

    def both(t: FloatArray) -> FloatArray:
        return np.stack([waveform.envelope(t), waveform.phase(t)])

    return resolve(
        both, low, high, np.array([np.finfo(np.float64).tiny, 1.0]), f"envelope or phase of {waveform.label}"
    )


def correlate(waveform: _Pulse, delay: float, dopplers: FloatArray) -> ComplexArray:
    """chi(delay, nu) = int s(t) s*(t - delay) exp(-j 2 pi nu t) dt by quadrature, (doppler,).

    The phase of the product rotates at the beat frequency of the two copies, which for an FM pulse is far below its
    bandwidth. The mean beat is taken from the product and added to the Doppler; Filon's rule integrates both exactly.

    Args:
        waveform: any waveform, smooth between the ends of its ``pieces``.
        delay: tau, s.
        dopplers: nu, Hz, (doppler,).
    """
    low, high = _overlap(waveform.pieces, delay)
    if not len(low):
        return np.zeros(len(dopplers), dtype=np.complex128)
    origin = 0.5 * delay
    begins, ends = _beat(waveform, delay, low), _beat(waveform, delay, high)
    beat = float((ends - begins).sum() / (high - low).sum())  # rad/s

    def product(t: FloatArray) -> ComplexArray:
        amplitude = waveform.envelope(t) * waveform.envelope(t - delay)
        return (amplitude * np.exp(1j * (_beat(waveform, delay, t) - beat * (t - origin))))[None]

    peak = float((waveform.envelope(np.linspace(*waveform.support, 256)) ** 2).max())
    expansion = resolve(product, low, high, np.array([peak]), f"envelope or phase of {waveform.label}")
    omega = 2 * np.pi * dopplers - beat
    step = max(1, _CHUNK // (32 * len(low) + expansion.centres.size))
    parts = [expansion.fourier(omega[k : k + step])[0] for k in range(0, len(omega), step)]
    # The beat is removed relative to `origin`, the Doppler relative to t = 0.
    return np.concatenate([np.zeros(0, dtype=np.complex128), *parts]) * np.exp(-1j * beat * origin)


def _beat(waveform: _Pulse, delay: float, t: FloatArray) -> FloatArray:
    return waveform.phase(t) - waveform.phase(t - delay)


def _overlap(pieces: tuple[tuple[float, float], ...], delay: float) -> tuple[FloatArray, FloatArray]:
    """Intervals in which a pulse and its copy, delayed by ``delay``, are both on and smooth."""
    begins, ends = np.array(pieces, dtype=np.float64).T
    edges = np.unique(np.concatenate([begins, ends, begins + delay, ends + delay]))
    low, high = edges[:-1], edges[1:]
    middle = 0.5 * (low + high)
    shared = _inside(middle, begins, ends) & _inside(middle - delay, begins, ends)
    return low[shared], high[shared]


def _inside(t: FloatArray, begins: FloatArray, ends: FloatArray) -> NDArray[np.bool_]:
    piece = np.searchsorted(begins, t, side="right") - 1
    return (piece >= 0) & (t < ends[piece])
