"""The compiled beam of the multifunction radar: energy, detections, errors, and the information in a miss.

Shapes: g targets, f findings of a dwell: range (m), sine of the azimuth, range-rate modulo the fold (m/s), z, and the
number of the target (-1: false alarm), which only the truth reads.

A dwell is b bursts, each coherent. S is the mean E/N0 of a burst's echo. The receiver measures z, the sum over the
bursts of the power of echo and noise together. Both are complex normal and independent between bursts (Swerling 2), so
z is a gamma variable of shape b and mean b (1 + S).

The antenna is a planar array. In the sine of the azimuth its beam has the same width in every direction, and offsets
``off`` are in that width. The gain falls with the cosine of the direction, so an echo keeps cos^3. The monopulse ratio
of a target off the axis, given z, is normal with mean k off S / (1 + S) and variance (1 + (k off)^2 S / (1 + S)) /
(2 z), where k is the slope. That of a false alarm has S = 0. Range and range-rate have the errors of a matched filter
at the measured power: variances proportional to 1 / (2 z). World and tracker both compute them from z.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.counter_rng_kernels import exponential, normal, stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.systems.multifunction_radar.flight_kernels import moved

SLOPE = 1.6  # k, of the monopulse ratio over the offset in beam widths
TWO_WAY = 8.0 * np.log(2.0)  # loss of an offset d: exp(-TWO_WAY d^2); at half a width half the power each way
REACH = 1.0  # offset beyond which no echo is seen: the loss is 24 dB there
NODES = np.array([-2.8569700138728056, -1.3556261799742659, 0.0, 1.3556261799742659, 2.8569700138728056])
WEIGHTS = np.array([0.011257411327720691, 0.22207592200561266, 8.0 / 15.0, 0.22207592200561266, 0.011257411327720691])
NARROW = 0.25  # standard deviation in beam widths below which Gauss-Hermite quadrature is used
STEPS = 5  # of the trapezoidal rule from the axis to ``REACH``
FALSE = 1  # number of the stream of false alarms within a dwell's key
BURSTS = 3  # a target's draws: errors of range, azimuth and range-rate, then the power of each burst
FINEST = 0.05  # step of beta in the table of shares kept


class Beam(NamedTuple):
    """The radar's numbers."""

    width: float  # B: half-power width of the beam, one way, in the sine of the azimuth
    reference: float  # m: range at which a burst of gain 1 has E/N0 = 1 from 1 m^2 on the axis, straight ahead
    range_error: float  # m: standard deviation of range at 2 z = 1
    fold: float  # m/s: range-rates are measured modulo this
    kept: np.ndarray  # share of the energy that a burst keeps at beta = 0, FINEST, 2 FINEST, ...
    sections: np.ndarray  # (c,) m^2: mean radar cross section of each class of targets
    nearest: float  # m
    farthest: float  # m
    gate: float  # squared Mahalanobis distance


class Look(NamedTuple):
    """What a dwell sends and how its echo is judged, whatever its direction."""

    bursts: int  # b
    gain: float  # S of 1 m^2 at the reference range, on the axis, straight ahead, without acceleration
    threshold: float  # T of z
    cells: float  # cells of range, range-rate and elevation for each metre of range
    rate_error: float  # m/s: standard deviation of range-rate at 2 z = 1
    stretch: float  # s^2/m: beta over the radial acceleration: the square of the burst's length over the wavelength
    kept: np.ndarray  # (m,) mean share of the energy kept, of a target in each mode


@inlined
def share_kept(acceleration, look, beam):
    """Share of the energy that a burst keeps of a target of a radial acceleration, by interpolation."""
    place = abs(acceleration) * look.stretch / FINEST
    i = min(int(place), len(beam.kept) - 2)
    return beam.kept[i] + min(place - i, 1.0) * (beam.kept[i + 1] - beam.kept[i])


@inlined
def on_axis(r, axis, look, beam):
    """S of 1 m^2 at range r on an axis (its sine), without acceleration."""
    ratio, square = beam.reference / r, 1.0 - axis * axis
    return look.gain * ratio * ratio * ratio * ratio * square * np.sqrt(square)


@inlined
def loss(off):
    """Share of the echo of a target ``off`` the axis, two-way."""
    return np.exp(-TWO_WAY * off * off)


@inlined
def mean_loss(off, spread):
    """Mean of ``loss`` over a normal offset of variance ``spread``."""
    wider = 1.0 + 2.0 * TWO_WAY * spread
    return np.exp(-TWO_WAY * off * off / wider) / np.sqrt(wider)


@inlined
def exceeds(x, bursts):
    """Probability that a gamma variable of shape ``bursts`` and scale 1 exceeds x: e^-x times the sum of x^k / k!."""
    term, total = 1.0, 1.0
    for k in range(1, bursts):
        term *= x / k
        total += term
    return total * np.exp(-x)


@inlined
def detection(S, look):
    """Probability that z exceeds the threshold."""
    return exceeds(look.threshold / (1.0 + S), look.bursts)


@kernel
def power_beyond(share, S, look):
    """z of a detection, exceeded with the probability ``share`` among detections: Newton's method on the logarithm."""
    b, x = look.bursts, look.threshold / (1.0 + S) - np.log(share)
    if b > 1:
        wanted = np.log(share * exceeds(look.threshold / (1.0 + S), b))
        for _ in range(8):
            term, total = 1.0, 1.0
            for k in range(1, b):
                term *= x / k
                total += term
            x += (np.log(total) - x - wanted) * total / term
    return (1.0 + S) * x


