"""What a receiver that is off during transmission sees of a Gaussian chirp's echo, in closed form.

``wavegym.sensors.eclipsing`` has the same for any waveform, from tables of its moments.
"""

from __future__ import annotations

import numpy as np
from scipy.special import erfc, erfcx, erfinv

from wavegym.core.arrays import Array
from wavegym.waveforms import SPEED_OF_LIGHT
from wavegym.waveforms.timing import ENERGY

LEAST_VISIBLE = 1e-9
"""A pulse that is wholly eclipsed keeps this share of its information: its errors are 3e4 times as large."""

_HALF_LENGTH = float(erfinv(ENERGY))  # durations k: half of the interval that holds this share of the energy


def visible_information(duration: Array, range_m: Array) -> Array:
    """Share of a Gaussian chirp's Fisher information that is left in the echo of its own pulse, at least 1e-9.

    The receiver opens when the transmitted interval ends, T/2 after the middle of the pulse (T = 3.64 k holds 99 % of
    the energy). Of an echo from range r it sees t >= T/2 - 2 r / c. The derivatives of s(t) by delay and by Doppler are
    both t s(t) times a constant, so their inner products over the open gate, less the projection on s, are those of
    the whole pulse times one number: the variance of t over the gate (with the energy in it as weight) over k^2 / 2.
    With a = sqrt(2) (T/2 - 2 r / c) / k, Q the upper tail of the normal distribution and m = phi(a) / Q(a), it is

        h(a) = Q(a) (1 + a m - m^2).

    The gate stands still in time, so the cut adds no delay information of its own.

    Args:
        duration: k, s, any shape.
        range_m: r, m; broadcasts.
    """
    a = np.sqrt(2.0) * (_HALF_LENGTH - (2.0 / SPEED_OF_LIGHT) * abs(range_m) / duration)
    tail = np.sqrt(0.5) * a
    m = np.sqrt(2.0 / np.pi) / erfcx(tail)
    return np.maximum(0.5 * erfc(tail) * (1.0 + m * (a - m)), LEAST_VISIBLE)
