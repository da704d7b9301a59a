"""The base class of waveforms: a pulse with an envelope and a phase."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.action_sets import Library
from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_positive
from wavegym.waveforms.fisher import FisherFactors
from wavegym.waveforms.numeric import (
    correlate,
    numeric_energy_interval,
    numeric_fisher_factors,
    numeric_level_interval,
)


class Waveform(ABC):
    """A pulse with complex envelope s(t) = a(t) exp(j phi(t)) and unit energy.

    A subclass defines ``label``, ``support``, ``envelope`` and ``phase``. This class computes ``signal``, the Fisher
    information, the measurement covariance and the ambiguity function by quadrature to rounding error. A subclass may
    override ``fisher_factors`` or ``ambiguity_row`` with a closed form. It must override ``pieces`` if its envelope or
    phase has kinks. An envelope with jumps has infinite delay information and is refused: taper its edges.
    """

    @property
    @abstractmethod
    def label(self) -> str:
        """Short name, e.g. ``"up 100 us 1 MHz"``; unique within a library."""

    @property
    @abstractmethod
    def support(self) -> tuple[float, float]:
        """First and last time, s; outside the pulse is zero, with less than 1e-16 of its energy lost.

        The relative amplitude at the ends limits the accuracy of the ambiguity function: 1e-12 is a good choice.
        """

    @property
    def pieces(self) -> tuple[tuple[float, float], ...]:
        """Intervals (s), in order and disjoint, in which envelope and phase are smooth; the pulse is zero elsewhere."""
        return (self.support,)

    @abstractmethod
    def envelope(self, t: ArrayLike) -> FloatArray:
        """Real amplitude a(t), s^-1/2, with the integral of a^2 equal to 1; t in s, any shape."""

    @abstractmethod
    def phase(self, t: ArrayLike) -> FloatArray:
        """Phase phi(t), rad; t in s, any shape. Its derivative is the instantaneous angular frequency."""

    def signal(self, t: ArrayLike) -> NDArray[np.complex128]:
        """Complex envelope s(t) = a(t) exp(j phi(t)), s^-1/2; t in s, any shape."""
        return self.envelope(t) * np.exp(1j * self.phase(t))

    def fisher_factors(self) -> FisherFactors:
        """Fisher information at SNR 1 in factored form (see ``FisherFactors``); by quadrature unless overridden."""
        return numeric_fisher_factors(self)

    def fisher_information(self) -> FloatArray:
        """Fisher information of (delay in s, Doppler in Hz) at SNR 1 with unknown amplitude and phase, (2, 2).

        It equals minus the Hessian of |chi(tau, nu)| at the origin. Multiply by eta = 2E/N0 for another SNR.
        """
        return self.fisher_factors().information()

    def measurement_covariance(self, carrier_hz: float, snr: float) -> FloatArray:
        """Cramer-Rao covariance of (range in m, range-rate in m/s), (2, 2).

        Args:
            carrier_hz: carrier frequency, Hz.
            snr: eta = 2E/N0, linear.

        Raises:
            InputError: an argument that is not a finite number > 0.
        """
        check_positive("carrier_hz", carrier_hz, "Hz")
        check_positive("snr", snr)
        return self.fisher_factors().measurement_covariance(carrier_hz) / snr

    def ambiguity_row(self, delay: float, dopplers: FloatArray) -> NDArray[np.complex128]:
        """chi(delay, nu) at one delay (s) for all Dopplers (Hz), (doppler,); by quadrature unless overridden."""
        return correlate(self, delay, dopplers)

    def energy_interval(self, energy: float) -> tuple[float, float]:
        """Central interval (s) that holds this share of one pulse's energy; see ``transmitted_interval``."""
        return numeric_energy_interval(self, energy)

    def level_interval(self, ratio: float) -> tuple[float, float]:
        """Interval (s) over which one pulse's amplitude exceeds ``ratio`` of its peak; see ``transmitted_interval``."""
        return numeric_level_interval(self, ratio)


def measurement_covariances(library: Library, carrier_hz: float) -> FloatArray:
    """Covariances of (range in m, range-rate in m/s) at SNR 1, (waveform, 2, 2); divide by eta for another SNR.

    Raises:
        InputError: an entry that is not a waveform, or a carrier_hz that is not a finite number > 0.
    """
    for entry in library:
        if not isinstance(entry, Waveform):
            raise InputError(f"library holds {entry!r}, expected waveforms only")
    return np.stack([waveform.measurement_covariance(carrier_hz, 1.0) for waveform in library])
