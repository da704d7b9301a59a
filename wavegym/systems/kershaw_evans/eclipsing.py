"""The visible part of a Gaussian chirp's echo if the receiver is off during transmission, in closed form.

``wavegym.sensors.eclipsing`` has the same for any waveform, from tables of its moments.
"""

from __future__ import annotations

from scipy.special import erfinv

from wavegym.core.arrays import Array
from wavegym.systems.kershaw_evans.eclipsing_kernels import visible_shares
from wavegym.waveforms.timing import ENERGY

HALF_LENGTH = float(erfinv(ENERGY))
"""Half of the interval that holds this share of the energy, in durations k."""


def visible_information(duration: Array, range_m: Array) -> Array:
    """Share of a Gaussian chirp's Fisher information that is left in the echo of its own pulse, at least 1e-9.

    The receiver opens when the transmitted interval ends, T/2 after the middle of the pulse (T = 3.64 k holds 99 % of
    the energy). Of an echo from range r it receives t >= T/2 - 2 r / c. The derivatives of s(t) by delay and by Doppler
    are both t s(t) times a constant. Their inner products over the open gate, less the projection on s, are therefore
    those of the whole pulse times one number: the variance of t over the gate (weighted with the energy in it) over
    k^2 / 2. With a = sqrt(2) (T/2 - 2 r / c) / k, Q the upper tail of the normal distribution and m = phi(a) / Q(a),
    it is

        h(a) = Q(a) (1 + a m - m^2).

    The gate is fixed in time, so the cut adds no delay information.

    Args:
        duration: k, s, any shape.
        range_m: r, m; broadcasts.
    """
    return visible_shares(duration, range_m, HALF_LENGTH)
