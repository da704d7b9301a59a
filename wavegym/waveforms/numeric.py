"""Fisher information and ambiguity function of any waveform by spectral quadrature.

A pulse is smooth on a few intervals (``Waveform.pieces``) and may have kinks between them. Each interval is cut into
equal panels. In each panel a function is represented by its values at Gauss-Legendre nodes, which give its derivative,
integral and Fourier integral. Panels are halved until the last coefficients vanish: the error is a rounding error for
any pulse, also with kinks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.polynomial import legendre
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError
from wavegym.waveforms.fisher import FisherFactors

ComplexArray = NDArray[np.complex128]

NODES = 32
_FIRST_PANELS = 4
_MOST_PANELS = 8192  # over all intervals; at least _FEWEST_LIMIT in each
_FEWEST_LIMIT = 64
_TAIL = 4  # last coefficients checked; several, since a symmetric function has zeros in every other one
_RESOLVED = 1e-14
_NEARLY_RESOLVED = 1e-8

_X, _W = legendre.leggauss(NODES)
_ORDERS = np.arange(NODES)
_VALUES_TO_COEFFICIENTS = (_W[:, None] * legendre.legvander(_X, NODES - 1)) * (_ORDERS + 0.5)  # (node, order)
_SLOPES = np.stack([legendre.legval(_X, legendre.legder(row)) for row in np.eye(NODES)])  # (order, node)
_DERIVATIVE = _VALUES_TO_COEFFICIENTS @ _SLOPES  # (node, node)

# Integrates a polynomial of degree < 32 times exp(-j z x) to rounding for every |z| <= 32.
_FINE_X, _FINE_W = legendre.leggauss(2 * NODES)
_FINE_POLYNOMIALS = _FINE_W[:, None] * legendre.legvander(_FINE_X, NODES - 1)  # (fine node, order)
_ENERGY_TOLERANCE = 1e-9
_INSET = 1e-9  # of a piece's length
_JUMP = 1e-5  # of the peak: far above a taper's value at the inset, far below a relevant jump
_CHUNK = 2**19  # (order, Doppler) and (panel, Doppler) table elements per chunk: about 30 MB


@dataclass(frozen=True)
class Expansion:
    """A vector function sampled on the panels of several intervals.

    Attributes:
        centres: panel centres, (interval, panel).
        half: half the width of an interval's panels, (interval,).
        values: the function at the nodes, (component, interval, panel, node).
    """

    centres: FloatArray
    half: FloatArray
    values: NDArray

    @property
    def times(self) -> FloatArray:
        """Node positions, (interval, panel, node)."""
        return _nodes(self.centres, self.half)

    @property
    def weights(self) -> FloatArray:
        """Quadrature weight of each node, (interval, 1, node); sums over the panels by broadcasting."""
        return self.half[:, None, None] * _W

    def derivative(self) -> NDArray:
        """The function's time derivative at the nodes, (component, interval, panel, node)."""
        return (self.values @ _DERIVATIVE) / self.half[:, None, None]

    def fourier(self, omega: FloatArray) -> ComplexArray:
        """Integral of f(t) exp(-j omega t) over all intervals, (component, omega); omega in rad per unit of t.

        Filon's rule integrates each panel's Legendre expansion times the exponential exactly. The number of panels
        depends on f alone, not on omega.
        """
        moments = legendre_moments(omega * self.half[:, None])  # (interval, order, omega)
        per_panel = ((self.values @ _VALUES_TO_COEFFICIENTS) * self.half[:, None, None]) @ moments
        return (per_panel * np.exp(-1j * self.centres[..., None] * omega)).sum(axis=(1, 2))


def resolve(
    function: Callable[[FloatArray], NDArray], low: FloatArray, high: FloatArray, floor: FloatArray, name: str
) -> Expansion:
    """Sample ``function`` on the intervals [low, high]; panels are halved until the samples determine it to rounding.

    Args:
        function: times (interval, panel, node) -> values (component, interval, panel, node), real or complex.
        low, high: ends of the intervals, (interval,).
        floor: per component, (component,): errors of 1e-14 of this, or of the component's peak, are accepted.
        name: name of the function in an error.

    Raises:
        InputError: a function with a jump or a kink inside an interval, or one that is not finite.
    """
    panels, previous = _FIRST_PANELS, np.inf
    while True:
        half = (high - low) / (2 * panels)
        centres = low[:, None] + half[:, None] * (2 * np.arange(panels) + 1)
        values = function(_nodes(centres, half))
        scale = np.maximum(floor, np.abs(values).max(axis=(1, 2, 3)))
        tails = np.abs(values @ _VALUES_TO_COEFFICIENTS[:, -_TAIL:]).max(axis=(1, 2, 3))
        tail = float((tails / scale).max())
        # A phase of 1e5 rad or a time far from the origin carries rounding noise that more panels cannot remove.
        only_noise = tail <= _NEARLY_RESOLVED and tail > previous / 4
        if tail <= _RESOLVED or only_noise:
            return Expansion(centres, half, values)
        if panels >= max(_FEWEST_LIMIT, _MOST_PANELS // len(low)) or not np.isfinite(tail):
            raise InputError(
                f"{name} is not smooth, expected finite values with kinks or jumps only at the ends of its `pieces`"
            )
        panels, previous = 2 * panels, tail


def legendre_moments(z: FloatArray) -> ComplexArray:
    """Integral over [-1, 1] of P_n(x) exp(-j z x) = 2 (-j)^n j_n(z) for n < 32; z (interval, k) -> (interval, n, k)."""
    flat = np.abs(z).ravel()
    bessel = np.empty((NODES, flat.size))  # 2 j_n(|z|)
    small = flat <= NODES
    phases = np.exp(-1j * flat[small, None] * _FINE_X)
    integrals = (phases @ _FINE_POLYNOMIALS).T  # (n, k)
    turn = (1j**_ORDERS)[:, None]
    bessel[:, small] = (integrals * turn).real
    large = flat[~small]  # upward recurrence is stable where n < z
    if large.size:
        before, now = 2 * np.cos(large) / large, 2 * np.sin(large) / large  # orders -1 and 0
        rows = []
        for order in range(NODES):
            rows.append(now)
            before, now = now, (2 * order + 1) / large * now - before
        bessel[:, ~small] = rows
    moments = bessel * turn.conj()  # (-j)^n
    moments[1::2] *= np.sign(z).ravel()
    return moments.reshape(NODES, *z.shape).swapaxes(0, 1)


def _nodes(centres: FloatArray, half: FloatArray) -> FloatArray:
    return centres[..., None] + half[:, None, None] * _X


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
