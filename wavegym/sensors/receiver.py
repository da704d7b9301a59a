"""Signal chain of a receiver: pulse trains at the elements of an array, matched filter, delay-Doppler image, peaks.

Measurements come from simulated signals, not from a formula for errors (Barbosa et al., sections 3.2 and 4.1).
Stop-and-hop approximation: nothing moves within a pulse. White noise of unit variance in each sample has unit power in
the image; an echo of eta = 2E/N0 has power eta / 2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.fft
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

from wavegym.core.array_checks import check_elements, check_finite, check_shape
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int, check_non_negative, check_positive, check_within
from wavegym.sensors import receiver_kernels as kernels
from wavegym.waveforms import PulseTrain
from wavegym.waveforms.fisher import SPEED_OF_LIGHT

ComplexArray = NDArray[np.complex128]

DELAY_CELLS = 2  # per sample
DOPPLER_CELLS = 4  # per resolution cell
BEAMS_PER_ELEMENT = 3
MOST_SAMPLES = 1e8  # of a scan: 1.6 GB
MOST = 64  # peaks of an image; weaker ones are lost
CUT_OFF = 1e-3  # of the peak amplitude: below it the simulated pulse ends
BANDWIDTHS = 6.0  # rms bandwidths within the sample rate: all but .3 % of the energy of a Gaussian pulse
SIDELOBE_MARGIN = 2.0  # a peak is kept 3 dB above the sidelobes of stronger peaks


class Peaks(NamedTuple):
    """Measurements from one image, strongest first."""

    z: Array  # range and range-rate, m and m/s, (peak, 2)
    R: Array  # error covariance from the shape of the peak, (peak, 2, 2)
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
        InputError: no pulse train, a number out of range, or more than 1e8 samples in a scan.
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

    @property
    def offsets(self) -> Array:
        """Positions of the elements along the axis of the array, from its centre, m, (element,)."""
        half = 0.5 * SPEED_OF_LIGHT / self.carrier
        return np.asarray(half * (np.arange(self.elements) - 0.5 * (self.elements - 1)))

    @property
    def times(self) -> Array:
        """Times of the pulses from the middle of the train, s, (pulse,)."""
        return np.asarray(self.train.interval * (np.arange(self.train.count) - 0.5 * (self.train.count - 1)))

    @cached_property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the samples of one scan: (pulse, element, sample)."""
        window = 2 * self._half + math.ceil(2.0 * self.reach / SPEED_OF_LIGHT * self.sample_rate)
        return self.train.count, self.elements, scipy.fft.next_fast_len(window + 1)

    def receive(self, delays: ArrayLike, amplitudes: ArrayLike) -> ComplexArray:
        """Samples of echoes at the elements, without noise, (pulse, element, sample).

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
        latest = 2.0 * self.reach / SPEED_OF_LIGHT + 1.0 / self.sample_rate
        received = delays.max(axis=(1, 2)) <= latest
        spectra = np.zeros(self.shape, np.complex128)
        kernels.add_echoes(
            delays[received], amplitudes[received], self.carrier, self.sample_rate / self.shape[2], spectra
        )
        return np.asarray(scipy.fft.ifft(spectra * self._template, overwrite_x=True))

    def image(self, samples: ComplexArray) -> ComplexArray:
        """Matched filter output of each element over delay and Doppler, (element, delay cell, Doppler cell).

        samples: (pulse, element, sample), with the shape ``shape``; InputError for any other, or samples that are not
        finite.
        """
        check_shape("samples", samples, self.shape)
        check_finite("samples", np.abs(samples))
        spectra = scipy.fft.fft(samples) * np.conj(self._template)
        finer, length = DELAY_CELLS * self.shape[2], (self.shape[2] + 1) // 2
        padded = np.zeros((*self.shape[:2], finer), np.complex128)
        padded[..., :length], padded[..., length - self.shape[2] :] = spectra[..., :length], spectra[..., length:]
        compressed = DELAY_CELLS * scipy.fft.ifft(padded, overwrite_x=True)[..., : self._delays]
        by_delay = np.ascontiguousarray(compressed.transpose(1, 2, 0))
        return np.asarray(scipy.fft.fft(by_delay, self._dopplers, overwrite_x=True))

    def peaks(self, image: ComplexArray, threshold: float) -> Peaks:
        """Range, range-rate and covariance of the peaks of an image in any direction.

        Args:
            image: result of ``image``.
            threshold: in units of the noise power.

        Raises:
            InputError: a wrong shape, values that are not finite, or a threshold that is not > 0.
        """
        check_shape("image", image, (self.elements, self._delays, self._dopplers))
        check_finite("image", np.abs(image))
        check_positive("threshold", threshold)
        power = np.empty(image.shape[1:])
        kernels.brightest(image, self._steering, power)
        found = np.empty((MOST, 2), np.int64)
        count = kernels.find_maxima(power, threshold, found)
        C = self._curvature
        count = kernels.drop_sidelobes(
            power, found, count, C[0, 0], self.train.count, self._dopplers / self.train.count, SIDELOBE_MARGIN
        )
        rows = np.empty((count, 6))
        kernels.fit_peaks(image, found, count, _NINE, (C[0, 0], C[0, 1], C[1, 1]), rows)
        return self._measured(rows)

    def _measured(self, rows: Array) -> Peaks:
        """Conversion of peaks from cells to m and m/s."""
        turns = rows[:, 1] / self._dopplers
        step = self._cells[1, 1] * self._dopplers
        z = np.stack([rows[:, 0] * self._cells[0, 0], step * (turns - np.rint(turns))], axis=1)
        C = rows[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
        R = self._cells @ np.linalg.inv(C) @ self._cells / rows[:, 5, None, None]
        return Peaks(z, R, rows[:, 5])

    def false_returns(self, threshold: float) -> float:
        """Expected number of noise peaks above a threshold, per (m x m/s).

        The expected Euler characteristic of the excursion set: |A|^2 is a chi-square field with two degrees of freedom
        over delay, Doppler and direction (Worsley, "Local maxima and the expected Euler characteristic of excursion
        sets of chi^2, F and t fields", Adv. Appl. Prob. 26, 1994); minus the peaks lost between cells.
        InputError for a threshold that is not > 0.
        """
        check_positive("threshold", threshold)
        curvature, twice = self._curvature, 2.0 * threshold
        cell = abs(np.linalg.det(self._cells))
        density = math.sqrt(np.linalg.det(curvature)) / cell * math.exp(-threshold) / (2.0 * math.pi)
        seen = _between_cells(threshold * curvature[0, 0]) * _between_cells(threshold * curvature[1, 1])
        if self.elements == 1:
            return density * seen * (twice - 1.0)
        spread = (2.0 * math.pi) ** 2 * (self.elements**2 - 1.0) / 12.0  # of the phase with spatial frequency
        seen *= _between_cells(threshold * spread / len(self._steering) ** 2)
        return density * seen * math.sqrt(spread / (2.0 * math.pi) * twice) * (twice - 3.0)

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
    def _template(self) -> ComplexArray:
        """Spectrum of one pulse, scaled so that noise has the same power in the image as in a sample."""
        pulse = np.zeros(self.shape[2], np.complex128)
        t = np.arange(-self._half, self._half + 1)
        pulse[: len(t)] = self.train.pulse.signal(t / self.sample_rate)
        pulse /= np.linalg.norm(pulse) * math.sqrt(self.train.count * self.elements)
        return np.asarray(scipy.fft.fft(pulse))

    @property
    def _delays(self) -> int:
        """Number of delay cells up to the reach, with one cell of margin."""
        return math.ceil(2.0 * self.reach / SPEED_OF_LIGHT * self.sample_rate * DELAY_CELLS) + 2

    @property
    def _dopplers(self) -> int:
        return scipy.fft.next_fast_len(DOPPLER_CELLS * self.train.count)

    @cached_property
    def _cells(self) -> Array:
        """Cell sizes in range and range-rate, m and m/s, on the diagonal."""
        metres = 0.5 * SPEED_OF_LIGHT
        rate = -metres / (self.carrier * self._dopplers * self.train.interval)
        return np.diag([metres / (self.sample_rate * DELAY_CELLS), rate])

    @cached_property
    def _curvature(self) -> Array:
        """C in |A|^2 = exp(-d^T C d), d in cells, of the image of a train: the Fisher information at an SNR of 1."""
        information = np.linalg.inv(self.train.fisher_factors().measurement_covariance(self.carrier))
        return np.asarray(self._cells @ information @ self._cells)

    @cached_property
    def _steering(self) -> ComplexArray:
        """Steering vectors, (beam, element)."""
        beams = BEAMS_PER_ELEMENT * self.elements
        return np.exp(2j * np.pi * np.outer(np.arange(beams) / beams, np.arange(self.elements)))


def _between_cells(decay: float) -> float:
    """Mean of exp(-decay x^2) over a cell: the fraction of peaks just above a threshold that cells do not miss."""
    half = 0.5 * math.sqrt(decay)
    return 0.5 * math.sqrt(math.pi) * math.erf(half) / half


def _six_of_nine() -> Array:
    """Least-squares matrix from the nine values around a cell to the coefficients of 1, d, f, d^2, df, f^2, (6, 9)."""
    d, f = (axis.ravel() for axis in np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], indexing="ij"))
    return np.linalg.pinv(np.stack([np.ones(9), d, f, d * d, d * f, f * f], axis=1))


_NINE = _six_of_nine()
