"""Detection of a fluctuating target in compiled form; ``detection.py`` holds the public functions."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import batched, kernel


@kernel
def detection(eta, log_false_alarm):
    """Pd = Pf^(1 / (1 + eta)) as Sira et al. print it: eta is the mean energy ratio E/N0."""
    return np.exp(log_false_alarm / (1.0 + eta))


@batched("(),()->()")
def probability(energy_ratio, log_false_alarm, pd):
    """Pd, element by element."""
    for e in range(pd.shape[0]):
        pd[e] = detection(energy_ratio[e], log_false_alarm[e])
