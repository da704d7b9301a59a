"""A compiled step of the multifunction radar: targets fly, and one dwell happens or is predicted.

Shapes: e environments, g targets; others as in ``dwell_kernels``. ``batch`` is the ``Belief`` of all environments. All
functions change the arrays of truth and belief in place.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.counter_rng_kernels import stream
from wavegym.core.kernels import inlined, kernel
from wavegym.systems.multifunction_radar.area_kernels import (
    axis_of,
    beam_of,
    bin_of,
    drift,
    found_in,
    middle_of,
    next_beam,
    next_turn,
    thin,
    weighted_number,
)
from wavegym.systems.multifunction_radar.beam_kernels import Beam, Look, exceeds, on_axis, power_beyond
from wavegym.systems.multifunction_radar.dwell_kernels import (
    Scene,
    azimuth_of,
    drop_tracks,
    errors,
    expect,
    hit,
    mean_rates,
    mean_share,
    mean_square,
    miss,
    predicted,
    search,
    update,
    usable,
    variance_of,
)
from wavegym.systems.multifunction_radar.flight_kernels import Flight, Flying, fly, flying_of
from wavegym.systems.multifunction_radar.track_kernels import (
    RANGE,
    RATE,
    SINE,
    Slots,
    begin_slot,
    correct_slot,
    first_slots,
    keep_slot,
    predict_slot,
    spread_at,
    stationary_density,
    steady,
)

MODES = 2
WAIT, UPDATE, SEARCH = 0, 1, 2
UNDETECTED, TENTATIVE, CONFIRMED_TRACKS = 0, 1, 2  # parts of the cost of a dwell
DWELLS, ECHOES, BEFORE = 1, 2, 3  # streams of a world's key: dwells, echoes, and dwells before the episode


class Menu(NamedTuple):
    """All actions; arrays (action, ...)."""

    kind: np.ndarray  # WAIT, UPDATE or SEARCH
    which: np.ndarray  # slot or sector
    duration: np.ndarray  # s, overhead included
    train: np.ndarray  # number of the train
    covers: np.ndarray  # (train, i, 3, b, c) share of the targets in and beside beam i that a search with it finds
    bursts: np.ndarray  # this and those that follow as in ``Look``
    gain: np.ndarray
    threshold: np.ndarray
    cells: np.ndarray
    rate_error: np.ndarray
    stretch: np.ndarray
    kept: np.ndarray  # (action, m)


@inlined
def look_of(a, menu):
    """The look of an action."""
    return Look(
        menu.bursts[a], menu.gain[a], menu.threshold[a], menu.cells[a], menu.rate_error[a], menu.stretch[a],
        menu.kept[a]
    )  # fmt: skip


@inlined
def slots_of(e, batch):
    """The tracks of environment e, as views."""
    return Slots(
        batch.updated[e],
        batch.mean[e],
        batch.covariance[e],
        batch.probability[e],
        batch.existence[e],
        batch.section[e],
        batch.moments[e],
    )


@kernel
def first_tracks(x, here, known, error, modes, variance, batch, origin):
    """``first_slots`` of every environment."""
    for e in range(len(x)):
        first_slots(batch.time[e], x[e], here[e], known[e], error[e], modes, variance, slots_of(e, batch), origin[e])


@inlined
def chosen(action, existence, menu):
    """The action that happens: an update of a free slot is a wait, the last action. existence (k,)."""
    is_free = menu.kind[action] == UPDATE and existence[menu.which[action]] == 0.0
    return len(menu.kind) - 1 if is_free else action


@kernel
def pass_time(e, batch, duration, laws, scratch):
    """Let a dwell's time pass before its echo is used: adds its cost and moves the undetected targets.

    Every undetected target costs c0 a second.
    """
    modes, area, most = laws.modes, laws.area, laws.most
    slots, undetected, start = slots_of(e, batch), batch.undetected[e], batch.time[e]
    tentative, confirmed = mean_rates(start, duration, slots, modes, most, area)
    before = weighted_number(undetected, area)
    drift(undetected, duration, area, scratch)
    unseen = 0.5 * most * (before + weighted_number(undetected, area))
    batch.spent[e, UNDETECTED] = duration * unseen
    batch.spent[e, TENTATIVE] = duration * tentative
    batch.spent[e, CONFIRMED_TRACKS] = duration * confirmed
    batch.duration[e] = duration
    batch.time[e] = start + duration
    batch.step[e] += 1


@kernel
def cost_to_come(batch, seconds, worths, laws, out):
    """Fill out (e,) with the cost of the tracks in the coming ``seconds`` if the beam rested, and of the undetected.

    worths (i, b, c): of an undetected target, in seconds of c0.
    """
    modes, area, most = laws.modes, laws.area, laws.most
    for e in range(len(batch.time)):
        tentative, confirmed = mean_rates(batch.time[e], seconds, slots_of(e, batch), modes, most, area)
        out[e] = seconds * (tentative + confirmed) + most * (batch.undetected[e] * worths).sum()


class Real(NamedTuple):
    """What happens: the true targets of all environments, their echoes, and the true laws."""

    keys: np.ndarray  # (e,) uint64
    flying: Flying  # (e, g, ...)
    arrival: np.ndarray  # (e, g) s
    section: np.ndarray  # (e, g) class of cross section
    cell: np.ndarray  # (e,) the cell of time
    looks: np.ndarray  # (e, g) how often each target has been in the beam
    origin: np.ndarray  # (e, k) the target whose echo a slot has used last
    flight: Flight
    beam: Beam


@inlined
def fly_to(e, time, real):
    """Fly the targets of environment e; returns the seconds since the last cell began."""
    until = int(np.floor(time / real.flight.cell))
    fly(real.keys[e], real.arrival[e], real.cell[e], until, flying_of(e, real.flying), real.flight)
    real.cell[e] = until
    return time - until * real.flight.cell


@kernel
def dwell(e, action, key, real, batch, menu, laws, scratch):
    """One dwell of environment e as it happens; key: of its false alarms."""
    slots, undetected, area = slots_of(e, batch), batch.undetected[e], laws.area
    pass_time(e, batch, menu.duration[action], laws, scratch)
    time = batch.time[e]
    late, which, look = fly_to(e, time, real), menu.which[action], look_of(action, menu)
    scene = Scene(
        real.beam, flying_of(e, real.flying), real.section[e], late, stream(real.keys[e], ECHOES), real.looks[e],
        real.origin[e]
    )  # fmt: skip
    if menu.kind[action] == UPDATE:
        update(time, slots, which, scene, key, look, laws)
    elif menu.kind[action] == SEARCH:
        i = next_beam(which, batch.turn[e, which], area)
        search(time, slots, i, undetected, scene, key, look, menu.covers[menu.train[action], i], laws)
        batch.turn[e, which] = next_turn(which, batch.turn[e, which], area)
    drop_tracks(time, slots, undetected, laws.modes, laws.most, area)


@kernel
def advance(real, batch, actions, menu, laws):
    """One dwell of every environment as it happens; laws: as the tracker assumes them."""
    scratch = np.empty_like(batch.undetected[0])
    for e in range(len(actions)):
        action = chosen(actions[e], batch.existence[e], menu)
        key = stream(stream(real.keys[e], DWELLS), batch.step[e])
        dwell(e, action, key, real, batch, menu, laws, scratch)


@inlined
def typical_power(prediction, probability, look):
    """The power of a detection: its median, of several classes the harmonic mean of their medians.

    What an update saves is a mean over powers. At the mean of 1 / z, which weak echoes dominate, it would be a sixth
    too low. probability (c,): of the classes before.
    """
    total, weights = 0.0, 0.0
    for c in range(len(probability)):
        weight = probability[c] * prediction.pd[c]
        if weight > 0.0:
            total += weight / power_beyond(0.5, prediction.S[c], look)
            weights += weight
    return weights / total if weights > 0.0 else look.threshold


@inlined
def mean_strength(prediction, probability):
    """S on the axis of a target that has been detected; probability (c,): of the classes before."""
    total, weights = 0.0, 0.0
    for c in range(len(probability)):
        total += probability[c] * prediction.pd[c] * prediction.S[c]
        weights += probability[c] * prediction.pd[c]
    return total / weights if weights > 0.0 else 0.0


@kernel
def foresee_update(k, time, slots, look, draws, laws):
    """Predict an update of slot k: its expectation, or its result for uniform draws (2,) of detection and power.

    The echo comes from the predicted place of the track, where the quiet mode is the most likely. The modes
    nevertheless keep their probabilities; otherwise no future would contain a manoeuvre.
    """
    made, beam, section = predicted(k, time, slots, laws.modes), laws.beam, slots.section[k]
    axis, modes_before, before = made.h[SINE], made.mu.copy(), made.P.copy()
    spread = variance_of(made, SINE) / (beam.width * beam.width)
    pd, ratio = expect(made, section, axis, 0.0, spread, look, beam)
    S, chance = mean_strength(made, section), slots.existence[k] * pd
    if len(draws) == 0:
        seen, variance = S / (1.0 + S), np.empty(3)
        errors(typical_power(made, section, look), mean_square(0.0, spread), seen, look, beam, variance)
        correct_slot(made.x, made.P, made.mu, (axis, seen, made.h, variance, usable(made, beam), beam.fold))
        for m in range(MODES):
            for a in range(4):
                for b in range(4):
                    made.P[m, a, b] = before[m, a, b] + chance * (made.P[m, a, b] - before[m, a, b])
        keep_slot(k, time, slots, laws.modes, made.x, made.P, modes_before)
    elif draws[0] < chance:
        h, z = made.h, power_beyond(1.0 - draws[1], S, look)
        hit(k, time, slots, made, np.array([h[RANGE], axis, h[RATE], z, 0.0]), (axis, 0.0, spread, pd), look, laws)
        keep_slot(k, time, slots, laws.modes, made.x, made.P, modes_before)
    else:
        miss(k, time, slots, laws.modes, made, ratio)


@kernel
def foresee_search(time, slots, i, undetected, look, covers, draws, laws):
    """Predict a search with beam i: its expectation, or its result for uniform draws (2,) of a new track and its range.

    Without draws nothing changes: a found target moves from the undetected ones to a tentative track, which costs the
    same. With draws at most one track begins, of a target or of a false alarm. A draw chooses its bin.
    """
    if len(draws) == 0:
        return
    beam, area = laws.beam, laws.area
    bins, classes, free = undetected.shape[1], undetected.shape[2], -1
    for k in range(len(slots.existence)):
        if slots.existence[k] == 0.0:
            free = k
            break
    axis, deep, low, found = axis_of(i, area), (area.farthest - area.nearest) / bins, 0.0, -1
    variance, false = np.empty(3), look.cells * deep * exceeds(look.threshold, look.bursts)
    for b in range(bins):
        expected = 0.0
        for c in range(classes):
            expected += found_in(undetected, i, b, c, covers)
        if found < 0 and free >= 0 and draws[0] < low + expected + false:
            found, r, S = b, middle_of(b, bins, area), 0.0
            for c in range(classes):
                part = found_in(undetected, i, b, c, covers)
                share = part / expected if expected > 0.0 else 1.0 / classes
                slots.section[free, c] = share
                S += share * beam.sections[c] * mean_share(steady(laws.modes), look) * on_axis(r, axis, look, beam)
            errors(power_beyond(1.0 - draws[1], S, look), 0.0, 0.0, look, beam, variance)
            begin_slot(free, time, slots, laws.modes, r, axis, variance, area.speed)
            slots.existence[free] = expected / (expected + false)
        low += expected + false
    thin(undetected, i, covers)


@kernel
def foresee(batch, actions, draws, menu, laws):
    """Predict one dwell of every environment from its belief; draws (e, 2), or (e, 0) for the expectation."""
    scratch = np.empty_like(batch.undetected[0])
    for e in range(len(actions)):
        slots, undetected = slots_of(e, batch), batch.undetected[e]
        action = chosen(actions[e], batch.existence[e], menu)
        pass_time(e, batch, menu.duration[action], laws, scratch)
        time, which, look = batch.time[e], menu.which[action], look_of(action, menu)
        if menu.kind[action] == UPDATE:
            foresee_update(which, time, slots, look, draws[e], laws)
        elif menu.kind[action] == SEARCH:
            i = next_beam(which, batch.turn[e, which], laws.area)
            foresee_search(time, slots, i, undetected, look, menu.covers[menu.train[action], i], draws[e], laws)
            batch.turn[e, which] = next_turn(which, batch.turn[e, which], laws.area)
        drop_tracks(time, slots, undetected, laws.modes, laws.most, laws.area)


@kernel
def describe_slots(batch, second, value, laws, out):
    """Fill out (e, k, 10) with the columns of ``TrackSlots.slots_now``; the velocity is that of the last update.

    second: a look of a second of transmission. value (i, b, c): of a find.
    """
    modes, beam, area = laws.modes, laws.beam, laws.area
    for e in range(len(batch.time)):
        time = batch.time[e]
        for k in range(batch.existence.shape[1]):
            out[e, k] = 0.0
            if batch.existence[e, k] == 0.0:
                continue
            slots, m, age = slots_of(e, batch), batch.moments[e, k], time - batch.updated[e, k]
            azimuth, r = azimuth_of(k, time, slots)
            xx, xy, yy = spread_at(m, modes, age)
            s, c = np.sin(azimuth), np.cos(azimuth)
            across = c * np.sqrt(max(c * c * xx - 2.0 * s * c * xy + s * s * yy, 0.0)) / r  # of the sine
            q = stationary_density(modes)
            q += (m[9] - q) * np.exp(-(modes.leave[0] + modes.leave[1]) * age)
            row = out[e, k]
            row[0], row[1], row[2], row[3] = batch.existence[e, k], r, azimuth, across / beam.width
            row[4], row[5], row[6], row[7] = np.sqrt(xx + yy), np.sqrt(m[6] + m[8]), age, q
            row[8] = on_axis(r, s, second, beam) * (batch.section[e, k] * beam.sections).sum()
            row[9] = (batch.section[e, k] * value[beam_of(s, area), bin_of(r, value.shape[1], area)]).sum()


@kernel
def estimate_slots(batch, modes, mean, covariance):
    """Fill mean (e, k, n) and covariance (e, k, n, n) of all modes together, now; free slots are left unchanged."""
    x, P, mu = np.empty((2, 4)), np.empty((2, 4, 4)), np.empty((1, 2))
    for e in range(len(batch.time)):
        for k in range(batch.existence.shape[1]):
            if batch.existence[e, k] > 0.0:
                slots = slots_of(e, batch)
                predict_slot(k, batch.time[e], slots, modes, x, P, mu, mean[e, k : k + 1], covariance[e, k : k + 1])
