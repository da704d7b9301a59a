"""Compiled tracks of the multifunction radar: an IMM of two modes for each slot, its existence, its cross section.

Shapes: k slots, m = 2 modes, n = 4 elements of [x xdot y ydot], c classes of cross section, q = 3 measured quantities
(range, sine of the azimuth, range-rate). A slot keeps its state at the last update: mean (m, n) and covariance (m, n,
n) of each mode and the modes' probabilities. Its state at other times follows in closed form.

The tracker takes a target's acceleration as white, with the density of its mode. So the covariance of all modes
together grows with the expected density: q(s) = q* + (q(0) - q*) exp(-rate s), with the stationary density q* and the
rate of the Markov chain.
The covariance of the position after s seconds is

    p + 2 c s + v s^2 + (q* s^3 / 3 + (q(0) - q*) I(s)) 1,    I(s) = integral of (s - u)^2 exp(-rate u) du over 0..s,

with p, v the covariances of position and velocity at the last update and c the symmetric part of their
cross-covariance.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.array_kernels import copy_matrices, copy_matrix, copy_vector
from wavegym.core.kernels import inlined, kernel
from wavegym.trackers.imm_kernels import LOG_2PI, combine_one, mix_one, reweigh_one
from wavegym.trackers.kernels import correct_one, gain_one, shrink_one

NN, MM = (0, 0, 0, 0), (0, 0)  # the state's and the modes' sizes, known when compiling
RANGE, SINE, RATE = 0, 1, 2  # the measured quantities
PLACE, STATE = (0, 2), (0, 1, 2, 3)  # elements on which range and sine depend, and all of them
SMALL = 1e-3  # rate times seconds below which I(s) is a series


class Modes(NamedTuple):
    """The tracker's motion model."""

    density: tuple[float, float]  # white acceleration of each mode, m^2/s^3
    leave: tuple[float, float]  # rate at which a target leaves each mode, 1/s


class Slots(NamedTuple):
    """Tracks of one environment; arrays (k, ...)."""

    time: np.ndarray  # of the last update, s
    mean: np.ndarray  # (k, m, n)
    covariance: np.ndarray  # (k, m, n, n)
    probability: np.ndarray  # (k, m) of the modes
    existence: np.ndarray  # probability that there is a target; 0: the slot is free
    section: np.ndarray  # (k, c) probability of each class of cross section
    moments: np.ndarray  # (k, 10): xx, xy and yy of p, of c and of v of the module's first lines, then q(0)


@inlined
def steady(modes):
    """Probabilities of the modes of a target that is not known."""
    first, second = modes.leave
    return second / (first + second), first / (first + second)


@inlined
def stationary_density(modes):
    """q*: the mean density of a target of unknown mode, m^2/s^3."""
    first, second = steady(modes)
    return first * modes.density[0] + second * modes.density[1]


@inlined
def switched(modes, seconds, transition):
    """Fill transition[0] (m, m): probabilities of the modes after ``seconds``, from row to column."""
    rate = modes.leave[0] + modes.leave[1]
    gone = -np.expm1(-rate * seconds)
    for i in range(2):
        transition[0, i, 1 - i] = modes.leave[i] / rate * gone
        transition[0, i, i] = 1.0 - transition[0, i, 1 - i]


@kernel
def decayed_growth(rate, s):
    """I(s) of the module's first lines."""
    u = rate * s
    if u < SMALL:
        return s * s * s * (1.0 / 3.0 - u / 12.0 + u * u / 60.0)
    return (u * u - 2.0 * u - 2.0 * np.expm1(-u)) / (rate * rate * rate)


@inlined
def growth_of_position(q, modes, s):
    """Growth of the position's variance on each axis in ``s`` seconds, if the expected density is q at first."""
    mean, rate = stationary_density(modes), modes.leave[0] + modes.leave[1]
    return mean * s * s * s / 3.0 + (q - mean) * decayed_growth(rate, s)


