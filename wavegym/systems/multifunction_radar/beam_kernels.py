"""The compiled beam of the multifunction radar: energy, detections, errors, and the information in a miss.

Shapes: g targets, f findings of a dwell: range (m), azimuth (rad), z, and the number of the target (-1: false alarm),
which only the truth reads. S is the mean E/N0 of the echo. The receiver measures z, the power of echo and noise
together. Both are complex normal (Swerling 1), so z is exponential with mean 1 + S. The probability of z > T is
exp(-T / (1 + S)), and the excess over T is exponential again. Range and azimuth have the errors of a matched filter and
a monopulse at the measured power: variances proportional to 1 / (2 z). World and tracker both compute them from z, so
no SNR is assumed.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.counter_rng_kernels import exponential, normal, stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.platform_kernels import bearing, wrapped

TWO_WAY = 8.0 * np.log(2.0)  # loss of a pointing error d: exp(-TWO_WAY d^2 / B^2); at B / 2 half the power each way
REACH = 1.5  # beam widths off the axis beyond which no echo is seen: the loss is 54 dB there
NODES = np.array([-2.8569700138728056, -1.3556261799742659, 0.0, 1.3556261799742659, 2.8569700138728056])
WEIGHTS = np.array([0.011257411327720691, 0.22207592200561266, 8.0 / 15.0, 0.22207592200561266, 0.011257411327720691])
NARROW = 0.25  # standard deviation in beam widths below which Gauss-Hermite quadrature is used
STEPS = 6  # of the trapezoidal rule from the axis to ``REACH``
FALSE = 10_000  # number of the stream of false alarms within a dwell's key


class Beam(NamedTuple):
    """The radar's numbers."""

    width: float  # B, rad: half-power width of the beam, one way
    reference: float  # m: range at which a dwell of ``unit`` has E/N0 = 1 on the beam's axis
    unit: float  # s
    range_error: float  # m: standard deviation of range at 2 z = 1
    angle_error: float  # rad: of azimuth at 2 z = 1
    range_cell: float  # m: a false alarm occurs in each cell with probability exp(-T)
    nearest: float  # m
    farthest: float  # m
    gate: float  # squared Mahalanobis distance


@inlined
def energy(r, off, seconds, beam):
    """S of a target at range r, ``off`` rad from the beam's axis, in a dwell of ``seconds``."""
    ratio = beam.reference / r
    gain = ratio * ratio * ratio * ratio * seconds / beam.unit
    return gain * np.exp(-TWO_WAY * off * off / (beam.width * beam.width))


@inlined
def detection(S, threshold):
    """Probability that z exceeds the threshold."""
    return np.exp(-threshold / (1.0 + S))


@inlined
def mean_inverse_power(S, threshold):
    """Mean of 1 / z given a detection, with an error below 5 %: exp(x) E1(x) / (1 + S) with x = T / (1 + S).

    exp(x) E1(x) is near ln(1 + c / x), where c increases from exp(-gamma) at 0 (Euler's gamma) to 1 - 1 / (2 x).
    """
    x = threshold / (1.0 + S)
    c = (0.5615 + 0.877 * x) / (1.0 + 0.877 * x)
    return np.log1p(c / x) / (1.0 + S)


@kernel
def expected_detection(r, off, variance, seconds, threshold, beam):
    """Probability of detection, and a ratio for a miss; the azimuth has a variance and a mean ``off`` the beam's axis.

    The ratio is the mean square distance from that mean given a miss, divided by the variance. A narrow distribution is
    integrated by Gauss-Hermite quadrature, a wide one by the trapezoidal rule over the beam.
    """
    sigma, square, pd = np.sqrt(variance), 1.0, 0.0
    if sigma < NARROW * beam.width:
        for i in range(len(NODES)):
            chance = detection(energy(r, off + NODES[i] * sigma, seconds, beam), threshold)
            pd += WEIGHTS[i] * chance
            square -= WEIGHTS[i] * NODES[i] * NODES[i] * chance
    else:
        apart = REACH * beam.width / STEPS
        for i in range(-STEPS, STEPS + 1):
            u = (i * apart - off) / sigma
            weight = apart / sigma * np.exp(-0.5 * u * u) / np.sqrt(2.0 * np.pi)
            chance = detection(energy(r, i * apart, seconds, beam), threshold)
            pd += weight * chance
            square -= weight * u * u * chance
    return pd, square / (1.0 - pd) if pd < 1.0 else 1.0


@kernel
def coverage(r, seconds, threshold, beam):
    """Integral of the probability of detection over the azimuth, in beam widths."""
    apart, total = REACH / STEPS, 0.0
    for i in range(-STEPS, STEPS + 1):
        total += apart * detection(energy(r, i * apart * beam.width, seconds, beam), threshold)
    return total


@kernel
def echoes(key, x, here, late, axis, seconds, threshold, beam, found):
    """Detections of true targets x (g, n), moved on by ``late`` s; fills found (f, 4), returns their number."""
    count = 0
    for g in range(len(here)):
        if not here[g] or count == len(found):
            continue
        px, py = x[g, 0] + late * x[g, 1], x[g, 2] + late * x[g, 3]
        azimuth = bearing(px, py)
        off = wrapped(azimuth - axis)
        if abs(off) > REACH * beam.width:
            continue
        own, r = stream(key, g), np.sqrt(px * px + py * py)
        S = energy(r, off, seconds, beam)
        if uniform(own, 0) < detection(S, threshold):
            z = threshold + (1.0 + S) * exponential(own, 1)
            spread = np.sqrt(0.5 / z)
            found[count, 0] = r + beam.range_error * spread * normal(own, 2)
            found[count, 1] = azimuth + beam.angle_error * spread * normal(own, 3)
            found[count, 2], found[count, 3] = z, g
            count += 1
    return count


@kernel
def false_alarms(key, axis, low, high, threshold, beam, found, count):
    """Append false alarms, uniform between two ranges and across the beam, to found[:count]; returns the number."""
    own, expected, sum_of_gaps, i = stream(key, FALSE), np.exp(-threshold) * (high - low) / beam.range_cell, 0.0, 0
    while count < len(found):
        sum_of_gaps += exponential(own, 4 * i)
        if sum_of_gaps > expected:
            break
        found[count, 0] = low + (high - low) * uniform(own, 4 * i + 1)
        found[count, 1] = axis + beam.width * (uniform(own, 4 * i + 2) - 0.5)
        found[count, 2], found[count, 3] = threshold + exponential(own, 4 * i + 3), -1.0
        count, i = count + 1, i + 1
    return count


@inlined
def false_density(threshold, beam):
    """Expected false alarms of a dwell for each metre and radian."""
    return np.exp(-threshold) / (beam.range_cell * beam.width)


@inlined
def errors(z, beam, variance):
    """Fill variance (2,) of range and azimuth at the measured power z."""
    variance[0] = beam.range_error * beam.range_error * 0.5 / z
    variance[1] = beam.angle_error * beam.angle_error * 0.5 / z
