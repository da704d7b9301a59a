"""Detection of a target whose echo fluctuates from scan to scan; ``fluctuation.py`` names the models.

The matched filter's output is compared with a threshold set by the false-alarm probability Pf. For an amplitude that is
Rayleigh from scan to scan (Swerling 1), the probability of detection is Pd = Pf^(1 / (1 + E/N0)), where E is the mean
energy of the echo (Van Trees, *Detection, Estimation, and Modulation Theory*, part III, section 2.1). The project's
SNR is eta = 2E/N0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_broadcast, check_elements
from wavegym.core.arrays import Array
from wavegym.core.errors import check_choice, check_positive, check_probability
from wavegym.sensors import detection_kernels as kernels
from wavegym.sensors.fluctuation import FLUCTUATIONS, fluctuating_detection_probability


def detection_probability(
    snr: ArrayLike, false_alarm: ArrayLike, fluctuation: str = "swerling1", pulses: int = 1, searched: int = 0
) -> Array:
    """Probability of detection; by default Pd = Pf^(1 / (1 + eta / 2)) for eta = 2E/N0, the SNR of this project.

    Args:
        snr: mean eta of each pulse, > 0 (a ratio, not dB), any shape.
        false_alarm: Pf in (0, 1) of a cell, which sets the threshold; any shape that broadcasts.
        fluctuation: "swerling0" (a steady echo) to "swerling4", see ``wavegym.sensors.fluctuation``.
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
    return kernels.probability(ratio, np.log(check_elements(check_probability, "false_alarm", false_alarm)))