@inlined
def log_ratio(z, S, look):
    """Log of the density of z with an echo over that without."""
    return z * S / (1.0 + S) - look.bursts * np.log1p(S)


@inlined
def false_offset_density(off, z):
    """Density of a false alarm's measured offset, in beam widths."""
    precision = 2.0 * z * SLOPE * SLOPE
    return np.sqrt(precision / (2.0 * np.pi)) * np.exp(-0.5 * precision * off * off)


@kernel
def expected_detection(S, off, spread, look):
    """Probability of detection, and its mean times u^2, for an offset of mean ``off`` and variance ``spread``.

    S is that on the axis; u is the offset's distance from its mean, in standard deviations. A narrow distribution is
    integrated by Gauss-Hermite quadrature, a wide one by the trapezoidal rule over the beam.
    """
    sigma, square, pd = np.sqrt(spread), 0.0, 0.0
    if sigma < NARROW:
        for i in range(len(NODES)):
            chance = WEIGHTS[i] * detection(S * loss(off + NODES[i] * sigma), look)
            pd += chance
            square += NODES[i] * NODES[i] * chance
    else:
        apart = REACH / STEPS
        for i in range(-STEPS, STEPS + 1):
            u = (i * apart - off) / sigma
            weight = apart / sigma * np.exp(-0.5 * u * u) / np.sqrt(2.0 * np.pi)
            chance = weight * detection(S * loss(i * apart), look)
            pd += chance
            square += u * u * chance
    return pd, square


@kernel
def mean_detection(S, low, high, look):
    """Mean probability of detection over the offsets from low to high, where S is that on the axis."""
    apart, total = (high - low) / STEPS, 0.0
    for i in range(STEPS):
        off = low + (i + 0.5) * apart
        total += detection(S * loss(off), look) / STEPS if abs(off) <= REACH else 0.0
    return total


@inlined
def echo_of(key, g, state, scene, axis, look, found):
    """Draw the echo of target g, in a state (4,), from the target's own stream; returns z, and fills found (5,).

    scene: beam, the flying targets, classes of section (g,).
    """
    (beam, flying, section), (px, vx, py, vy) = scene, state
    r = np.sqrt(px * px + py * py)
    off = (px / r - axis) / beam.width
    radial = (px * flying.acceleration[g, 0] + py * flying.acceleration[g, 1]) / r
    S = on_axis(r, axis, look, beam) * beam.sections[section[g]] * loss(off) * share_kept(radial, look, beam)
    z = 0.0
    for i in range(look.bursts):
        z += (1.0 + S) * exponential(key, BURSTS + i)
    seen, slope = S / (1.0 + S), SLOPE * off
    spread = np.sqrt(0.5 / z)
    found[0] = r + beam.range_error * spread * normal(key, 0)
    ratio = slope * seen + np.sqrt(1.0 + slope * slope * seen) * spread * normal(key, 1)
    found[1] = axis + beam.width * ratio / SLOPE
    rate = (px * vx + py * vy) / r + look.rate_error * spread * normal(key, 2)
    found[2] = rate - beam.fold * np.rint(rate / beam.fold)
    found[3], found[4] = z, g
    return z


@kernel
def echoes(key, looks, scene, late, axis, look, found):
    """Detections of the true targets, ``late`` s after the cell began; fills found (f, 5), returns their number.

    looks (g,): how often each target has been in the beam before. Its next echo has draws of its own, whatever else the
    radar has done, so that schedules can be compared on the same echoes.
    """
    count, (beam, flying, _) = 0, scene
    for g in range(len(flying.here)):
        if not flying.here[g] or count == len(found):
            continue
        state = moved(flying, g, late)
        px, py = state[0], state[2]
        if abs(px / np.sqrt(px * px + py * py) - axis) > REACH * beam.width:
            continue
        own = stream(stream(key, g), looks[g])
        looks[g] += 1
        if echo_of(own, g, state, scene, axis, look, found[count]) > look.threshold:
            count += 1
    return count


@kernel
def false_alarms(key, axis, look, beam, found, count):
    """Append false alarms to found[:count]: uniform in range and range-rate, around the axis; returns the number.

    z of noise beyond the threshold: j of the b exponentials end before T, with a weight of T^j / j!.
    """
    own, sum_of_gaps, T = stream(key, FALSE), 0.0, look.threshold
    expected = look.cells * (beam.farthest - beam.nearest) * exceeds(T, look.bursts)
    for i in range(len(found)):
        drawn = stream(own, i)
        sum_of_gaps += exponential(drawn, 0)
        if sum_of_gaps > expected or count == len(found):
            break
        rest, term, before = uniform(drawn, 1) * exceeds(T, look.bursts) * np.exp(T), 1.0, 0
        while rest > term and before < look.bursts - 1:
            rest, before = rest - term, before + 1
            term *= T / before
        z = T
        for k in range(look.bursts - before):
            z += exponential(drawn, 5 + k)
        found[count, 0] = beam.nearest + (beam.farthest - beam.nearest) * uniform(drawn, 2)
        found[count, 1] = axis + beam.width * np.sqrt(0.5 / z) / SLOPE * normal(drawn, 3)
        found[count, 2] = beam.fold * (uniform(drawn, 4) - 0.5)
        found[count, 3], found[count, 4] = z, -1.0
        count += 1
    return count
