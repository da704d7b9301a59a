"""Compiled look-up of the clutter power that ``scatterers.clutter_field`` tabulates."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.kernels import inlined, kernel


class ClutterField(NamedTuple):
    """c(r, v) of several waveforms at even steps of ln r and of v, and the texture."""

    power: Any  # (waveform, range, rate)
    nearest: float  # first range, m
    ranges_per_e: float  # steps of the range, for a factor of e
    slowest: float  # first range-rate, m/s
    rates_per_speed: float  # steps of the range-rate, for 1 m/s
    texture: Any  # (n,) equally likely values of the local over the mean power, rising


@inlined
def cell_of(steps, count):
    """(first point, share of the next one) of a place in steps from the first of ``count`` points; ends hold beyond."""
    steps = min(max(steps, 0.0), count - 1 - 1e-9)
    return int(steps), steps - int(steps)


@kernel
def noise_with_clutter(field, waveform, r, v, share):
    """1 + c(r, v) g: the power of noise and clutter in a waveform's filter over that of noise; 1 where field is None.

    ``share``: probability of a smaller texture g, in [0, 1).
    """
    power = 1.0
    if field is not None:
        table = field.power[int(waveform)]
        i, a = cell_of(np.log(max(r, field.nearest) / field.nearest) * field.ranges_per_e, table.shape[0])
        j, b = cell_of((v - field.slowest) * field.rates_per_speed, table.shape[1])
        mean = (1.0 - a) * ((1.0 - b) * table[i, j] + b * table[i, j + 1])
        mean += a * ((1.0 - b) * table[i + 1, j] + b * table[i + 1, j + 1])
        power += mean * field.texture[int(share * len(field.texture))]
    return power
