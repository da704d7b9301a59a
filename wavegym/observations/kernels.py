"""Scaling of observations, made in every step, and forecasts of dwells, made in every decision of an agent."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import kernel


@kernel
def scale(values, centre, width, limit, out, saturated):
    """out (env, fields) float32 = (values - centre) / width, clipped to +-limit; counts the clipped fields."""
    for e in range(values.shape[0]):
        clipped = 0
        for i in range(values.shape[1]):
            scaled = (values[e, i] - centre[i]) / width[i]
            clipped += int(abs(scaled) > limit)
            out[e, i] = min(max(scaled, -limit), limit)
        saturated[e] = clipped


@kernel
def forecast(gains, rows, durations, each, most, least, values):
    """The forecasts of every dwell, to ``values`` (env, action, field) in the order of ``Forecasts``.

    Gains (env, action, h) are divided by ``most``. ``rows`` (env, slot, column) are those of ``TrackSlots``, and each
    slot has ``each`` updates. An update of a free slot has zeros, except for the gains, the duration and the number of
    tracks.
    """
    powers, updates = gains.shape[2], rows.shape[1] * each
    last = len(durations) - 1
    for e in range(len(gains)):
        tracks = 0
        for k in range(rows.shape[1]):
            tracks += rows[e, k, 0] > 0.0
        for a in range(last + 1):
            out = values[e, a]
            for h in range(powers):
                out[h] = np.log10(max(gains[e, a, h] / most, 0.0) + least)
            known = out[powers:]
            known[:] = 0.0
            known[2], known[7] = np.log(durations[a]), np.log1p(tracks)
            known[1] = updates <= a < last
            if a >= updates or not rows[e, a // each, 0] > 0.0:
                continue
            own = rows[e, a // each]
            known[0], known[3], known[6] = 1.0, own[0], own[6]
            for n, column in ((4, 3), (5, 4), (8, 9), (9, 5), (10, 7)):
                known[n] = np.log2(max(own[column], least))
            known[11] = np.log2(max(own[8] * durations[a], least))
