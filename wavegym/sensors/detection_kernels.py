"""Compiled SNR by range, and detection of a fluctuating target; ``detection.py`` has the public functions."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.counter_rng_kernels import exponential, normal, uniform
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
LEVEL = 16  # first draw of the reference cells
CELL = 1.0  # eta below which errors grow no further: the error is about a resolution cell


class EchoLaw(NamedTuple):
    """Detection of an echo and the SNR of its errors, as ``detection.echo_law`` makes it. A row is a threshold."""

    threshold: Any  # (row,) T, power over that of the noise, or over the sum of the reference cells
    detection: Any  # (row, n) Pd at even steps of ln eta
    effective: Any  # (row, n) ln of the effective eta over eta; see ``effective_snr``
    energy: float  # E/N0 over eta
    shape: int  # K of the gamma law of the realised energy: 1, 2, or 0 for a steady echo
    searched: int  # quantities over which the receiver takes the greatest value
    realised: bool  # whether errors have the SNR of the realised echo; else that of the mean echo
    cells: int  # reference cells from whose mean power the threshold is set; 0: the noise is known


@kernel
def detection(eta, log_false_alarm):
    """Pd = Pf^(1 / (1 + eta)) as in Sira et al.; eta is the mean energy ratio E/N0."""
    return np.exp(log_false_alarm / (1.0 + eta))


@inlined
def interpolated(eta, table):
    """Value at eta of a table (n,) over even steps of ln eta; beyond its ends the last value."""
    place = (np.log(eta) - FIRST) / (LAST - FIRST) * (len(table) - 1)
    place = min(max(place, 0.0), len(table) - 1 - 1e-9)
    i = int(place)
    return table[i] + (place - i) * (table[i + 1] - table[i])


@inlined
def detection_of(eta, row, law):
    """Pd of an echo of mean SNR eta at the threshold in ``row`` of an ``EchoLaw``."""
    return interpolated(eta, law.detection[row])


@inlined
def effective_snr(eta, row, law):
    """SNR at which C / eta is the mean covariance of the errors of a detected echo of mean SNR eta."""
    if not law.realised:
        return eta
    return max(eta * np.exp(interpolated(eta, law.effective[row])), CELL)


@kernel
def received_snr(eta, row, key, law):
    """The world's look at an echo of mean SNR eta: the SNR of its errors, or 0 if it is not detected.

    The draws of ``key`` give the energy of the echo, by its law of fluctuation, and the receiver's noise. The output is
    |sqrt(S) + noise|^2 and half a chi-square variable with a degree of freedom for each quantity that is searched.
    """
    mean = law.energy * eta
    S = mean
    if law.shape == 1:
        S = mean * exponential(key, 0)
    if law.shape == 2:
        S = 0.5 * mean * (exponential(key, 0) + exponential(key, 1))
    noise = exponential(key, 2)
    power = S + 2.0 * np.sqrt(S * noise) * np.cos(2.0 * np.pi * uniform(key, 3)) + noise
    for pair in range(law.searched // 2):
        power += exponential(key, 5 + pair)
    if law.searched % 2:
        power += 0.5 * normal(key, 4) ** 2
    threshold = law.threshold[row]
    if law.cells:
        product = 1.0
        for i in range(law.cells):
            product *= uniform(key, LEVEL + i)
        threshold *= -np.log(product)
    if not power > threshold:
        return 0.0
    return max(2.0 * S, CELL) if law.realised else eta


@batched("(),()->()")
def probability(energy_ratio, log_false_alarm, pd):
    """Pd, element by element."""
    for e in range(pd.shape[0]):
        pd[e] = detection(energy_ratio[e], log_false_alarm[e])
