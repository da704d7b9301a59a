"""Detection of a target: its SNR by range, the fluctuation of its echo, and the probability of detection.

The matched filter's output is compared with a threshold set by the false-alarm probability Pf. For an amplitude that is
Rayleigh from scan to scan (Swerling 1), the probability of detection is Pd = Pf^(1 / (1 + E/N0)), where E is the mean
energy of the echo (Van Trees, *Detection, Estimation, and Modulation Theory*, part III, section 2.1). The project's
SNR is eta = 2E/N0. The laws of fluctuation have the names of Swerling (1954; IRE Trans. Inf. Theory 6, 1960) and Marcum
(1948):

=========  =====================================================================================
swerling0  the echo is steady
swerling1  one amplitude for all pulses of a look, Rayleigh: many scatterers of similar size
swerling2  as swerling1, with an amplitude of its own for every pulse
swerling3  one amplitude for all pulses, chi with four degrees of freedom: one large scatterer
swerling4  as swerling3, with an amplitude of its own for every pulse
=========  =====================================================================================

A look is a number n of pulses that are integrated noncoherently: the detector adds the powers of the matched filter's
outputs. Coherent integration is a gain in eta instead. With noise of unit power, and S the realised E/N0 of all pulses
together, twice the detector's output Y is chi-square with 2 n degrees of freedom and noncentrality 2 S. The mean of S
is n eta / 2, and S is gamma-distributed with shape K: 1, n, 2 and 2 n for swerling1 to swerling4. So Y is a mixture of
gamma distributions of shape n + k, where k is negative-binomial (Poisson for a steady echo), and so is the law of S
given a detection (Shnidman, IEEE Trans. Aerosp. Electron. Syst. 31(2), 1995).

A receiver may take the greatest value of an image instead of the value at a known cell. It then searches ``searched``
quantities, such as delay, Doppler and direction. Near an echo the noise adds half a chi-square variable with one degree
of freedom for each of them (Wilks, Ann. Math. Stat. 9, 1938), so n becomes n + searched / 2.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special
from scipy.constants import Boltzmann

from wavegym.core.arrays import Array, check_broadcast, check_elements
from wavegym.core.errors import (
    InputError,
    check_choice,
    check_int,
    check_non_negative,
    check_positive,
    check_probability,
    check_within,
)
from wavegym.sensors import detection_kernels
from wavegym.sensors.detection_kernels import CELL, FIRST, LAST, EchoLaw

Fluctuation = Literal["swerling0", "swerling1", "swerling2", "swerling3", "swerling4"]
"""The names of the laws of fluctuation."""
FLUCTUATIONS = get_args(Fluctuation)
MOST_PULSES = 1000
MOST_CELLS = 64  # their product of uniform draws stays a number
MOST_THRESHOLD = 100.0  # times the mean power of the reference cells; beyond, the tables take gigabytes
MOST_DECIBELS = 300.0
STEPS = 50  # halvings of the interval in which a quantile lies
LAWS = 8  # whose tables are kept: a threshold takes 0.1 s, and every environment of the law needs it
TABLE = 2001  # values of a table over ln eta
LN_SNR = np.linspace(FIRST, LAST, TABLE)


def range_law_snr(
    range_m: ArrayLike, reference_range: float = 50e3, nearest_range: float = 100.0
) -> NDArray[np.float64]:
    """eta = (r0 / r)^4, mean 2E/N0: two-way spreading, 1 at the reference range (Kershaw & Evans 1994).

    Args:
        range_m: r in metres, >= 0, any shape.
        reference_range: r0 in metres, where eta = 1.
        nearest_range: least r in metres; a target overhead has a finite SNR.

    Raises:
        InputError: a range that is negative or not finite, or a reference or nearest range that is not > 0.
    """
    r = check_elements(check_non_negative, "range_m", range_m)
    check_positive("reference_range", reference_range, "m")
    check_positive("nearest_range", nearest_range, "m")
    return detection_kernels.snr(r, reference_range, nearest_range)


def unit_snr_range(
    energy: ArrayLike,
    gain_db: float,
    wavelength: float,
    *,
    cross_section: float = 1.0,
    noise_temperature: float = 290.0,
    losses_db: float = 0.0,
) -> NDArray[np.float64]:
    """Range at which eta = 2E/N0 = 1, by the radar equation: the fourth root of 2 E G^2 lambda^2 s / ((4 pi)^3 k T L).

    Args:
        energy: E transmitted in one pulse or coherent train, peak power times its time on air, J, > 0, any shape.
        gain_db: G of the antenna, one way, dB.
        wavelength: lambda, m, > 0.
        cross_section: s of the target, m^2, > 0.
        noise_temperature: T of the receiver, K, > 0.
        losses_db: L, two ways, dB.

    Returns:
        r0 of ``range_law_snr``, m, the shape of ``energy``.

    Raises:
        InputError: an invalid value.
    """
    E = check_elements(check_positive, "energy", energy)
    gain = 10.0 ** (0.1 * check_within("gain_db", gain_db, -MOST_DECIBELS, MOST_DECIBELS, "dB"))
    losses = 10.0 ** (0.1 * check_within("losses_db", losses_db, 0.0, MOST_DECIBELS, "dB"))
    check_positive("wavelength", wavelength, "m")
    check_positive("cross_section", cross_section, "m^2")
    noise = Boltzmann * check_positive("noise_temperature", noise_temperature, "K") * losses
    return np.asarray((2.0 * E * (gain * wavelength) ** 2 * cross_section / ((4.0 * math.pi) ** 3 * noise)) ** 0.25)


def detection_probability(
    snr: ArrayLike, false_alarm: ArrayLike, fluctuation: str = "swerling1", pulses: int = 1, searched: int = 0
) -> Array:
    """Probability of detection; by default Pd = Pf^(1 / (1 + eta / 2)) for eta = 2E/N0, the SNR of this project.

    Args:
        snr: mean eta of each pulse, > 0 (a ratio, not dB), any shape.
        false_alarm: Pf in (0, 1) of a cell, which sets the threshold; any shape that broadcasts.
        fluctuation: "swerling0" (a steady echo) to "swerling4", see the module.
        pulses: pulses that are integrated noncoherently, 1 to 1000. Coherent integration is a gain in eta.
        searched: quantities, such as delay, Doppler and direction, over which the receiver takes the greatest value
            about the echo; 0 for a known cell.

    Returns:
        Pd in (Pf, 1), in the broadcast shape.

    Raises:
        InputError: an invalid shape or value, or an unknown fluctuation.
    """
    check_choice("fluctuation", fluctuation, FLUCTUATIONS)
    if (fluctuation, pulses, searched) == ("swerling1", 1, 0):
        return energy_detection_probability(check_elements(check_positive, "snr", snr) / 2, false_alarm)
    mean, alarm = check_broadcast(
        snr=check_elements(check_positive, "snr", snr),
        false_alarm=check_elements(check_probability, "false_alarm", false_alarm),
    )
    return fluctuating_detection_probability(mean, alarm, fluctuation, pulses, searched)


def energy_detection_probability(energy_ratio: ArrayLike, false_alarm: ArrayLike) -> Array:
    """Pd = Pf^(1 / (1 + E/N0)) for the energy ratio E/N0 itself; otherwise as ``detection_probability``.

    Sira et al. print this form. Their symbol eta stands for E/N0 here and divides their measurement covariance.
    """
    ratio = check_elements(check_positive, "energy_ratio", energy_ratio)
    return detection_kernels.probability(ratio, np.log(check_elements(check_probability, "false_alarm", false_alarm)))


def realised_snr(uniform: ArrayLike, snr: ArrayLike, fluctuation: str = "swerling1", pulses: int = 1) -> Array:
    """SNR of the echo in one look, from uniform draws (inverse of the distribution function).

    Args:
        uniform: draws in [0, 1), any shape.
        snr: mean eta = 2E/N0 of each pulse, > 0 (a ratio), any shape that broadcasts.
        fluctuation: "swerling0" to "swerling4".
        pulses: pulses that are integrated noncoherently, 1 to 1000.

    Returns:
        The mean of 2E/N0 over the pulses of the look, in the broadcast shape; it grows with the draw.

    Raises:
        InputError: a draw outside [0, 1), an SNR that is not > 0, an unknown fluctuation, or a number out of range.
    """
    draws, mean = check_broadcast(uniform=_draws(uniform), snr=check_elements(check_positive, "snr", snr))
    shape = _shape(fluctuation, _pulses(pulses))
    return mean.copy() if math.isinf(shape) else np.asarray(mean * special.gammaincinv(shape, draws) / shape)


def detected_snr(
    uniform: ArrayLike,
    snr: ArrayLike,
    false_alarm: ArrayLike,
    fluctuation: str = "swerling1",
    pulses: int = 1,
    searched: int = 0,
) -> Array:
    """SNR of the echo in one look, given its detection, from uniform draws (inverse of the distribution function).

    If an event happens when a draw d is below its probability Pd, then d / Pd is uniform given the event. So one draw
    of a tape decides on the detection and on the SNR of the detected echo.

    Args:
        uniform: draws in [0, 1), any shape.
        snr: mean eta = 2E/N0 of each pulse, > 0 (a ratio), any shape that broadcasts.
        false_alarm: Pf in (0, 1) of a cell, any shape that broadcasts.
        fluctuation, pulses: see ``realised_snr``.
        searched: quantities over which the receiver takes the greatest value, 0 for a known cell.

    Returns:
        The mean of 2E/N0 over the pulses of the look, in the broadcast shape; it grows with the draw.

    Raises:
        InputError: as ``realised_snr``, or a Pf outside (0, 1), or a negative ``searched``.
    """
    draws, mean, alarm = check_broadcast(
        uniform=_draws(uniform),
        snr=check_elements(check_positive, "snr", snr),
        false_alarm=check_elements(check_probability, "false_alarm", false_alarm),
    )
    n, shape = _pulses(pulses), _shape(fluctuation, pulses)
    if math.isinf(shape):
        return mean.copy()
    look = _Look(shape, 0.5 * n * mean, special.gammainccinv(n, alarm), n + 0.5 * check_int("searched", searched, 0))
    found, low = draws * look.detected(), np.zeros(mean.shape)
    high = look.energy / shape * special.gammainccinv(shape, look.detected() * np.nextafter(1.0 - draws, 0.0))
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        below = look.detected_below(middle) < found
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray((low + high) / n)


def mean_inverse_detected_snr(
    snr: ArrayLike,
    false_alarm: ArrayLike,
    fluctuation: str = "swerling1",
    pulses: int = 1,
    searched: int = 0,
    least: float = 0.0,
) -> Array:
    """Mean of 1 / max(eta, ``least``) of the echo, given that it is detected: the factor of a measurement covariance.

    With least = 0 the mean is infinite for "swerling1", and for "swerling2" with one pulse, detected or not. The
    density of eta is positive at 0, where noise exceeds the threshold with probability Pf, so the integral of Pf / eta
    diverges. Such a detection is noise. It has the error of a resolution cell, not R / eta with a tiny eta. The
    covariance at an SNR of 1 is about that of a resolution cell, so ``least = 1`` bounds the error there.

    Args:
        snr, false_alarm, fluctuation, pulses, searched: see ``detected_snr``.
        least: eta below which an error grows no further, >= 0.

    Returns:
        The mean, in the broadcast shape.

    Raises:
        InputError: as ``detected_snr``, or a negative ``least``.
    """
    mean, alarm = check_broadcast(
        snr=check_elements(check_positive, "snr", snr),
        false_alarm=check_elements(check_probability, "false_alarm", false_alarm),
    )
    n, shape = _pulses(pulses), _shape(fluctuation, pulses)
    floor = 0.5 * n * check_non_negative("least", least)
    if math.isinf(shape):
        return np.asarray(1.0 / np.maximum(mean, least))
    look = _Look(shape, 0.5 * n * mean, special.gammainccinv(n, alarm), n + 0.5 * check_int("searched", searched, 0))
    return np.asarray(0.5 * n * look.detected_inverse(floor) / look.detected())


def fluctuating_detection_probability(
    snr: Array, false_alarm: Array, fluctuation: str, pulses: int, searched: int
) -> Array:
    """Pd for arrays of one shape; see ``detection_probability``, which checks them."""
    n = _pulses(pulses)
    degrees = n + 0.5 * check_int("searched", searched, 0)
    look = _Look(_shape(fluctuation, n), 0.5 * n * snr, special.gammainccinv(n, false_alarm), degrees)
    return look.detected()


def echo_law(
    false_alarms: ArrayLike,
    fluctuation: str = "swerling1",
    searched: int = 0,
    *,
    energy: float = 0.5,
    realised: bool = True,
    cells: int = 0,
) -> EchoLaw:
    """Detection and errors of one look in the form of compiled loops: see ``detection_kernels``.

    In the world ``received_snr`` draws the echo's realised SNR, which decides on the detection and is the SNR of the
    errors. A tracker has ``detection_of`` and the effective eta: C over it is the mean covariance of a detected echo.
    Where the noise is known it is 1 / ``mean_inverse_detected_snr(eta, least=1)``. Interpolation has absolute errors of
    Pd below 5e-5, and relative errors of the effective eta below 1e-4.

    Args:
        false_alarms: Pf of a known cell at each threshold, (row,).
        fluctuation: see ``detection_probability``; a look is one pulse or one coherent train.
        searched: quantities over which the receiver takes the greatest value about the echo.
        energy: E/N0 of an echo with eta = 1. It is 0.5, unless a paper takes one eta for E/N0 and 2E/N0.
        realised: False: the errors have the SNR of the mean echo.
        cells: reference cells of a CFAR detector, whose threshold is a multiple of their mean power; 0: the receiver
            knows the noise, or has as good as infinitely many.

    Returns:
        Tables that callers share and must not change; a row for each threshold.

    Raises:
        InputError: no threshold, or an invalid value.
    """
    alarms = check_elements(check_probability, "false_alarms", false_alarms)
    if alarms.ndim != 1 or not len(alarms):
        raise InputError(f"false_alarms has shape {alarms.shape}, expected a sequence of at least one probability")
    check_positive("energy", energy)
    check_cells(cells, float(alarms.min()))
    return _tables(tuple(alarms.tolist()), fluctuation, check_int("searched", searched, 0), energy, realised, cells)


def check_cells(cells: int, false_alarm: float) -> None:
    """Raise an InputError for a number of reference cells out of range, or too small for a probability of false alarm.

    The threshold may be at most ``MOST_THRESHOLD`` times the mean power of the cells.
    """

    def is_enough(count: int) -> bool:
        return -math.log(false_alarm) / count <= math.log1p(MOST_THRESHOLD / count)

    check_within("cells", check_int("cells", cells, 0), 0, MOST_CELLS)
    if cells and not is_enough(cells):
        nearest = next((more for more in range(cells, MOST_CELLS + 1) if is_enough(more)), 0)
        wanted = f"more cells, or 0 for a known noise, at a false alarm probability of {false_alarm:g}"
        raise InputError(f"cells is {cells}, expected {wanted} (nearest: {nearest})")


@lru_cache(maxsize=LAWS)
def _tables(
    false_alarms: tuple[float, ...], fluctuation: str, searched: int, energy: float, realised: bool, cells: int
) -> EchoLaw:
    shape, snr = _shape(fluctuation, 1), np.exp(LN_SNR)
    steady = math.isinf(shape)
    detection, effective = np.zeros((2, len(false_alarms), TABLE))
    alarms = np.array(false_alarms)
    threshold = np.expm1(-np.log(alarms) / cells) if cells else -np.log(alarms)
    for row, level in enumerate(threshold if cells else special.gammainccinv(1, alarms)):
        look = _Look(shape, energy * snr, np.full(TABLE, level), 1 + 0.5 * searched, cells)
        detection[row] = look.detected()
        if not steady:  # its effective eta is eta, at least CELL
            inverse = 0.5 * look.detected_inverse(0.5 * CELL) / detection[row]
            effective[row] = -np.log(snr * inverse)
    return EchoLaw(threshold, detection, effective, energy, 0 if steady else int(shape), searched, realised, cells)


class AssumedEcho(NamedTuple):
    """What a tracker assumes of echoes, each of the shape of their mean SNR."""

    detection: Array  # Pd
    effective: Array  # effective eta: C over it is the mean covariance of the errors of a detected echo


def assumed_echo(snr: ArrayLike, law: EchoLaw) -> AssumedEcho:
    """Pd and the effective eta of echoes at the first threshold of ``law``; ``echo_law`` gives the accuracy.

    Args:
        snr: mean eta, > 0, any shape.
        law: see ``echo_law``.

    Raises:
        InputError: an SNR that is not > 0.
    """
    eta = check_elements(check_positive, "snr", snr)
    places = np.log(eta)
    effective = np.maximum(eta * np.exp(np.interp(places, LN_SNR, law.effective[0])), CELL) if law.realised else eta
    return AssumedEcho(np.interp(places, LN_SNR, law.detection[0]), effective)


class _Look:
    """The mixture of gamma distributions of one look; arrays of one shape.

    Args:
        shape: K of the gamma distribution of the energy; infinite for a steady echo.
        energy: mean of the realised energy S, E/N0 of all pulses together.
        threshold: of the detector's output.
        degrees: shape of the detector's output without an echo.
        cells: reference cells; ``threshold`` is then over the sum of their powers.
    """

    def __init__(self, shape: float, energy: Array, threshold: Array, degrees: float, cells: int = 0) -> None:
        self.shape, self.energy = shape, energy
        top = float(np.max(threshold, initial=0.0))
        if cells:  # as good as the greatest sum of the reference cells
            top *= cells + 10.0 * math.sqrt(cells) + 40.0
        self.count = math.ceil(top + 10.0 * math.sqrt(top) + 40.0)  # beyond: every look is detected, to 1e-16
        k = np.arange(self.count).reshape(-1, *(1,) * np.ndim(energy))
        if math.isinf(shape):
            logs = k * np.log(energy) - energy - special.gammaln(k + 1.0)
            self._rest = special.gammainc(float(self.count), energy)
        else:
            logs = special.gammaln(shape + k) - special.gammaln(shape) - special.gammaln(k + 1.0)
            logs = logs - shape * np.log1p(energy / shape) - k * np.log1p(shape / energy)
            self._rest = special.betainc(float(self.count), shape, energy / (energy + shape))
        self._k, weights = k, np.exp(logs)
        if cells:  # a gamma variable is below a multiple of another: their share is beta-distributed
            share = threshold / (1.0 + threshold)
            below, above = (law(degrees + k, float(cells), share) for law in (special.betainc, special.betaincc))
        else:
            below, above = (law(degrees + k, threshold) for law in (special.gammainc, special.gammaincc))
        self._missed, self._detected = weights * below, weights * above

    def detected(self) -> Array:
        """Probability of detection: sum over k of P(k) Q(degrees + k, threshold)."""
        return np.asarray(self._detected.sum(axis=0) + self._rest)

    def detected_below(self, energy: Array) -> Array:
        """Probability of a detection of an echo with at most this realised energy."""
        own = special.gammainc(self.shape + self._k, energy * self._rate)
        return np.asarray(
            special.gammainc(self.shape, self.shape * energy / self.energy) - (self._missed * own).sum(axis=0)
        )

    def detected_inverse(self, floor: float) -> Array:
        """Mean of 1 / max(S, floor) over the looks that are detected, times the probability of detection."""
        missed = (self._missed * _inverse(self.shape + self._k, self._rate, floor)).sum(axis=0)
        every = _inverse(np.asarray(self.shape), self.shape / self.energy, floor)
        return np.asarray(np.where(np.isinf(every), np.inf, every - np.where(np.isinf(every), 0.0, missed)))

    @property
    def _rate(self) -> Array:
        return np.asarray(1.0 + self.shape / self.energy)


def _inverse(shape: Array, rate: Array, floor: float) -> Array:
    """Mean of 1 / max(S, floor) for a gamma variable S."""
    if floor == 0.0:
        with np.errstate(divide="ignore"):
            return np.asarray(np.where(shape > 1.0, rate / np.maximum(shape - 1.0, 0.0), np.inf))
    z = rate * floor
    above = np.where(shape > 1.0, special.gammaincc(np.maximum(shape - 1.0, 0.5), z) / np.maximum(shape - 1.0, 0.5), 0)
    above = np.where(shape == 1.0, special.exp1(z), above)
    return np.asarray(special.gammainc(shape, z) / floor + rate * above)


def _shape(fluctuation: str, pulses: int) -> float:
    """K of the gamma distribution of the energy of a look."""
    shapes = (math.inf, 1.0, float(pulses), 2.0, 2.0 * pulses)
    return shapes[FLUCTUATIONS.index(check_choice("fluctuation", fluctuation, FLUCTUATIONS))]


def _pulses(pulses: int) -> int:
    if check_int("pulses", pulses, 1) > MOST_PULSES:
        raise InputError(f"pulses is {pulses!r}, expected 1 to {MOST_PULSES}")
    return int(pulses)


def _draws(uniform: ArrayLike) -> NDArray[np.float64]:
    below_one = float(np.nextafter(1.0, 0.0))
    return check_elements(lambda name, value: check_within(name, value, 0.0, below_one), "uniform", uniform)
