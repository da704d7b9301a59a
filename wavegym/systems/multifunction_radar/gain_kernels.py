"""Compiled gains of dwells of the multifunction radar, and simulated futures of a rule that scores dwells.

Shapes as in ``step_kernels``; h values of a find. The worth of a dwell is what it saves until its effect has worn off.
That of an update has when the track is as bad as before, that of a find when the target would have been found anyway,
or has left.
In simulated futures each of the e rows is a separate belief.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.array_kernels import copy_matrices
from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.core.traits import CONFIRMED
from wavegym.systems.multifunction_radar.area_kernels import (
    next_beam,
    next_turn,
    thin,
    weight_at,
    weighted_number,
    worth_of_search,
)
from wavegym.systems.multifunction_radar.beam_kernels import power_beyond
from wavegym.systems.multifunction_radar.dwell_kernels import (
    drop_tracks,
    errors,
    expect,
    is_reported,
    mean_rates,
    mean_square,
    predicted,
    usable,
    variance_of,
)
from wavegym.systems.multifunction_radar.step_kernels import (
    BEFORE,
    SEARCH,
    UPDATE,
    chosen,
    dwell,
    fly_to,
    foresee_update,
    look_of,
    mean_strength,
    pass_time,
    slots_of,
)
from wavegym.systems.multifunction_radar.track_kernels import NN, RANGE, SINE, STATE
from wavegym.trackers.kernels import gain_one, shrink_one

TINY = 1e-12  # least gain, so that its logarithm is finite
USUAL_DURATION, USUAL_AGE = 0.01, 0.1  # s: of dwells, and since updates, whose powers are 1 in the score
YOUNGEST = 0.01  # s: least time since an update in the score
POWERS = (0.5 + 0.5 / np.sqrt(3.0), 0.5 - 0.5 / np.sqrt(3.0))  # Gaussian nodes of the share of stronger echoes
NEWTON_STEPS = 4  # to the time at which an update has worn off
AFTER = 0.5  # s after a simulated future in which tracks still count


@inlined
def saved(level, P, q):
    """Integral of ``level`` minus the trace of the position's covariance, until that has grown to the level; m^2 s.

    The track has the covariance P (1, n, n), and its acceleration is white, of density q. The trace is then a cubic of
    the time: Newton's method descends to its root from that of its quadratic part.
    """
    p, c, v = P[0, 0, 0] + P[0, 2, 2], P[0, 0, 1] + P[0, 2, 3], P[0, 1, 1] + P[0, 3, 3]
    room, w = level - p, 2.0 / 3.0 * q
    if room <= 0.0:
        return 0.0
    s = (np.sqrt(c * c + v * room) - c) / v
    for _ in range(NEWTON_STEPS):
        s -= (s * (2.0 * c + s * (v + s * w)) - room) / (2.0 * c + s * (2.0 * v + 3.0 * s * w))
    return s * (room - s * (c + s * (v / 3.0 + 0.25 * s * w)))


@kernel
def gains_of_slot(k, time, slots, menu, actions, laws, out):
    """Fill out (action, h) with what the updates ``actions`` = (first, last) of slot k save until they have worn off.

    A detection saves until the track is as bad as it is now. Without a report a target costs c0. All updates are
    predicted at the mean of their ends, as a track changes little in the time of a dwell.
    """
    modes, beam, most, e, section = laws.modes, laws.beam, laws.most, slots.existence[k], slots.section[k]
    after, v, variance = np.empty((1, 4, 4)), np.empty(4), np.empty(3)
    made = predicted(k, time + menu.duration[actions[0] : actions[1]].mean(), slots, modes)
    axis, q = made.h[SINE], made.mu[0, 0] * modes.density[0] + made.mu[0, 1] * modes.density[1]
    spread, count, H = variance_of(made, SINE) / (beam.width * beam.width), usable(made, beam), made.H.copy()
    trace = made.covariance[0, 0, 0] + made.covariance[0, 2, 2]
    level = trace if is_reported(e, trace, most) else most
    for a in range(actions[0], actions[1]):
        look = look_of(a, menu)
        pd, _ = expect(made, section, axis, 0.0, spread, look, beam)
        S = mean_strength(made, section)
        seen = S / (1.0 + S)
        H[SINE], mean = seen * made.H[SINE], 0.0
        for share in POWERS:
            errors(power_beyond(share, S, look), mean_square(0.0, spread), seen, look, beam, variance)
            copy_matrices(made.covariance, after)
            for j in range(count):
                s = gain_one(0, after, H, j, v, NN, STATE) + variance[j]
                shrink_one(0, after, v, s, NN)
            mean += saved(level, after, q) / len(POWERS)
        out[a] = weight_at(made.h[RANGE], laws.area) * e * pd * mean


@kernel
def gains_of_row(e, batch, menu, laws, worths, out):
    """Fill out (action, h) with the worth of every dwell of environment e over its duration; see ``gains``."""
    kind, which = menu.kind, menu.which
    slots, a, each = slots_of(e, batch), 0, 0
    while kind[each] == UPDATE and which[each] == 0:
        each += 1
    out[:] = 0.0
    while kind[a] == UPDATE:
        if slots.existence[which[a]] > 0.0:
            gains_of_slot(which[a], batch.time[e], slots, menu, (a, a + each), laws, out)
        a += each
    while kind[a] == SEARCH:
        i = next_beam(which[a], batch.turn[e, which[a]], laws.area)
        covers = menu.covers[menu.train[a], i]
        for h in range(len(worths)):
            out[a, h] = laws.most * worth_of_search(batch.undetected[e], i, covers, worths[h])
        a += 1
    for a in range(len(kind)):
        out[a] /= menu.duration[a]


@kernel
def scores_of_row(e, batch, menu, laws, rule, worths, out):
    """Fill out (action,) with the score of every dwell of environment e; see ``DwellRule``."""
    gain, slots, farthest = np.empty((len(menu.kind), 1)), slots_of(e, batch), laws.area.farthest
    gains_of_row(e, batch, menu, laws, worths, gain)
    for a in range(len(gain)):
        k, power = menu.which[a], rule.long_search
        out[a] = np.log(max(gain[a, 0], TINY))
        if menu.kind[a] == UPDATE and slots.existence[k] > 0.0:
            power = rule.tentative if slots.existence[k] < CONFIRMED else rule.long
            r, age = np.hypot(slots.mean[k, 0, 0], slots.mean[k, 0, 2]), batch.time[e] - batch.updated[e, k]
            out[a] += rule.far * np.log(r / farthest) + rule.age * np.log(max(age, YOUNGEST) / USUAL_AGE)
        out[a] += power * np.log(menu.duration[a] / USUAL_DURATION)


@kernel
def scores(batch, menu, laws, rule, worths, out):
    """``scores_of_row`` of every environment; out (e, action)."""
    for e in range(len(batch.time)):
        scores_of_row(e, batch, menu, laws, rule, worths, out[e])


@kernel
def gains(batch, menu, laws, worths, out):
    """Fill out (e, action, h) with the worth of every dwell over its duration; 0 for updates of free slots and waits.

    worths (h, i, b, c): of a target found in each cell by a search, in seconds of c0.
    """
    for e in range(len(batch.time)):
        gains_of_row(e, batch, menu, laws, worths, out[e])


@inlined
def greatest(scores, existence, menu):
    """The allowed action with the greatest score (action,); the first if several are equal."""
    kind, which = menu.kind, menu.which
    best, most = len(kind) - 1, -np.inf
    for a in range(len(kind)):
        if scores[a] > most and (kind[a] != UPDATE or existence[which[a]] > 0.0):
            best, most = a, scores[a]
    return best


@kernel
def settle(real, batch, menu, laws, rule, worths):
    """Let the rule choose the dwells until the time is 0; then no dwell has been counted.

    The last dwell that would end later is a rest.
    """
    scratch, score = np.empty_like(batch.undetected[0]), np.empty(len(menu.kind))
    for e in range(len(batch.time)):
        while batch.time[e] < 0.0:
            scores_of_row(e, batch, menu, laws, rule, worths, score)
            action = greatest(score, batch.existence[e], menu)
            if batch.time[e] + menu.duration[action] > 0.0:
                pass_time(e, batch, -batch.time[e], laws, scratch)
                batch.time[e] = 0.0
                fly_to(e, 0.0, real)
                break
            key = stream(stream(real.keys[e], BEFORE), batch.step[e])
            dwell(e, action, key, real, batch, menu, laws, scratch)
        batch.step[e], batch.duration[e], batch.spent[e] = 0, 0.0, 0.0


@kernel
def cost_of_rest(time, slots, laws):
    """Cost of the tracks after a simulated future, without any dwell."""
    tentative, confirmed = mean_rates(time, AFTER, slots, laws.modes, laws.most, laws.area)
    return AFTER * (tentative + confirmed)


@kernel
def simulate_dwell(e, batch, action, keys, updates, end, worths, menu, laws):
    """Simulate one dwell; returns its cost minus what it earns. updates (k,): earlier updates of each slot."""
    most, slots, undetected = laws.most, slots_of(e, batch), batch.undetected[e]
    action = chosen(action, batch.existence[e], menu)
    which = menu.which[action]
    pass_time(e, batch, menu.duration[action], laws, np.empty_like(undetected))
    time, value = batch.time[e], batch.spent[e].sum()
    if menu.kind[action] == UPDATE:
        own = stream(stream(keys[e], which), updates[which])
        updates[which] += 1
        draws = np.array([uniform(own, 0), uniform(own, 1)])
        foresee_update(which, time, slots, look_of(action, menu), draws, laws)
    elif menu.kind[action] == SEARCH:
        i = next_beam(which, batch.turn[e, which], laws.area)
        covers, before = menu.covers[menu.train[action], i], weighted_number(undetected, laws.area)
        value -= most * worth_of_search(undetected, i, covers, worths)
        thin(undetected, i, covers)
        value += most * max(end - time, 0.0) * (before - weighted_number(undetected, laws.area))
        batch.turn[e, which] = next_turn(which, batch.turn[e, which], laws.area)
    drop_tracks(time, slots, undetected, laws.modes, most, laws.area)
    return value


@kernel
def simulate(batch, first, keys, seconds, menu, laws, rule, worths, value):
    """Add the cost of the next ``seconds``, after the actions ``first`` (e,), and the cost to come to value (e,).

    A search in a simulated future finds the expected number of targets, not single ones. This number is subtracted from
    the undetected targets, still costs c0 a second until the future ends, and earns what a find is worth to the rule.
    Single targets found by chance would make two futures differ by more than any update is worth. keys (e,): of the
    draws of updates. The n-th update of a slot has the same draws in all futures of a key, whatever comes before it. Of
    the last dwell only the part before the end of the future counts, in its cost and in its effect. Otherwise futures
    would differ by a whole dwell.
    """
    scores, duration = np.empty(len(menu.kind)), menu.duration
    for e in range(len(first)):
        action, end, updates = first[e], batch.time[e] + seconds, np.zeros(batch.existence.shape[1], np.int64)
        slots = slots_of(e, batch)
        while batch.time[e] + duration[action] < end:
            value[e] += simulate_dwell(e, batch, action, keys, updates, end, worths[0], menu, laws)
            scores_of_row(e, batch, menu, laws, rule, worths, scores)
            action = greatest(scores, batch.existence[e], menu)
        share, before = (end - batch.time[e]) / duration[action], cost_of_rest(batch.time[e], slots, laws)
        last = simulate_dwell(e, batch, action, keys, updates, end, worths[0], menu, laws)
        last += cost_of_rest(batch.time[e], slots, laws)
        value[e] += share * last + (1.0 - share) * before