@inlined
def spread_at(moments, modes, s):
    """xx, xy and yy of the position's covariance ``s`` seconds after the moments (10,)."""
    growth = growth_of_position(moments[9], modes, s)
    xx = moments[0] + s * (2.0 * moments[3] + s * moments[6]) + growth
    xy = moments[1] + s * (2.0 * moments[4] + s * moments[7])
    yy = moments[2] + s * (2.0 * moments[5] + s * moments[8]) + growth
    return xx, xy, yy


@inlined
def advance_one(i, x, P, seconds, q):
    """x[i] (n,) and P[i] (n, n) after ``seconds`` of white acceleration of density q on both axes."""
    for a in (0, 2):
        x[i, a] += seconds * x[i, a + 1]
    for a in (0, 2):
        for b in range(4):
            P[i, a, b] += seconds * P[i, a + 1, b]
    for b in (0, 2):
        for a in range(4):
            P[i, a, b] += seconds * P[i, a, b + 1]
    for a in (0, 2):
        P[i, a, a] += q * seconds * seconds * seconds / 3.0
        P[i, a, a + 1] += q * seconds * seconds / 2.0
        P[i, a + 1, a] = P[i, a, a + 1]
        P[i, a + 1, a + 1] += q * seconds


@kernel
def predict_slot(k, time, slots, modes, x, P, mu, mean, covariance):
    """Slot k at ``time``: predicted x (m, n), P (m, n, n), mu (1, m); and mean (1, n) and covariance of all modes.

    The mode changes first, then the target flies. This is valid if the revisit interval is much shorter than the stay
    in a mode.
    """
    transition, seconds = np.empty((1, 2, 2)), time - slots.time[k]
    switched(modes, seconds, transition)
    mix_one(0, slots.mean[k], slots.covariance[k], slots.probability[k : k + 1], 0, transition, mu, x, P, NN, MM)
    for j in range(2):
        advance_one(j, x, P, seconds, modes.density[j])
    combine_one(0, x, P, mu, mean, covariance, NN, MM)


@inlined
def look_at(x, i, h, H):
    """Range, sine of the azimuth and range-rate h (q,) of x[i] from the radar, and their gradients H (q, n)."""
    px, vx, py, vy = x[i, 0], x[i, 1], x[i, 2], x[i, 3]
    r = np.sqrt(px * px + py * py)
    c, s = py / r, px / r
    h[RANGE], h[SINE], h[RATE] = r, s, s * vx + c * vy
    H[:] = 0.0
    H[RANGE, 0], H[RANGE, 2] = s, c
    H[SINE, 0], H[SINE, 2] = c * c / r, -s * c / r
    across = (c * vx - s * vy) / r
    H[RATE, 0], H[RATE, 1], H[RATE, 2], H[RATE, 3] = c * across, s, -s * across, c


@inlined
def toward_axis(h, H, axis, seen):
    """Make the sine and its gradient those that a monopulse reads: the offset from the axis times ``seen``."""
    h[SINE] = axis + seen * (h[SINE] - axis)
    for a in (0, 2):
        H[SINE, a] *= seen


@inlined
def folded(rate, fold):
    """A range-rate, or a difference of two, modulo the fold."""
    return rate - fold * np.rint(rate / fold)


@kernel
def keep_slot(k, time, slots, modes, x, P, mu):
    """Store x (m, n), P (m, n, n), mu (1, m) and their moments as slot k at ``time``."""
    mean, covariance = np.empty((1, 4)), np.empty((1, 4, 4))
    combine_one(0, x, P, mu, mean, covariance, NN, MM)
    slots.time[k] = time
    copy_matrix(x, slots.mean[k])
    copy_matrices(P, slots.covariance[k])
    copy_vector(mu[0], slots.probability[k])
    C, moments = covariance[0], slots.moments[k]
    moments[0], moments[1], moments[2] = C[0, 0], C[0, 2], C[2, 2]
    moments[3], moments[4], moments[5] = C[0, 1], 0.5 * (C[0, 3] + C[1, 2]), C[2, 3]
    moments[6], moments[7], moments[8] = C[1, 1], C[1, 3], C[3, 3]
    moments[9] = mu[0, 0] * modes.density[0] + mu[0, 1] * modes.density[1]


