"""Detection of a target whose echo fluctuates from scan to scan (Rayleigh amplitude, Swerling 1).

The matched filter's output is compared with a threshold set by the false-alarm probability Pf. The probability of
detection is Pd = Pf^(1 / (1 + E/N0)), where E is the mean energy of the echo (Van Trees, *Detection, Estimation, and
Modulation Theory*, part III, section 2.1). The project's SNR is eta = 2E/N0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_elements
from wavegym.core.arrays import Array
from wavegym.core.errors import check_positive, check_probability
from wavegym.sensors import detection_kernels as kernels


def detection_probability(snr: ArrayLike, false_alarm: ArrayLike) -> Array:
    """Pd = Pf^(1 / (1 + eta / 2)) for eta = 2E/N0, the SNR of this project.

    Args:
        snr: mean eta, > 0 (a ratio, not dB), any shape.
        false_alarm: Pf in (0, 1), any shape that broadcasts.

    Returns:
        Pd in (Pf, 1), in the broadcast shape.

    Raises:
        InputError: an SNR that is not a finite number > 0, a Pf outside (0, 1), or shapes that do not broadcast.
    """
    return energy_detection_probability(check_elements(check_positive, "snr", snr) / 2, false_alarm)


def energy_detection_probability(energy_ratio: ArrayLike, false_alarm: ArrayLike) -> Array:
    """Pd = Pf^(1 / (1 + E/N0)) for the energy ratio E/N0 itself; otherwise as ``detection_probability``.

    Sira et al. print this form. Their symbol eta stands for E/N0 here and divides their measurement covariance.
    """
    ratio = check_elements(check_positive, "energy_ratio", energy_ratio)
    return kernels.probability(ratio, np.log(check_elements(check_probability, "false_alarm", false_alarm)))
