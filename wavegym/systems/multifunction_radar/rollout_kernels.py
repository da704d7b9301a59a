"""Simulated futures of the multifunction radar under a rule that scores dwells, in compiled form.

Shapes: e rows, each a belief of its own; others as in ``step_kernels``.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.core.traits import CONFIRMED
from wavegym.systems.multifunction_radar.dwell_kernels import drop_tracks, rate_of_slot, thin
from wavegym.systems.multifunction_radar.gain_kernels import expected_to_find, scores_of_row
from wavegym.systems.multifunction_radar.step_kernels import (
    SEARCH,
    UPDATE,
    chosen,
    foresee_update,
    pass_time,
    slots_of,
)


@inlined
def greatest(scores, existence, menu):
    """The allowed action of the greatest score (action,); the first of equals."""
    kind, which = menu[0], menu[1]
    best, most = len(kind) - 1, -np.inf
    for a in range(len(kind)):
        if scores[a] > most and (kind[a] != UPDATE or existence[which[a]] > 0.0):
            best, most = a, scores[a]
    return best


@kernel
def cost_to_come(time, slots, rule, laws):
    """What the tracks cost in the seconds that the rule looks ahead, if nothing is done in them.

    A tentative track counts as often as the rule has it.
    """
    modes, _, area, most = laws
    total = 0.0
    for k in range(len(slots.existence)):
        if slots.existence[k] > 0.0:
            weight = np.exp(rule.tentative) if slots.existence[k] < CONFIRMED else 1.0
            for ahead, share in ((rule.ahead, 1.0), (rule.later, rule.far)):
                for i in range(3):  # Simpson's rule
                    rate = rate_of_slot(k, time + 0.5 * i * ahead, slots, modes, most, area)
                    total += weight * share * ahead / 6.0 * (4.0 if i == 1 else 1.0) * rate
    return total


@kernel
def simulate_dwell(e, batch, action, keys, updates, end, worth, menu, thresholds, laws):
    """Do one dwell; returns its cost less what it earns. updates (k,): how often each slot was updated before."""
    modes, beam, area, most = laws
    slots, undetected = slots_of(e, batch), batch.undetected[e]
    dwell = chosen(action, batch.existence[e], menu)
    pass_time(e, batch, dwell, modes, area, most, np.empty_like(undetected))
    time, value = batch.time[e], batch.spent[e]
    if dwell.kind == UPDATE:
        own = stream(stream(keys[e], dwell.which), updates[dwell.which])
        updates[dwell.which] += 1
        draws = np.array([uniform(own, 0), uniform(own, 1)])
        law = (thresholds[0], modes, beam, area)
        foresee_update(dwell.which, time, slots, dwell.seconds, draws, law)
    elif dwell.kind == SEARCH:
        covers = menu[4][action]
        found = expected_to_find(undetected[dwell.which], covers, area)
        value += found * most * (max(end - time, 0.0) - worth)
        thin(undetected[dwell.which], covers, area)
    drop_tracks(time, slots, undetected, modes, most, area)
    return value


@kernel
def simulate(batch, first, keys, seconds, menu, thresholds, laws, rule, value):
    """Add to value (e,) the cost of the next ``seconds`` that begin with the actions ``first`` (e,), and of what comes.

    A search in a future finds the expected number of targets, not single ones. That number leaves the undetected, still
    costs c0 a second until the future ends, and earns the rule's worth in seconds of c0. Single targets found by chance
    would make two futures differ by more than any update is worth. keys (e,): of the draws of updates. The n-th update
    of a slot has the same draws in all futures of a key, whatever comes before it. Of the dwell in which a future ends,
    the part before the end counts, in what it costs as in what it does: or futures would differ by a whole dwell.
    """
    scores, duration = np.empty(len(menu[0])), menu[3]
    for e in range(len(first)):
        action, end, updates = first[e], batch.time[e] + seconds, np.zeros(batch.existence.shape[1], np.int64)
        slots = slots_of(e, batch)
        worth = rule.worth * np.exp(rule.load * np.log1p(float((slots.existence > 0.0).sum())))
        while batch.time[e] + duration[action] < end:
            value[e] += simulate_dwell(e, batch, action, keys, updates, end, worth, menu, thresholds, laws)
            scores_of_row(e, batch, menu, thresholds, laws, rule, scores)
            action = greatest(scores, batch.existence[e], menu)
        share, before = (end - batch.time[e]) / duration[action], cost_to_come(batch.time[e], slots, rule, laws)
        last = simulate_dwell(e, batch, action, keys, updates, end, worth, menu, thresholds, laws)
        last += cost_to_come(batch.time[e], slots, rule, laws)
        value[e] += share * last + (1.0 - share) * before