@kernel
def correct_slot(x, P, mu, measured):
    """Update the prediction x (m, n), P (m, n, n), mu (1, m) of a slot; returns the log of the measurement's density.

    measured: the axis and the share ``seen`` of ``toward_axis``, the values (q,), their variances (q,), how many of
    them count, and the fold of the range-rate.
    """
    axis, seen, value, variance, count, fold = measured
    h, H, v, d, c = np.empty(3), np.empty((3, 4)), np.empty(4), np.empty(4), mu.copy()
    log_likelihood = np.zeros((1, 2))
    for j in range(2):
        look_at(x, j, h, H)
        toward_axis(h, H, axis, seen)
        d[:] = 0.0
        for a in range(count):
            s = gain_one(j, P, H, a, v, NN, STATE) + variance[a]
            y = folded(value[a] - h[a], fold) if a == RATE else value[a] - h[a]
            rest = y
            for b in range(4):
                rest -= H[a, b] * d[b]
            log_likelihood[0, j] -= 0.5 * (rest * rest / s + np.log(s) + LOG_2PI)
            correct_one(d, H, a, v, s, y, NN)
            shrink_one(j, P, v, s, NN)
        for b in range(4):
            x[j, b] += d[b]
    best = max(log_likelihood[0, 0], log_likelihood[0, 1])
    evidence = np.log(c[0, 0] * np.exp(log_likelihood[0, 0] - best) + c[0, 1] * np.exp(log_likelihood[0, 1] - best))
    reweigh_one(0, c, log_likelihood, mu, MM)
    return best + evidence


@kernel
def begin_slot(k, time, slots, modes, r, sine, variance, speed):
    """Begin a track at a measured place; the velocity is unknown, with the variance speed^2 on each axis.

    variance (2,): of the range and of the sine of the azimuth.
    """
    s, c = sine, np.sqrt(1.0 - sine * sine)
    along, across = variance[0], r * r * variance[1] / (c * c)
    x, P, mu = np.zeros((2, 4)), np.zeros((2, 4, 4)), np.empty((1, 2))
    mu[0, 0], mu[0, 1] = steady(modes)
    for j in range(2):
        x[j, 0], x[j, 2] = r * s, r * c
        P[j, 0, 0], P[j, 2, 2] = along * s * s + across * c * c, along * c * c + across * s * s
        P[j, 0, 2] = P[j, 2, 0] = (along - across) * s * c
        P[j, 1, 1] = P[j, 3, 3] = speed * speed
    keep_slot(k, time, slots, modes, x, P, mu)


@kernel
def first_slots(time, x, here, known, error, modes, variance, slots, origin):
    """Begin a track of every known target (g,) that is here, with estimates around x (g, n), and record its target.

    error (g, n) is standard normal. variance (2,): of position and velocity on each axis.
    """
    k, P, mu, mean = 0, np.zeros((2, 4, 4)), np.empty((1, 2)), np.empty((2, 4))
    mu[0, 0], mu[0, 1] = steady(modes)
    for j in range(2):
        for a in range(4):
            P[j, a, a] = variance[a % 2]
    for g in range(len(here)):
        if here[g] and known[g] and k < len(slots.existence):
            for a in range(4):
                mean[:, a] = x[g, a] + np.sqrt(variance[a % 2]) * error[g, a]
            keep_slot(k, time, slots, modes, mean, P, mu)
            slots.existence[k], slots.section[k], origin[k] = 1.0, 1.0 / slots.section.shape[1], g
            k += 1
