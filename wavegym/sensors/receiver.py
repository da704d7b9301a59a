"""Signal chain of a receiver: outputs of matched filters at the elements of an array, delay-Doppler image, peaks.

Measurements come from simulated signals, not from a formula for errors (Barbosa et al., sections 3.2 and 4.1).
Stop-and-hop approximation: nothing moves within a pulse. White noise of unit variance in each sample has unit power in
the image; an echo of eta = 2E/N0 has power eta / 2.

Signals are simulated behind the matched filters, at the delay cells that the receiver looks at. An element samples
x[n] = sum of a s(n - tau) + w[n], with white noise w; its filter correlates with the pulse s at each cell d. Both are
linear. With the autocorrelation chi of the pulse, the output is the sum of a chi(d - tau) plus Gaussian noise of
covariance chi(d - d'). The noise is independent from pulse to pulse and from element to element. Its law is that of
filtered samples (Kay, "Fundamentals of Statistical Signal Processing: Detection Theory", 1998, section 4.3), and echoes
have the same outputs. Samples that no output within the reach depends on are never drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.fft
import scipy.linalg
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import Array, check_elements, check_finite, check_shape
from wavegym.core.errors import InputError, check_int, check_non_negative, check_positive, check_within
from wavegym.sensors import receiver_kernels as kernels
from wavegym.sensors.trains import false_return_density
from wavegym.waveforms import PulseTrain
from wavegym.waveforms.fisher import SPEED_OF_LIGHT

DELAY_CELLS = 2  # per sample
DOPPLER_CELLS = 4  # per resolution cell
BEAMS_PER_ELEMENT = 3
DIRECTIONS = 32  # tried for each peak
PHASES = 256  # of a delay cell, in the table of responses: a polynomial between them errs by less than 1e-10
DENSE = 512  # pulses up to which sums are faster than an FFT
NEGLIGIBLE = 1e-15  # of the largest power of a direction of the noise: smaller ones are rounding
MOST_SAMPLES = 1e8  # of a scan: 1.6 GB
MOST_CELLS = 4096.0  # of delay: a covariance of their noise has 130 MB
MOST = 64  # peaks of an image; weaker ones are lost
CUT_OFF = 1e-3  # of the peak amplitude: below it the simulated pulse ends
BANDWIDTHS = 6.0  # rms bandwidths within the sample rate: all but 0.3 % of the energy of a Gaussian pulse
SIDELOBE_MARGIN = 2.0  # a peak is kept 3 dB above the sidelobes of stronger peaks


class Peaks(NamedTuple):
    """Measurements from one image, strongest first."""

    z: Array  # range and range-rate, m and m/s, and direction cosine, (peak, 3)
    R: Array  # error covariance from the shape and the SNR of the peak, (peak, 3, 3)
    snr: Array  # eta = 2E/N0 (peak,)


@dataclass(frozen=True)
class ArrayReceiver:
    """A uniform linear array with half-wavelength spacing and matched filters for a known pulse train.

    Args:
        train: a train of Gaussian chirps, or of other pulses without delay sidelobes.
        carrier: carrier frequency fc, Hz.
        sample_rate: sample rate of each element, Hz; at least six times the rms bandwidth of a pulse.
        reach: half path length beyond which nothing is received, m.
        elements: number of elements L.

    Raises:
        InputError: no pulse train, a number out of range, more than 1e8 samples in a scan, or than 4096 delay cells.
    """

    train: PulseTrain
    carrier: float
    sample_rate: float
    reach: float
    elements: int = 3

    def __post_init__(self) -> None:
        if not isinstance(self.train, PulseTrain):
            raise InputError(f"train is {self.train!r}, expected a PulseTrain")
        for name in ("carrier", "sample_rate", "reach"):
            check_positive(name, getattr(self, name))
        check_int("elements", self.elements, 1)
        bandwidth = math.sqrt(self.train.pulse.fisher_factors().information()[0, 0]) / (2.0 * math.pi)
        if self.sample_rate < BANDWIDTHS * bandwidth:
            wanted = f"{BANDWIDTHS:g} times the pulses' rms bandwidth (nearest: {BANDWIDTHS * bandwidth:.6g})"
            raise InputError(f"sample_rate is {self.sample_rate!r} Hz, expected at least {wanted}")
        low, high = self.train.pulse.support
        longest = (high - low + 2.0 * self.reach / SPEED_OF_LIGHT) * self.sample_rate
        samples = float(self.train.count) * self.elements * longest
        check_within("samples of a scan (pulses x elements x samples of a pulse)", samples, 0.0, MOST_SAMPLES)
        check_within("delay cells of the reach (two for each sample)", self._delays, 0.0, MOST_CELLS)

    @cached_property
    def offsets(self) -> Array:
        """Positions of the elements along the axis of the array, from its centre, m, (element,)."""
        half = 0.5 * SPEED_OF_LIGHT / self.carrier
        return np.asarray(half * (np.arange(self.elements) - 0.5 * (self.elements - 1)))

    @cached_property
    def times(self) -> Array:
        """Times of the pulses from the middle of the train, s, (pulse,)."""
        return np.asarray(self.train.interval * (np.arange(self.train.count) - 0.5 * (self.train.count - 1)))

    @cached_property
    def shape(self) -> tuple[int, int, int, int]:
        """Shape of the outputs of one scan: (pulse, element, 2, delay cell)."""
        return self.train.count, self.elements, 2, self._delays

    def receive(self, delays: ArrayLike, amplitudes: ArrayLike) -> Array:
        """Outputs of the matched filters for echoes, without noise, (pulse, element, 2, delay cell).

        The third axis is the real and the imaginary part.

        Args:
            delays: delay of each path at each pulse and element, s, (path, pulse, element). A path whose greatest
                delay exceeds the reach by more than a sample is not received.
            amplitudes: complex, (path,): sqrt(eta / 2) and a phase.

        Raises:
            InputError: a wrong shape, a delay below 0, or an amplitude that is not finite.
        """
        delays, amplitudes = np.ascontiguousarray(delays, np.float64), np.ascontiguousarray(amplitudes, np.complex128)
        if amplitudes.ndim != 1 or delays.shape != (len(amplitudes), *self.shape[:2]):
            raise InputError(
                f"delays and amplitudes have shapes {delays.shape} and {amplitudes.shape}, expected"
                f" (path, {self.shape[0]}, {self.shape[1]}) and (path,)"
            )
        check_elements(check_non_negative, "delay", delays)
        check_finite("amplitudes", np.abs(amplitudes))
        outputs = np.zeros(self.shape)
        if len(delays):
            kernels.add_echoes(delays, amplitudes, *self.echo_law, outputs)
        return outputs

    def noise(self, key: int) -> Array:
        """Outputs of the matched filters for white noise of unit variance at the elements, as ``receive``.

        Args:
            key: of the random numbers, 0 to 2^64 - 1.

        Raises:
            InputError: a key out of range.
        """
        check_within("key", check_int("key", key, 0), 0, 2**64 - 1)
        outputs = np.zeros(self.shape)
        kernels.add_noise(np.uint64(key), np.uint64(0), 0.0, *self.noise_law, outputs)
        return outputs

    def image(self, outputs: Array) -> Array:
        """Image over delay and Doppler of each element, (Doppler cell, element, 2, delay cell).

        The phase of a Doppler cell is that at the middle of the train, pulse ``count // 2``.

        outputs: of the matched filters, (pulse, element, 2, delay cell), with the shape ``shape``; InputError for any
        other, or numbers that are not finite.
        """
        check_shape("outputs", outputs, self.shape)
        return self.transform(check_finite("outputs", outputs))

    def transform(self, outputs: Array) -> Array:
        """``image`` without its checks."""
        image, middle = np.empty((self._dopplers, *self.shape[1:])), self.train.count // 2
        if self.train.count <= DENSE:
            kernels.transform(outputs, self._waves, image)
            return image
        padded = np.zeros((self._dopplers, self.elements, self._delays), np.complex128)
        padded[: self.train.count] = outputs[:, :, 0] + 1j * outputs[:, :, 1]
        spectra = scipy.fft.fft(np.roll(padded, -middle, axis=0), axis=0, overwrite_x=True)
        image[:, :, 0], image[:, :, 1] = spectra.real, spectra.imag
        return image

    def peaks(self, image: Array, threshold: float) -> Peaks:
        """Range, range-rate, direction and covariance of the peaks of an image.

        The direction is the cosine of the angle between the axis of the array and the direction of arrival, modulo 2;
        of infinite variance for a single element. Where two paths share a cell, no direction explains all elements:
        the variance grows with the power that is left.

        Args:
            image: result of ``image``.
            threshold: in units of the noise power.

        Raises:
            InputError: a wrong shape, values that are not finite, or a threshold that is not > 0.
        """
        check_shape("image", image, (self._dopplers, *self.shape[1:]))
        check_positive("threshold", threshold)
        return self.measured(check_finite("image", image), threshold)

    def measured(self, image: Array, threshold: float) -> Peaks:
        """``peaks`` without its checks."""
        found, rows = np.empty((MOST, 2), np.int64), np.empty((MOST, 8))
        count = kernels.find_peaks(image, threshold, *self._peak_law, found, rows)
        z, R, snr = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty(count)
        cells = self._cells[0, 0], self._cells[1, 1]
        kernels.measurements(rows[:count], cells, self._dopplers, self.elements, z, R, snr)
        return Peaks(z, R, snr)

    def false_returns(self, threshold: float) -> float:
        """Expected number of noise peaks above a threshold, per (m x m/s).

        ``trains.false_return_density`` over delay, Doppler and direction, minus the peaks lost between cells.
        InputError for a threshold below its lowest one.
        """
        curvature = self._curvature
        density = false_return_density(self._unit_covariance, check_positive("threshold", threshold), self.elements)
        seen = _between_cells(threshold * curvature[0, 0]) * _between_cells(threshold * curvature[1, 1])
        if self.elements > 1:
            spread = (2.0 * math.pi) ** 2 * (self.elements**2 - 1.0) / 12.0  # of the phase with spatial frequency
            seen *= _between_cells(threshold * spread / (BEAMS_PER_ELEMENT * self.elements) ** 2)
        return float(density * seen)

    def threshold(self, density: float) -> float:
        """Threshold at which noise has ``density`` peaks per (m x m/s); InputError for a density out of range."""
        low, high = 3.0, 100.0
        check_within("density", density, self.false_returns(high), self.false_returns(low), "per (m x m/s)")
        return float(scipy.optimize.brentq(lambda t: math.log(self.false_returns(t) / density), low, high))

    @cached_property
    def _half(self) -> int:
        """Samples from the start of a pulse to its middle."""
        t = np.arange(0.0, self.train.pulse.support[1], 1.0 / self.sample_rate)
        above = self.train.pulse.envelope(t) > CUT_OFF * float(self.train.pulse.envelope(0.0))
        return int(above.sum())

    @cached_property
    def _power(self) -> Array:
        """Power spectrum of a pulse, (frequency,), in the order of an FFT of ``_window``.

        Scaled so that noise has the same power in the image as in a sample.
        """
        pulse = np.zeros(self._window, np.complex128)
        t = np.arange(-self._half, self._half + 1)
        pulse[: len(t)] = self.train.pulse.signal(t / self.sample_rate)
        pulse /= np.linalg.norm(pulse) * math.sqrt(self.train.count * self.elements)
        return np.asarray(np.abs(scipy.fft.fft(pulse)) ** 2)

    def _response(self, fraction: float) -> NDArray[np.complex128]:
        """Autocorrelation of a pulse at every cell plus a fraction of a cell; periodic, the first at the fraction."""
        length, positive = DELAY_CELLS * self._window, (self._window + 1) // 2
        turns = scipy.fft.fftfreq(self._window) * (fraction / DELAY_CELLS)
        spectrum, padded = self._power * np.exp(2j * np.pi * turns), np.zeros(length, np.complex128)
        padded[:positive], padded[positive - self._window :] = spectrum[:positive], spectrum[positive:]
        return np.asarray(DELAY_CELLS * scipy.fft.ifft(padded, overwrite_x=True))

    @property
    def _window(self) -> int:
        """Samples that an element takes of each pulse; odd, so that no frequency is its own negative."""
        return (2 * self._half + math.ceil(2.0 * self.reach / SPEED_OF_LIGHT * self.sample_rate)) | 1

    @cached_property
    def echo_law(self) -> tuple[float, float, float, Array]:
        """Carrier, cells per second, latest delay, and the table of responses: see ``receiver_kernels.add_echoes``."""
        lags = np.arange(-self._delays - kernels.SPARE, self._delays)
        table = np.array([self._response(phase / PHASES)[lags] for phase in range(-1, PHASES + 2)])
        parts = [table.real] if self._is_symmetric else [table.real, table.imag]
        latest = 2.0 * self.reach / SPEED_OF_LIGHT + 1.0 / self.sample_rate
        return self.carrier, self.sample_rate * DELAY_CELLS, latest, np.stack(parts, axis=1)

    @property
    def _is_symmetric(self) -> bool:
        """Whether the spectrum of a pulse is symmetric about the carrier, so that its autocorrelation is real."""
        response = self._response(0.0)
        return bool(np.abs(response.imag).max() < 100.0 * NEGLIGIBLE * response[0].real)

    @cached_property
    def noise_law(self) -> NoiseLaw:
        """How the noise of the outputs is made of independent normals."""
        return noise_law(self._response(0.0)[: self._delays], self._is_symmetric)

    @property
    def _delays(self) -> int:
        """Number of delay cells up to the reach, with one cell of margin."""
        return math.ceil(2.0 * self.reach / SPEED_OF_LIGHT * self.sample_rate * DELAY_CELLS) + 2

    @property
    def _dopplers(self) -> int:
        return DOPPLER_CELLS * scipy.fft.next_fast_len(self.train.count)

    @cached_property
    def _waves(self) -> Array:
        """Cosines, then sines, each at even and at odd numbers of pulses from the middle, (4, Doppler, pulse).

        Up to a quarter of all Doppler cells. Both axes have zeros up to a multiple of four.
        """
        turns = np.arange(self._dopplers // 4 + 1)[:, None] / self._dopplers
        far = np.arange(self.train.count // 2 + 1)
        waves = np.zeros((4, _four(len(turns)), _four((len(far) + 1) // 2)))
        for kind, wave in enumerate((np.cos, np.cos, np.sin, np.sin)):
            own = far[kind % 2 :: 2]
            waves[kind, : len(turns), : len(own)] = wave(2.0 * np.pi * (turns * own % 1.0))
        return waves

    @cached_property
    def _cells(self) -> Array:
        """Cell sizes in range and range-rate, m and m/s, on the diagonal."""
        metres = 0.5 * SPEED_OF_LIGHT
        rate = -metres / (self.carrier * self._dopplers * self.train.interval)
        return np.diag([metres / (self.sample_rate * DELAY_CELLS), rate])

    @cached_property
    def _curvature(self) -> Array:
        """C in |A|^2 = exp(-d^T C d), d in cells, of the image of a train: the Fisher information at an SNR of 1."""
        return np.asarray(self._cells @ np.linalg.inv(self._unit_covariance) @ self._cells)

    @property
    def _unit_covariance(self) -> Array:
        """Of range and range-rate at an SNR of 1, (2, 2)."""
        return self.train.fisher_factors().measurement_covariance(self.carrier)

    @cached_property
    def _peak_law(self) -> tuple[Array, Array, Array, tuple[float, float, float], int, float]:
        """What ``receiver_kernels.find_peaks`` knows of the array and the waveform."""
        beams, directions = (_beams(count, self.elements) for count in (BEAMS_PER_ELEMENT * self.elements, DIRECTIONS))
        C = self._curvature
        return beams, directions, _NINE, (C[0, 0], C[0, 1], C[1, 1]), self.train.count, SIDELOBE_MARGIN


class NoiseLaw(NamedTuple):
    """Noise of the outputs as products with independent normals: see ``receiver_kernels.add_noise``."""

    rank: int  # normals of a real output over all cells
    factors: tuple[Array, Array]  # (rank, cell)
    second: int  # first weight of the second factor


def noise_law(covariance: Array, is_symmetric: bool) -> NoiseLaw:
    """Factors of noise of a stationary covariance.

    The covariance K of stationary noise is Hermitian and Toeplitz. Let y = Q z: y = z1 + i z2 in the first half of the
    cells and z1 - i z2, reversed, in the second half. Then the covariance of z is real (Lee, "Centrohermitian and
    skew-centrohermitian matrices", Linear Algebra Appl. 29, 1980): K = Q R Q^H, R = F^T F. If K is real, z1 and z2 are
    independent. Eigenvectors of R with a power of rounding size are left out; the law is that of K to fifteen digits.

    Args:
        covariance: of a complex output of unit-variance samples with the one d cells earlier, (d,).
        is_symmetric: whether it is real.
    """
    size, half = len(covariance), len(covariance) // 2
    first = size - half
    Q = np.zeros((size, size), np.complex128)
    Q[:half, :half], Q[:half, first:] = np.eye(half), 1j * np.eye(half)
    Q[half:first, half:first] = 1.0  # the cell in the middle, where there is one
    Q[first:, :half], Q[first:, first:] = np.eye(half)[::-1], -1j * np.eye(half)[::-1]
    inverse = np.conj(Q.T) / np.linalg.norm(Q, axis=0)[:, None] ** 2
    R = 0.5 * (inverse @ scipy.linalg.toeplitz(covariance) @ np.conj(inverse.T)).real  # half the power in each part
    if is_symmetric:
        one, other = _factor(R[:first, :first]), _factor(R[first:, first:])
        return NoiseLaw(len(one) + len(other), (one, other), len(one))
    whole = _factor(R)
    one, other = (np.ascontiguousarray(part) for part in (whole[:, :first], whole[:, first:]))
    return NoiseLaw(len(whole), (one, other), 0)


def _factor(R: Array) -> Array:
    """F with F^T F = R, without eigenvectors of negligible power; zeros up to a multiple of four, (rank, n)."""
    power, vectors = np.linalg.eigh(R)
    kept = power > NEGLIGIBLE * power[-1]
    factor = np.zeros((_four(int(kept.sum())), len(R)))
    factor[: kept.sum()] = np.sqrt(power[kept])[:, None] * vectors.T[kept]
    return factor


def _four(count: int) -> int:
    """The next multiple of four."""
    return -(-count // 4) * 4


def _beams(count: int, elements: int) -> NDArray[np.complex128]:
    """Beams in even directions, (beam, element)."""
    return np.exp(2j * np.pi * np.outer(np.arange(count) / count, np.arange(elements)))


def _between_cells(decay: float) -> float:
    """Mean of exp(-decay x^2) over a cell: the fraction of peaks just above a threshold that cells do not miss."""
    half = 0.5 * math.sqrt(decay)
    return 0.5 * math.sqrt(math.pi) * math.erf(half) / half


def _six_of_nine() -> Array:
    """Least-squares matrix from the nine values around a cell to the coefficients of 1, d, f, d^2, df, f^2, (6, 9)."""
    d, f = (axis.ravel() for axis in np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], indexing="ij"))
    return np.linalg.pinv(np.stack([np.ones(9), d, f, d * d, d * f, f * f], axis=1))


_NINE = _six_of_nine()
