"""What a coherent train of pulses detects: the energy that motion leaves it, and the false returns of its noise.

The receiver matched-filters n pulses and transforms them over the train. It takes every peak of the power over delay
and Doppler above a threshold as a return. With noise of unit power, the signal of a target that moves uniformly has
the power E/N0 of all pulses together.

The echo of a target that accelerates is spread over several Doppler filters. The power at the peak is then smaller by
``motion_loss``, and the train measures the mean range-rate over its duration: ``mean_rate_variance``.

The errors of a detected echo have C over the effective eta of eta x ``motion_loss`` (``detection.echo_law`` with two
quantities searched, C of the ``PulseTrain`` at unit SNR), and ``mean_rate_variance`` is added to that of range-rate.
Simulated trains agree to a tenth.

Noise has as many peaks in a region of range and range-rate as that region has resolution cells. A train of n pulses has
n times the Doppler cells of one pulse in the same unambiguous interval, so at equal numbers of false returns its
threshold is higher by about ln n.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from wavegym.core.arrays import Array, check_broadcast, check_elements, check_finite, check_last_axes
from wavegym.core.covariances import check_positive_definite
from wavegym.core.errors import InputError, check_int, check_non_negative, check_positive

KNEE, DECAY = 115.0, 0.336  # of the loss by white acceleration: fitted to simulated trains, within 0.16 dB
_HALF_LINE, _WEIGHTS = np.polynomial.legendre.leggauss(40)
NODES = 1.5 * np.square(1.0 + _HALF_LINE)  # accelerations from 0 to 6 standard deviations, most of them near 0
WEIGHTS = _WEIGHTS * (1.0 + _HALF_LINE) * np.exp(-0.5 * np.square(NODES))
OFFSETS = np.linspace(0.0, 1.0, 61)  # of the Doppler filter from the middle of the sweep, over half of the sweep
STEPS = 60  # halvings of the interval in which a threshold lies
MEAN_RATE = 33.0 / 560.0  # integral of the squared weight of the velocity's later increments in the mean range-rate
LOWEST, LOWEST_OF_ARRAY = 1.5, 2.725  # thresholds below which peaks of noise merge: their number has its maximum there
HIGHEST = 700.0  # a threshold that no noise exceeds


def motion_loss(
    duration: ArrayLike, wavelength: ArrayLike, density: ArrayLike = 0.0, acceleration: ArrayLike = 0.0
) -> Array:
    """Mean share of the energy E that the best Doppler filter keeps of an accelerating target, in (0, 1].

    White acceleration of density q turns the phase of the echo by a variance of x = (4 pi / lambda)^2 q T^3 over a
    train of T seconds. It leaves the mean share (1 + x / 115)^-0.336, fitted to simulated trains (within 0.16 dB). A
    steady acceleration a sweeps the echo through 2 a T / lambda Hz; it leaves the peak of the spectrum of that sweep,
    by Fresnel's integrals, averaged over normal a. Both together leave the smaller of the two shares (within 0.6 dB).

    Args:
        duration: T of the train, s, >= 0, any shape.
        wavelength: lambda, m, > 0, any shape that broadcasts.
        density: q of the acceleration along the line of sight, m^2/s^3, >= 0.
        acceleration: standard deviation of an acceleration along the line of sight that lasts for the train, m/s^2,
            >= 0.

    Raises:
        InputError: an invalid shape or value.
    """
    T, wave, q, sigma = check_broadcast(
        duration=check_elements(check_non_negative, "duration", duration),
        wavelength=check_elements(check_positive, "wavelength", wavelength),
        density=check_elements(check_non_negative, "density", density),
        acceleration=check_elements(check_non_negative, "acceleration", acceleration),
    )
    turned = np.square(4.0 * math.pi / wave) * q * T**3
    white = (1.0 + turned / KNEE) ** -DECAY
    steady = _steady_share(np.sqrt(NODES * sigma[..., None] / wave[..., None]) * T[..., None])
    return np.asarray(np.minimum(white, steady @ WEIGHTS / WEIGHTS.sum()))


def acceleration_loss(duration: ArrayLike, wavelength: ArrayLike, acceleration: ArrayLike) -> Array:
    """Share of the energy E that the best Doppler filter keeps of a target of a known steady acceleration, in (0, 1].

    Args:
        duration: T of the train, s, >= 0, any shape.
        wavelength: lambda, m, > 0, any shape that broadcasts.
        acceleration: along the line of sight, m/s^2, of either sign.

    Raises:
        InputError: an invalid shape or value.
    """
    T, wave, a = check_broadcast(
        duration=check_elements(check_non_negative, "duration", duration),
        wavelength=check_elements(check_positive, "wavelength", wavelength),
        acceleration=check_finite("acceleration", acceleration),
    )
    return _steady_share(np.sqrt(np.abs(a) / wave) * T)


def _steady_share(u: Array) -> Array:
    """The greatest power over Doppler of a steady acceleration with |a| T^2 / lambda = u^2."""
    half = np.maximum(u, 1e-3)[..., None]  # the loss is below 1e-12 there
    (low_s, low_c), (high_s, high_c) = special.fresnel((OFFSETS - 1.0) * half), special.fresnel((OFFSETS + 1.0) * half)
    power = np.square(high_s - low_s) + np.square(high_c - low_c)
    return np.asarray((power / np.square(2.0 * half)).max(axis=-1))


def mean_rate_variance(duration: ArrayLike, density: ArrayLike) -> Array:
    """Variance, m^2/s^2, of the mean range-rate of a train about the range-rate at its middle: 33 q T / 560.

    A train measures the slope of the range by least squares, which is a weighted mean of the range-rate. White
    acceleration of density q moves it. The variance holds while ``motion_loss`` is above 0.55; simulated trains that
    lose more energy have up to twice as much.

    Args:
        duration: T of the train, s, >= 0, any shape.
        density: q, m^2/s^3, >= 0, any shape that broadcasts.

    Raises:
        InputError: an invalid shape or value.
    """
    T, q = check_broadcast(
        duration=check_elements(check_non_negative, "duration", duration),
        density=check_elements(check_non_negative, "density", density),
    )
    return np.asarray(MEAN_RATE * q * T)


def false_return_density(unit_covariance: ArrayLike, threshold: ArrayLike, elements: int = 1) -> Array:
    """Expected number of noise peaks above a threshold, per m and m/s: (2 T - 1) exp(-T) / (2 pi sqrt(det C)).

    The expected Euler characteristic of the excursion set: the power is a chi-square field with two degrees of freedom
    over delay and Doppler (Worsley, "Local maxima and the expected Euler characteristic of excursion sets of chi^2, F
    and t fields", Adv. Appl. Prob. 26, 1994). Its curvature is the Fisher information at eta = 1 of any waveform.

    A line of L elements adds the direction: the field has three axes, and peaks in all directions count. Its curvature
    over spatial frequency is v = (2 pi)^2 (L^2 - 1) / 12, and sqrt(v T / pi) (2 T - 3) takes the place of 2 T - 1.

    Args:
        unit_covariance: C of range and range-rate at eta = 1, (..., 2, 2).
        threshold: T, power over that of the noise, >= 1.5 (2.725 for several elements), any shape that broadcasts.
        elements: L of a line of elements of which the receiver searches the best direction.

    Raises:
        InputError: an invalid shape or value.
    """
    T, lowest = np.asarray(threshold, np.float64), _lowest(elements)
    if not (np.isfinite(T) & (lowest <= T)).all():
        raise InputError(f"threshold is {threshold!r:.40}, expected finite numbers >= {lowest} (nearest)")
    return np.asarray(_peaks(T, elements) / _cell(unit_covariance))


def false_return_threshold(unit_covariance: ArrayLike, density: ArrayLike, elements: int = 1) -> Array:
    """The threshold T at which noise has ``density`` peaks per m and m/s; inverse of ``false_return_density``.

    Raises:
        InputError: an invalid shape or value, or more peaks than noise has at the lowest threshold.
    """
    wanted, cell = check_elements(check_positive, "density", density), _cell(unit_covariance)
    share, lowest = np.asarray(wanted * cell), _lowest(elements)
    greatest = _peaks(np.asarray(lowest), elements)
    if (share > greatest).any():
        most = np.min(greatest / cell)
        raise InputError(f"density is {density!r:.40} per (m x m/s), expected at most {most:.4g} (nearest)")
    low, high = np.full(share.shape, lowest), np.full(share.shape, HIGHEST)
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        above = _peaks(middle, elements) > share
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return np.asarray(0.5 * (low + high))


def check_threshold(false_alarm: float) -> None:
    """Pf of a cell sets a threshold T = -ln Pf at which the peaks of noise are apart.

    Raises:
        InputError: Pf above exp(-1.5), where they merge.
    """
    most = float(f"{math.exp(-LOWEST):.3g}")
    if false_alarm > most:
        wanted = f"at most {most:g} (nearest): below that threshold the peaks of noise merge"
        raise InputError(f"false alarm probability is {false_alarm!r}, expected {wanted}")


def _lowest(elements: int) -> float:
    return LOWEST if check_int("elements", elements, 1) == 1 else LOWEST_OF_ARRAY


def _peaks(T: Array, elements: int) -> Array:
    """Peaks of noise above T in a cell of 2 pi sqrt(det C)."""
    if elements == 1:
        return np.asarray((2.0 * T - 1.0) * np.exp(-T))
    spread = (2.0 * math.pi) ** 2 * (elements**2 - 1.0) / 12.0
    return np.asarray(np.sqrt(spread * T / math.pi) * (2.0 * T - 3.0) * np.exp(-T))


def _cell(unit_covariance: ArrayLike) -> Array:
    """2 pi sqrt(det C), m^2/s."""
    C = check_positive_definite("unit_covariance", check_last_axes("unit_covariance", unit_covariance, 2, 2))
    return np.asarray(2.0 * math.pi * np.sqrt(C[..., 0, 0] * C[..., 1, 1] - C[..., 0, 1] * C[..., 1, 0]))
