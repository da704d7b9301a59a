"""Detection of a fluctuating target in compiled form; ``detection.py`` holds the public functions."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import batched, inlined, kernel

FIRST, LAST = np.log(1e-3), np.log(1e7)  # ln eta at both ends of a table of ``fluctuation.detection_table``


@kernel
def detection(eta, log_false_alarm):
    """Pd = Pf^(1 / (1 + eta)) as Sira et al. print it: eta is the mean energy ratio E/N0."""
    return np.exp(log_false_alarm / (1.0 + eta))


@inlined
def tabulated(eta, log_false_alarm, table):
    """Pd at eta = 2E/N0 by ``fluctuation.detection_table``, interpolated in ln eta; an empty table: Swerling 1."""
    last = len(table) - 1
    if last < 0:
        return detection(0.5 * eta, log_false_alarm)
    place = (np.log(eta) - FIRST) / (LAST - FIRST) * last
    place = min(max(place, 0.0), last - 1e-9)
    i = int(place)
    return table[i] + (place - i) * (table[i + 1] - table[i])


@batched("(),()->()")
def probability(energy_ratio, log_false_alarm, pd):
    """Pd, element by element."""
    for e in range(pd.shape[0]):
        pd[e] = detection(energy_ratio[e], log_false_alarm[e])
