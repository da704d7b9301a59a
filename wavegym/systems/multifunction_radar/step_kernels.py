"""A compiled step of the multifunction radar: targets fly, and one dwell happens or is predicted.

Shapes: e environments, g targets; others as in ``dwell_kernels``. ``batch`` is the ``Belief`` of all environments. All
functions change the arrays of truth and belief in place.

A true target is [x xdot y ydot] (m, m/s); the radar is at the origin. Azimuths are clockwise from +y. Time advances in
cells of a fixed length. Within a cell a target flies straight on. The density of its white acceleration depends on its
mode, and a Markov chain switches between the two modes.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.counter_rng_kernels import normal, stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.platform_kernels import bearing
from wavegym.systems.multifunction_radar.beam_kernels import (
    energy,
    errors,
    expected_detection,
    false_density,
    mean_inverse_power,
)
from wavegym.systems.multifunction_radar.dwell_kernels import (
    axis_of,
    azimuth_of,
    drift,
    drop_tracks,
    hit,
    mean_rates,
    middle_of,
    miss,
    search,
    update,
    weighted_number,
)
from wavegym.systems.multifunction_radar.track_kernels import (
    NN,
    PLACE,
    Slots,
    begin_slot,
    first_slots,
    keep_slot,
    look_at,
    predict_slot,
    spread_at,
    stationary_density,
    update_slot,
)
from wavegym.trackers.kernels import gain_one

MODES = 2
MOTION = 0  # number of the stream of manoeuvres within a world's key
DRAWS = 5  # draws of a target in a cell: the mode's change, and two of noise for each axis
WAIT, UPDATE, SEARCH = 0, 1, 2
UNDETECTED, TENTATIVE, CONFIRMED_TRACKS = 0, 1, 2  # parts of the cost of a dwell
DWELLS = 1  # number of the stream of dwells within a world's key


class Flight(NamedTuple):
    """How targets fly, and the region in which the radar has to find them."""

    cell: float  # s
    density: tuple[float, float]  # white acceleration of each mode, m^2/s^3
    leave: tuple[float, float]  # rate at which a target leaves each mode, 1/s
    nearest: float  # m
    farthest: float  # m
    half_sector: float  # rad


@inlined
def range_of(x, y):
    """Distance from the radar, m."""
    return np.sqrt(x * x + y * y)


@inlined
def in_region(x, y, flight):
    """Whether the place (x, y) lies in the region."""
    r = range_of(x, y)
    return flight.nearest <= r <= flight.farthest and abs(bearing(x, y)) <= flight.half_sector


@inlined
def fly_one(key, cell, g, x, mode, flight):
    """One cell of target g: changes x[g] (n,) and mode[g]; the draws depend on the key, the cell and the target."""
    own, h = stream(stream(stream(key, MOTION), cell), g), flight.cell
    if uniform(own, 0) < -np.expm1(-flight.leave[mode[g]] * h):
        mode[g] = 1 - mode[g]
    q = flight.density[mode[g]]
    a, b = np.sqrt(q * h * h * h / 3.0), np.sqrt(q * h / 4.0)  # Cholesky factor of the noise of one axis
    for axis in range(2):
        n0, n1 = normal(own, 1 + 2 * axis), normal(own, 2 + 2 * axis)
        x[g, 2 * axis] += h * x[g, 2 * axis + 1] + a * n0
        x[g, 2 * axis + 1] += np.sqrt(3.0) * b * n0 + b * n1


@kernel
def fly(key, arrival, cell, until, x, mode, here, flight):
    """Fly all targets of one environment from the beginning of a cell to the beginning of the cell ``until``.

    A target is here from the first cell that begins after its arrival until it leaves the region.
    """
    for k in range(cell, until):
        for g in range(len(here)):
            if not here[g] and k * flight.cell <= arrival[g] < (k + 1) * flight.cell:
                here[g] = True
            elif here[g]:
                fly_one(key, k, g, x, mode, flight)
                here[g] = in_region(x[g, 0], x[g, 2], flight)


@kernel
def fly_all(keys, arrival, cell, until, x, mode, here, flight):
    """``fly`` of every environment, from the same cell; arrays (e, ...)."""
    for e in range(len(x)):
        fly(keys[e], arrival[e], cell, until, x[e], mode[e], here[e], flight)


class Dwell(NamedTuple):
    """One action."""

    kind: int  # WAIT, UPDATE or SEARCH
    which: int  # slot or sector
    seconds: float  # time of transmission
    duration: float  # s, overhead included


@inlined
def slots_of(e, batch):
    """The tracks of environment e, as views."""
    return Slots(
        batch.updated[e],
        batch.mean[e],
        batch.covariance[e],
        batch.probability[e],
        batch.existence[e],
        batch.moments[e],
    )


@kernel
def first_tracks(x, here, known, error, modes, variance, batch, origin):
    """``first_slots`` of every environment."""
    for e in range(len(x)):
        first_slots(x[e], here[e], known[e], error[e], modes, variance, slots_of(e, batch), origin[e])


@inlined
def chosen(action, existence, menu):
    """The dwell of an action, from the menu's arrays (action,). An update of a free slot is a wait, the last action.

    existence (k,). The menu's fifth array, covers (action, b), is for searches only.
    """
    kind, which, seconds, duration, _ = menu
    if kind[action] == UPDATE and existence[which[action]] == 0.0:
        action = len(kind) - 1
    return Dwell(kind[action], which[action], seconds[action], duration[action])


@kernel
def pass_time(e, batch, dwell, modes, area, most, scratch):
    """Let a dwell's time pass before its echo is used: adds its cost and moves the undetected targets.

    Every undetected target costs c0 a second.
    """
    slots, undetected, start = slots_of(e, batch), batch.undetected[e], batch.time[e]
    tentative, confirmed = mean_rates(start, dwell.duration, slots, modes, most, area)
    before = weighted_number(undetected, area)
    drift(undetected, dwell.duration, area, scratch)
    unseen = 0.5 * most * (before + weighted_number(undetected, area))
    batch.spent[e, UNDETECTED] = dwell.duration * unseen
    batch.spent[e, TENTATIVE] = dwell.duration * tentative
    batch.spent[e, CONFIRMED_TRACKS] = dwell.duration * confirmed
    batch.duration[e] = dwell.duration
    batch.time[e] = start + dwell.duration
    batch.step[e] += 1


@kernel
def rest(batch, seconds, laws, out):
    """Fill out (e,) with the cost of the coming ``seconds`` if the beam rested and no undetected target moved."""
    modes, _, area, most = laws
    for e in range(len(batch.time)):
        tentative, confirmed = mean_rates(batch.time[e], seconds, slots_of(e, batch), modes, most, area)
        out[e] = seconds * (tentative + confirmed + most * weighted_number(batch.undetected[e], area))


@kernel
def advance(keys, arrival, truth, flight, true_beam, batch, actions, menu, thresholds, laws):
    """One dwell of every environment as it happens.

    truth: x (e, g, n), mode (e, g), here (e, g), cell (e,) and origin (e, k). thresholds: of update and of search.
    laws: modes, beam, area and c0, as the tracker assumes them.
    """
    x, mode, here, cell, origin = truth
    modes, beam, area, most = laws
    scratch = np.empty_like(batch.undetected[0])
    for e in range(len(actions)):
        dwell, slots = chosen(actions[e], batch.existence[e], menu), slots_of(e, batch)
        undetected = batch.undetected[e]
        key = stream(stream(keys[e], DWELLS), batch.step[e])
        pass_time(e, batch, dwell, modes, area, most, scratch)
        time = batch.time[e]
        until = int(time / flight.cell)
        fly(keys[e], arrival[e], cell[e], until, x[e], mode[e], here[e], flight)
        cell[e] = until
        scene = (true_beam, x[e], here[e], time - until * flight.cell, origin[e])
        if dwell.kind == UPDATE:
            law = (thresholds[0], modes, beam, area)
            update(time, slots, dwell.which, scene, key, dwell.seconds, law)
        elif dwell.kind == SEARCH:
            law = (thresholds[1], modes, beam, area)
            turn = batch.turn[e, dwell.which]
            covers = menu[4][actions[e]]
            search(time, slots, dwell.which, turn, undetected, scene, key, dwell.seconds, covers, law)
            batch.turn[e, dwell.which] = (turn + 1) % area.beams
        drop_tracks(time, slots, undetected, modes, most, area)


@kernel
def foresee_update(k, time, slots, seconds, draws, laws):
    """Predict an update of slot k: its expectation, or its result for uniform draws (2,) of detection and power.

    The echo comes from the predicted place of the track, where the quiet mode is the most likely. The modes
    nevertheless keep their probabilities; otherwise no future would contain a manoeuvre.
    """
    threshold, modes, beam, _ = laws
    x, P, mu = np.empty((2, 4)), np.empty((2, 4, 4)), np.empty((1, 2))
    mean, covariance = np.empty((1, 4)), np.empty((1, 4, 4))
    h, H, v, variance = np.empty(2), np.empty((2, 4)), np.empty(4), np.empty(2)
    predict_slot(k, time, slots, modes, x, P, mu, mean, covariance)
    look_at(mean, 0, h, H)
    across = gain_one(0, covariance, H, 1, v, NN, PLACE)
    pd, ratio = expected_detection(h[0], 0.0, across, seconds, threshold, beam)
    S = energy(h[0], 0.0, seconds, beam)
    chance = slots.existence[k] * pd
    if len(draws) == 0:
        before, modes_before = P.copy(), mu.copy()
        errors(1.0 / mean_inverse_power(S, threshold), beam, variance)
        update_slot(k, time, slots, modes, x, P, mu, h[0], h[1], variance)
        for m in range(len(P)):
            for a in range(P.shape[1]):
                for b in range(P.shape[2]):
                    P[m, a, b] = before[m, a, b] + chance * (P[m, a, b] - before[m, a, b])
        keep_slot(k, time, slots, modes, x, P, modes_before)
    elif draws[0] < chance:
        z = threshold - (1.0 + S) * np.log1p(-draws[1])
        errors(z, beam, variance)
        finding = np.array([h[0], h[1], z, 0.0])
        determinant = (gain_one(0, covariance, H, 0, v, NN, PLACE) + variance[0]) * (across + variance[1])
        modes_before = mu.copy()
        hit(k, time, slots, modes, (x, P, mu), finding, (0.0, np.log(determinant), pd, variance), threshold, beam)
        keep_slot(k, time, slots, modes, x, P, modes_before)
    else:
        miss(k, time, slots, modes, (x, P, mu), pd, ratio)


@kernel
def foresee_search(time, slots, sector, turn, undetected, seconds, covers, draws, laws):
    """Predict a search of a sector: its expectation, or its result for uniform draws (2,) of a new track and its range.

    Without draws nothing changes: a found target moves from the undetected ones to a tentative track, which costs the
    same. With draws at most one track begins, of a target or of a false alarm. A draw chooses its bin.
    """
    if len(draws) == 0:
        return
    threshold, modes, beam, area = laws
    bins, free = undetected.shape[1], -1
    for k in range(len(slots.existence)):
        if slots.existence[k] == 0.0:
            free = k
            break
    deep, low, found, variance = (area.farthest - area.nearest) / bins, 0.0, -1, np.empty(2)
    false = false_density(threshold, beam) * deep * beam.width
    for b in range(bins):
        r = middle_of(b, bins, area)
        S = energy(r, 0.0, seconds, beam)
        expected = min(undetected[sector, b] / area.beams * covers[b], undetected[sector, b])
        undetected[sector, b] -= expected
        if found < 0 and free >= 0 and draws[0] < low + expected + false:
            found = b
            errors(threshold - (1.0 + S) * np.log1p(-draws[1]), beam, variance)
            begin_slot(free, time, slots, modes, r, axis_of(sector, turn, len(undetected), area), variance, area.speed)
            slots.existence[free] = expected / (expected + false)
        low += expected + false


@kernel
def foresee(batch, actions, draws, menu, thresholds, laws):
    """Predict one dwell of every environment from its belief; draws (e, 2), or (e, 0) for the expectation."""
    modes, beam, area, most = laws
    scratch = np.empty_like(batch.undetected[0])
    for e in range(len(actions)):
        dwell, slots = chosen(actions[e], batch.existence[e], menu), slots_of(e, batch)
        undetected = batch.undetected[e]
        pass_time(e, batch, dwell, modes, area, most, scratch)
        time = batch.time[e]
        if dwell.kind == UPDATE:
            foresee_update(dwell.which, time, slots, dwell.seconds, draws[e], (thresholds[0], modes, beam, area))
        elif dwell.kind == SEARCH:
            turn = batch.turn[e, dwell.which]
            law = (thresholds[1], modes, beam, area)
            covers = menu[4][actions[e]]
            foresee_search(time, slots, dwell.which, turn, undetected, dwell.seconds, covers, draws[e], law)
            batch.turn[e, dwell.which] = (turn + 1) % area.beams
        drop_tracks(time, slots, undetected, modes, most, area)


@kernel
def describe_slots(batch, modes, beam, out):
    """Fill out (e, k, 9) with the columns of ``TrackSlots.slots_now``; the velocity is that of the last update."""
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
            across = np.sqrt(max(c * c * xx - 2.0 * s * c * xy + s * s * yy, 0.0)) / r
            q = stationary_density(modes)
            q += (m[9] - q) * np.exp(-(modes.leave[0] + modes.leave[1]) * age)
            row = out[e, k]
            row[0], row[1], row[2], row[3] = batch.existence[e, k], r, azimuth, across / beam.width
            row[4], row[5], row[6], row[7] = np.sqrt(xx + yy), np.sqrt(m[6] + m[8]), age, q
            row[8] = energy(r, 0.0, 1.0, beam)


@kernel
def estimate_slots(batch, modes, mean, covariance):
    """Fill mean (e, k, n) and covariance (e, k, n, n) of all modes together, now; free slots are left unchanged."""
    x, P, mu = np.empty((2, 4)), np.empty((2, 4, 4)), np.empty((1, 2))
    for e in range(len(batch.time)):
        for k in range(batch.existence.shape[1]):
            if batch.existence[e, k] > 0.0:
                slots = slots_of(e, batch)
                predict_slot(k, batch.time[e], slots, modes, x, P, mu, mean[e, k : k + 1], covariance[e, k : k + 1])
