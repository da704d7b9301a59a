"""Simulated futures of the multifunction radar under the rule of the greatest gain per second, in compiled form.

Shapes: e rows, each a belief of its own; others as in ``step_kernels``.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.systems.multifunction_radar.dwell_kernels import drop_tracks, thin
from wavegym.systems.multifunction_radar.gain_kernels import expected_to_find, gains_of_row
from wavegym.systems.multifunction_radar.step_kernels import (
    SEARCH,
    UPDATE,
    chosen,
    foresee_update,
    pass_time,
    slots_of,
)


@inlined
def greatest(gains, existence, menu):
    """The allowed action of the greatest gain (action, 1); the first of equals."""
    kind, which = menu[0], menu[1]
    best, most = len(kind) - 1, -np.inf
    for a in range(len(kind)):
        if gains[a, 0] > most and (kind[a] != UPDATE or existence[which[a]] > 0.0):
            best, most = a, gains[a, 0]
    return best


@kernel
def simulate(batch, first, keys, seconds, menu, thresholds, laws, ahead, worth, value):
    """Add to value (e,) the cost of the next ``seconds`` that begin with the actions ``first`` (e,).

    A search in a future finds the expected number of targets, not single ones. That number leaves the undetected, still
    costs c0 a second until the future ends, and earns ``worth`` seconds of c0. Single targets found by chance would
    make two futures differ by more than any update is worth. keys (e,): of the draws of updates.
    """
    modes, beam, area, most = laws
    scratch, gains = np.empty_like(batch.undetected[0]), np.empty((len(menu[0]), 1))
    aheads = np.array([ahead])
    for e in range(len(first)):
        action, end, n = first[e], batch.time[e] + seconds, 0
        slots, undetected = slots_of(e, batch), batch.undetected[e]
        while True:
            start = batch.time[e]
            dwell = chosen(action, batch.existence[e], menu)
            pass_time(e, batch, dwell, modes, area, most, scratch)
            time = batch.time[e]
            value[e] += batch.spent[e] * min((end - start) / dwell.duration, 1.0)
            if dwell.kind == UPDATE:
                own = stream(stream(keys[e], dwell.which), n)
                draws = np.array([uniform(own, 0), uniform(own, 1)])
                law = (thresholds[0], modes, beam, area)
                foresee_update(dwell.which, time, slots, dwell.seconds, draws, law)
            elif dwell.kind == SEARCH:
                covers = menu[4][action]
                found = expected_to_find(undetected[dwell.which], covers, area)
                value[e] += found * most * (max(end - time, 0.0) - worth)
                thin(undetected[dwell.which], covers, area)
            drop_tracks(time, slots, undetected, modes, most, area)
            if time >= end:
                break
            gains_of_row(e, batch, menu, thresholds, laws, aheads, worth, gains)
            action, n = greatest(gains, batch.existence[e], menu), n + 1
