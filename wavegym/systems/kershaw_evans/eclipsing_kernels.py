"""What a closed receiver leaves of a Gaussian chirp, in compiled form; ``eclipsing.py`` has derivation and sources."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import batched, inlined, kernel
from wavegym.core.special_kernels import erfc, erfcx
from wavegym.waveforms.fisher import SPEED_OF_LIGHT

LEAST_VISIBLE = 1e-9
"""A pulse that is wholly eclipsed keeps this share of its information: its errors are 3e4 times as large."""
WHOLE = -9.0
"""Deviations of the pulse's energy from its middle to the gate's begin, below which h is 1 in double precision."""


@inlined
def visible_share(duration, range_m, half_length):
    """h(a), at least LEAST_VISIBLE; half_length: half of the transmitted interval, in durations; -inf: never cut."""
    a = np.sqrt(2.0) * (half_length - (2.0 / SPEED_OF_LIGHT) * abs(range_m) / duration)
    if a < WHOLE:
        return 1.0
    tail = np.sqrt(0.5) * a
    m = np.sqrt(2.0 / np.pi) / erfcx(tail)
    return max(0.5 * erfc(tail) * (1.0 + m * (a - m)), LEAST_VISIBLE)


@batched("(),(),()->()")
def visible_shares(duration, range_m, half_length, share):
    """``visible_share``, element by element."""
    for e in range(len(share)):
        share[e] = visible_share(duration[e], range_m[e], half_length[e])


@inlined
def received_one(C, duration, w, range_m, half_length, e, out):
    """out[e] (2, 2): C[w] of pulse w as received from ``range_m``."""
    share = visible_share(duration[w], range_m, half_length)
    for i in range(2):
        for j in range(2):
            out[e, i, j] = C[w, i, j] / share


@kernel
def received(C, duration, which, range_m, half_length, out):
    """out (e, c, 2, 2): C (w, 2, 2) of pulses ``which`` (e or 1, c) as received from ranges (e,)."""
    for e in range(out.shape[0]):
        own, out_own = which[e if which.shape[0] > 1 else 0], out[e]
        for c in range(out.shape[1]):
            received_one(C, duration, own[c], range_m[e], half_length, c, out_own)
