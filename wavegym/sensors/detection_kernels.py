"""Compiled SNR by range, and detection of a fluctuating target; ``detection.py`` has the public functions."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import batched, inlined, kernel


@kernel
def inverse_snr(r, reference, nearest):
    """1 / eta = (r / reference)^4, r at least ``nearest``; by products, because scalar and array powers may differ."""
    ratio = max(abs(r), nearest) / reference
    square = ratio * ratio
    return square * square


@batched("(),(),()->()")
def snr(r, reference, nearest, out):
    """eta = (reference / r)^4."""
    for e in range(r.shape[0]):
        out[e] = 1.0 / inverse_snr(r[e], reference[e], nearest[e])


FIRST, LAST = np.log(1e-3), np.log(1e7)  # ln eta at both ends of the tables of ``detection.py``
LOGIT = 23.0  # ln(f / (1 - f)) at the upper end of a table of ``detection.detected_snr_table``
CELL = 1.0  # eta below which errors grow no further: the error is about a resolution cell


@kernel
def detection(eta, log_false_alarm):
    """Pd = Pf^(1 / (1 + eta)) as in Sira et al.; eta is the mean energy ratio E/N0."""
    return np.exp(log_false_alarm / (1.0 + eta))


@inlined
def place_in(value, first, end, last):
    """Index and fraction of a value among 0 to ``last`` even steps from first to end; values beyond are clamped."""
    place = (value - first) / (end - first) * last
    place = min(max(place, 0.0), last - 1e-9)
    i = int(place)
    return i, place - i


@inlined
def tabulated(eta, log_false_alarm, table):
    """Pd at eta = 2E/N0 by ``detection.detection_table``, interpolated in ln eta; an empty table: Swerling 1."""
    if len(table) == 0:
        return detection(0.5 * eta, log_false_alarm)
    i, share = place_in(np.log(eta), FIRST, LAST, len(table) - 1)
    return table[i] + share * (table[i + 1] - table[i])


@inlined
def effective_snr(eta, table):
    """SNR of the mean covariance of a detected echo by ``detection.effective_snr_table``; an empty table: eta."""
    if len(table) == 0:
        return eta
    i, share = place_in(np.log(eta), FIRST, LAST, len(table) - 1)
    return max(eta * np.exp(table[i] + share * (table[i + 1] - table[i])), CELL)


@inlined
def snr_of_errors(eta, fraction, table):
    """max(realised SNR, CELL) of a detected echo by ``detection.detected_snr_table``; an empty table: eta.

    fraction: uniform in [0, 1), such as the draw that decided on the detection, divided by Pd.
    """
    if len(table) == 0:
        return eta
    i, share = place_in(np.log(eta), FIRST, LAST, table.shape[0] - 1)
    j, rest = place_in(np.log(fraction) - np.log1p(-fraction), -LOGIT, LOGIT, table.shape[1] - 1)
    low = table[i, j] + rest * (table[i, j + 1] - table[i, j])
    high = table[i + 1, j] + rest * (table[i + 1, j + 1] - table[i + 1, j])
    return max(eta * np.exp(low + share * (high - low)), CELL)


@batched("(),()->()")
def probability(energy_ratio, log_false_alarm, pd):
    """Pd, element by element."""
    for e in range(pd.shape[0]):
        pd[e] = detection(energy_ratio[e], log_false_alarm[e])
