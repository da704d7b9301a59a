"""Compiled dwells of the multifunction radar: how an update or a search changes tracks and undetected targets.

Shapes: e environments, k slots, m modes, n elements, c classes of cross section, q measured quantities, f findings; see
``track_kernels``, ``beam_kernels`` and ``area_kernels``.

Dwells read of the truth: the true beam, the flying targets and their classes (g,), the seconds since the cell of time
began, and the key of echoes. They write origin (k,), the target whose echo a slot has used last (-1: false alarm), and
looks (g,).
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.core.traits import CONFIRMED
from wavegym.sensors.platform_kernels import bearing
from wavegym.systems.multifunction_radar.area_kernels import (
    Area,
    axis_of,
    beam_of,
    bin_of,
    middle_of,
    thin,
    weight_at,
)
from wavegym.systems.multifunction_radar.beam_kernels import (
    REACH,
    SLOPE,
    Beam,
    echoes,
    expected_detection,
    false_alarms,
    false_offset_density,
    log_ratio,
    loss,
    mean_detection,
    mean_loss,
    on_axis,
)
from wavegym.systems.multifunction_radar.flight_kernels import Flying
from wavegym.systems.multifunction_radar.track_kernels import (
    NN,
    PLACE,
    RANGE,
    RATE,
    SINE,
    STATE,
    Modes,
    begin_slot,
    correct_slot,
    keep_slot,
    look_at,
    predict_slot,
    spread_at,
    steady,
    toward_axis,
)
from wavegym.trackers.imm_kernels import squared_length
from wavegym.trackers.kernels import gain_one, shrink_one

MOST_FOUND = 32  # detections of a dwell
WIDEST = 4.0  # trace of the position's covariance, in c0, at which a track is dropped; from 1 on it is not reported
BESIDE = 1.5 * REACH  # offset up to which a search looks for a track, whose target may be nearer to the axis
ANOTHER_FOLD = 1e-4  # probability of another fold up to which a range-rate is used
RARE = 0.01  # probability of a class of cross section below which it is left out
SURE = 1.0 - 1e-6  # greatest probability of detection, so that a miss stays possible
DOUBT = 1e-6  # least probability at a miss that a track has no target; an existence of 1 would outlive all misses
MOST_WIDENED = 9.0  # greatest ratio of the variances after and before a miss: three standard deviations
GRID = 40  # steps of a new track's offset over the beam
GREATEST = 700.0  # logarithm of a likelihood ratio, so that the ratio is finite


class Laws(NamedTuple):
    """What the tracker assumes."""

    modes: Modes
    beam: Beam
    area: Area
    most: float  # c0, m^2


class Scene(NamedTuple):
    """What a dwell reads and writes of the truth."""

    beam: Beam
    flying: Flying
    section: np.ndarray  # (g,) class of cross section
    late: float  # s since the cell began
    key: np.uint64  # of echoes
    looks: np.ndarray  # (g,) how often each target has been in the beam
    origin: np.ndarray  # (k,)


class Findings(NamedTuple):
    """What a dwell has found."""

    number: int
    found: np.ndarray  # (f, 5), see ``beam_kernels``
    used: np.ndarray  # (f,) bool, by a slot


class Prediction(NamedTuple):
    """A slot at the time of a dwell, and what the dwell expects of it."""

    x: np.ndarray  # (m, n)
    P: np.ndarray  # (m, n, n)
    mu: np.ndarray  # (1, m)
    mean: np.ndarray  # (1, n) of all modes
    covariance: np.ndarray  # (1, n, n)
    h: np.ndarray  # (q,) range, sine of the azimuth and range-rate of the mean
    H: np.ndarray  # (q, n)
    S: np.ndarray  # (c,) on the axis
    pd: np.ndarray  # (c,) probability of detection


@kernel
def predicted(k, time, slots, modes):
    """Slot k at ``time``; S and pd are not filled."""
    classes = slots.section.shape[1]
    made = Prediction(
        np.empty((2, 4)), np.empty((2, 4, 4)), np.empty((1, 2)), np.empty((1, 4)), np.empty((1, 4, 4)), np.empty(3),
        np.empty((3, 4)), np.empty(classes), np.empty(classes)
    )  # fmt: skip
    predict_slot(k, time, slots, modes, made.x, made.P, made.mu, made.mean, made.covariance)
    look_at(made.mean, 0, made.h, made.H)
    return made


@inlined
def variance_of(prediction, a):
    """Predicted variance of a measured quantity."""
    return gain_one(0, prediction.covariance, prediction.H, a, np.empty(4), NN, STATE)


@inlined
def usable(prediction, beam):
    """Number of measured quantities that can be used: the range-rate last, if its fold is all but certain.

    A calm track may have begun a hard turn, so the chance of another fold is that over the modes.
    """
    chance, v = 0.0, np.empty(4)
    for j in range(2):
        variance = gain_one(j, prediction.P, prediction.H, RATE, v, NN, STATE)
        chance += prediction.mu[0, j] * math.erfc(beam.fold / np.sqrt(8.0 * variance))
    return 3 if chance <= ANOTHER_FOLD else 2


@inlined
def strengths(r, axis, share, look, beam, S):
    """Fill S (c,) on the axis, of each class at range r; share: the energy kept under acceleration."""
    unit = share * on_axis(r, axis, look, beam)
    for c in range(len(S)):
        S[c] = unit * beam.sections[c]


@inlined
def mean_share(mu, look):
    """Mean share of the energy kept, of a target whose modes have the probabilities mu (m,)."""
    return mu[0] * look.kept[0] + mu[1] * look.kept[1]


@kernel
def share_found(look, laws, out):
    """Fill out (i, 3, b, c) with the share of the targets in and beside beam i that a search finds; see ``thin``."""
    area, beam, share = laws.area, laws.beam, mean_share(steady(laws.modes), look)
    beams, _, bins, classes = out.shape
    for i in range(beams):
        axis = axis_of(i, area)
        for b in range(bins):
            unit = share * on_axis(middle_of(b, bins, area), axis, look, beam)
            for n in range(3):
                if 0 <= i + n - 1 < beams:
                    low, high = (area.edges[i + n - 1] - axis) / beam.width, (area.edges[i + n] - axis) / beam.width
                    for c in range(classes):
                        out[i, n, b, c] = mean_detection(unit * beam.sections[c], low, high, look)


@kernel
def expect(prediction, probability, axis, off, spread, look, beam):
    """Fill S and pd of a prediction; returns the mean probability of detection, and a ratio for a miss.

    The ratio is the mean square distance of the offset from its mean, given a miss, over its variance. probability
    (c,): of the classes.
    """
    S, pd, total, square = prediction.S, prediction.pd, 0.0, 0.0
    strengths(prediction.h[RANGE], axis, mean_share(prediction.mu[0], look), look, beam, S)
    for c in range(len(S)):
        pd[c] = 0.0
        if probability[c] >= RARE:
            pd[c], part = expected_detection(S[c], off, spread, look)
            pd[c] = min(pd[c], SURE)
            total += probability[c] * pd[c]
            square += probability[c] * part
    return total, min(max((1.0 - square) / (1.0 - total), 1.0 / MOST_WIDENED), MOST_WIDENED)


@inlined
def errors(z, square, seen, look, beam, variance):
    """Fill variance (q,) of the measured quantities at the power z.

    square: mean square of the target's offset. seen: S / (1 + S).
    """
    half = 0.5 / z
    variance[RANGE] = beam.range_error * beam.range_error * half
    scale = beam.width / SLOPE
    variance[SINE] = scale * scale * half * (1.0 + SLOPE * SLOPE * square * seen)
    variance[RATE] = look.rate_error * look.rate_error * half


@inlined
def mean_square(off, spread):
    """Of an offset of known mean and variance, within the beam."""
    return min(off * off + spread, REACH * REACH)


@kernel
def weigh_classes(z, S, part, probability, look, after):
    """Bayes's rule of the classes from the power z; part: mean loss of the offset.

    Fills after (c,); returns the log of the density of z over that of a false alarm, and the mean of S / (1 + S).
    """
    best, total, seen = -np.inf, 0.0, 0.0
    for c in range(len(S)):
        after[c] = log_ratio(z, part * S[c], look)
        best = max(best, after[c])
    for c in range(len(S)):
        after[c] = probability[c] * np.exp(after[c] - best)
        total += after[c]
    for c in range(len(S)):
        after[c] /= total
        seen += after[c] * part * S[c] / (1.0 + part * S[c])
    return best + np.log(total), seen


@kernel
def hit(k, time, slots, prediction, finding, pointing, look, laws):
    """Update slot k with a finding (5,): state, class of cross section, and existence against a false alarm.

    pointing: axis, mean and variance of the offset, and probability of detection.
    """
    (axis, off, spread, pd), beam, after = pointing, laws.beam, slots.section[k]
    z, variance = finding[3], np.empty(3)
    log_density, seen = weigh_classes(z, prediction.S, mean_loss(off, spread), after.copy(), look, after)
    errors(z, mean_square(off, spread), seen, look, beam, variance)
    count, false = usable(prediction, beam), false_offset_density((finding[SINE] - axis) / beam.width, z) / beam.width
    false *= look.cells / (beam.fold if count == 3 else 1.0)
    measured = (axis, seen, finding, variance, count, beam.fold)
    log_density += correct_slot(prediction.x, prediction.P, prediction.mu, measured) - np.log(false)
    odds = slots.existence[k] * (1.0 - pd + np.exp(min(log_density, GREATEST)))
    slots.existence[k] = odds / (odds + (1.0 - slots.existence[k]))
    keep_slot(k, time, slots, laws.modes, prediction.x, prediction.P, prediction.mu)


@kernel
def miss(k, time, slots, modes, prediction, ratio):
    """A dwell on slot k without a finding: existence falls, and the azimuth spreads, as the beam may have missed it.

    The classes that would have been seen become less probable. prediction, ratio: of ``expect``.
    """
    x, P, mu = prediction.x, prediction.P, prediction.mu
    none, section = max(1.0 - slots.existence[k], DOUBT), slots.section[k]
    section *= 1.0 - prediction.pd
    unseen = section.sum()
    section /= unseen  # by their own sum: rounding errors would grow a million times with each miss of a sure detection
    slots.existence[k] = 1.0 - none / (none + slots.existence[k] * unseen)
    h, H, v = np.empty(3), np.empty((3, 4)), np.empty(4)
    for j in range(2):
        look_at(x, j, h, H)
        s = gain_one(j, P, H, SINE, v, NN, PLACE)
        shrink_one(j, P, v, s / (1.0 - ratio) if ratio != 1.0 else np.inf, NN)
    keep_slot(k, time, slots, modes, x, P, mu)


@kernel
def distance_to(prediction, finding, axis, seen, variance):
    """Squared Mahalanobis distance of a finding's range and sine from a prediction."""
    h, H, P, v = prediction.h.copy(), prediction.H.copy(), prediction.covariance, np.empty(4)
    toward_axis(h, H, axis, seen)
    s11 = gain_one(0, P, H, SINE, v, NN, PLACE) + variance[SINE]
    s01 = H[RANGE, 0] * v[0] + H[RANGE, 2] * v[2]
    s00 = gain_one(0, P, H, RANGE, v, NN, PLACE) + variance[RANGE]
    return squared_length(finding[RANGE] - h[RANGE], finding[SINE] - h[SINE], s00, s01, s11)[0]


@kernel
def look_for(k, time, slots, axis, look, laws, findings):
    """Use the nearest finding in slot k's gate that no other slot has used, if the beam covers it; -1 for none."""
    beam, section = laws.beam, slots.section[k]
    prediction, variance, after = predicted(k, time, slots, laws.modes), np.empty(3), np.empty(len(section))
    off = (prediction.h[SINE] - axis) / beam.width
    spread = variance_of(prediction, SINE) / (beam.width * beam.width)
    pd, ratio = expect(prediction, section, axis, off, spread, look, beam)
    best, least = -1, beam.gate
    for f in range(findings.number):
        if findings.used[f]:
            continue
        finding = findings.found[f]
        _, seen = weigh_classes(finding[3], prediction.S, mean_loss(off, spread), section, look, after)
        errors(finding[3], mean_square(off, spread), seen, look, beam, variance)
        squared = distance_to(prediction, finding, axis, seen, variance)
        if squared < least:
            best, least = f, squared
    if best < 0:
        miss(k, time, slots, laws.modes, prediction, ratio)
        return best
    findings.used[best] = True
    hit(k, time, slots, prediction, findings.found[best], (axis, off, spread, pd), look, laws)
    return best


@inlined
def flown(k, time, slots):
    """Place at which slot k is predicted; modes fly straight on."""
    px, py, seconds = 0.0, 0.0, time - slots.time[k]
    for j in range(2):
        px += slots.probability[k, j] * (slots.mean[k, j, 0] + seconds * slots.mean[k, j, 1])
        py += slots.probability[k, j] * (slots.mean[k, j, 2] + seconds * slots.mean[k, j, 3])
    return px, py


@inlined
def azimuth_of(k, time, slots):
    """Azimuth at which slot k is predicted, and its range."""
    px, py = flown(k, time, slots)
    return bearing(px, py), np.sqrt(px * px + py * py)


@inlined
def sine_of(k, time, slots):
    """Sine of the azimuth at which slot k is predicted."""
    px, py = flown(k, time, slots)
    return px / np.sqrt(px * px + py * py)


@kernel
def begin_track(k, time, slots, finding, i, undetected, look, laws):
    """Begin a track in slot k by Bayes's rule, from the undetected targets in and beside beam i.

    A grid over the offset and the classes, against a false alarm.
    """
    beam, area, z, axis = laws.beam, laws.area, finding[3], axis_of(i, laws.area)
    classes, b = undetected.shape[2], bin_of(finding[RANGE], undetected.shape[1], area)
    deep = (area.farthest - area.nearest) / undetected.shape[1]
    measured, step = (finding[SINE] - axis) / beam.width, 2.0 * REACH / GRID
    S, log_weight = np.empty(classes), np.full((GRID + 1, classes), -np.inf)
    strengths(finding[RANGE], axis, mean_share(steady(laws.modes), look), look, beam, S)
    for n in range(GRID + 1):
        off = n * step - REACH
        near = beam_of(axis + off * beam.width, area)
        share = step * beam.width / (area.edges[near + 1] - area.edges[near]) / deep
        for c in range(classes):
            here = S[c] * loss(off)
            seen = here / (1.0 + here)
            variance = (1.0 + SLOPE * SLOPE * off * off * seen) * 0.5 / (z * SLOPE * SLOPE)
            apart = measured - off * seen
            if undetected[near, b, c] > 0.0:
                log_weight[n, c] = np.log(undetected[near, b, c] * share) + log_ratio(z, here, look)
                log_weight[n, c] -= 0.5 * (apart * apart / variance + np.log(2.0 * np.pi * variance))
    false = np.log(look.cells * false_offset_density(measured, z))
    settle_track(k, time, slots, finding, axis, log_weight, false, look, laws)


@kernel
def settle_track(k, time, slots, finding, axis, log_weight, false, look, laws):
    """Begin slot k with the moments of the posterior over offsets and classes, log_weight (n, c).

    false: the logarithm of the weight of a false alarm.
    """
    beam, z = laws.beam, finding[3]
    best = max(log_weight.max(), false)
    weight, offs = np.exp(log_weight - best), np.linspace(-REACH, REACH, GRID + 1)
    total = weight.sum()
    if total == 0.0:
        return
    slots.existence[k] = total / (total + np.exp(false - best))
    for c in range(weight.shape[1]):
        slots.section[k, c] = weight[:, c].sum() / total
    share = weight.sum(axis=1) / total
    mean = (share * offs).sum()
    spread = (share * np.square(offs - mean)).sum() + np.square(2.0 * REACH / GRID) / 12.0
    variance = np.empty(3)
    errors(z, 0.0, 0.0, look, beam, variance)
    variance[SINE] = spread * beam.width * beam.width
    begin_slot(k, time, slots, laws.modes, finding[RANGE], axis + mean * beam.width, variance, laws.area.speed)


@kernel
def begin_tracks(time, slots, findings, i, undetected, origin, look, laws):
    """Begin a track in a free slot for every finding of beam i that no slot has used, while there are free slots."""
    k = 0
    for f in range(findings.number):
        while k < len(slots.existence) and slots.existence[k] > 0.0:
            k += 1
        if findings.used[f] or k == len(slots.existence):
            continue
        begin_track(k, time, slots, findings.found[f], i, undetected, look, laws)
        origin[k] = int(findings.found[f, 4])


@kernel
def drop_tracks(time, slots, undetected, modes, most, area):
    """Free the slots with a low existence, a spread that is too large, or a place outside the region.

    The existence of a track that is dropped inside the region is added to the undetected targets.
    """
    for k in range(len(slots.existence)):
        if slots.existence[k] == 0.0:
            continue
        azimuth, r = azimuth_of(k, time, slots)
        inside = area.nearest <= r <= area.farthest and abs(azimuth) <= area.half_sector
        xx, _, yy = spread_at(slots.moments[k], modes, time - slots.time[k])
        if slots.existence[k] < area.dropped or xx + yy > WIDEST * most or not inside:
            if inside:
                i, b = beam_of(np.sin(azimuth), area), bin_of(r, undetected.shape[1], area)
                for c in range(undetected.shape[2]):
                    undetected[i, b, c] += slots.existence[k] * slots.section[k, c]
            slots.existence[k] = 0.0


@inlined
def is_reported(e, trace, most):
    """Whether a track of existence e costs less reported: e trace + (1 - e) c0 against e c0."""
    return e * trace + (1.0 - e) * most < e * most


@inlined
def rate_of_slot(k, time, slots, modes, most, area):
    """The cost per second of the track in slot k at ``time``, with the weight of its range.

    A reported track costs e tr P + (1 - e) c0, an unreported one e c0. The lower cost counts: it is the expected
    squared GOSPA distance with the best choice of reports.
    """
    xx, _, yy = spread_at(slots.moments[k], modes, time - slots.time[k])
    weight = 1.0 if area.priority == 1.0 else weight_at(azimuth_of(k, time, slots)[1], area)
    e, trace = slots.existence[k], xx + yy
    return weight * (e * trace + (1.0 - e) * most if is_reported(e, trace, most) else e * most)


@kernel
def rates_of_cost(time, slots, modes, most, area):
    """The cost per second of all tentative and of all confirmed tracks at ``time``."""
    tentative, confirmed = 0.0, 0.0
    for k in range(len(slots.existence)):
        if slots.existence[k] >= CONFIRMED:
            confirmed += rate_of_slot(k, time, slots, modes, most, area)
        elif slots.existence[k] > 0.0:
            tentative += rate_of_slot(k, time, slots, modes, most, area)
    return tentative, confirmed


@kernel
def mean_rates(start, seconds, slots, modes, most, area):
    """Means of ``rates_of_cost`` over ``seconds`` without a dwell, by Simpson's rule."""
    first = rates_of_cost(start, slots, modes, most, area)
    middle = rates_of_cost(start + 0.5 * seconds, slots, modes, most, area)
    last = rates_of_cost(start + seconds, slots, modes, most, area)
    tentative = (first[0] + 4.0 * middle[0] + last[0]) / 6.0
    return tentative, (first[1] + 4.0 * middle[1] + last[1]) / 6.0


@kernel
def sense(key, scene, axis, look):
    """A dwell's findings."""
    found = np.empty((MOST_FOUND, 5))
    count = echoes(scene.key, scene.looks, (scene.beam, scene.flying, scene.section), scene.late, axis, look, found)
    count = false_alarms(key, axis, look, scene.beam, found, count)
    return Findings(count, found, np.zeros(MOST_FOUND, np.bool_))


@kernel
def search(time, slots, i, undetected, scene, key, look, covers, laws):
    """Search with beam i: tracks in the beam are updated or missed, other findings begin tracks.

    key: of false alarms. covers (3, b, c): see ``thin``.
    """
    axis, beam = axis_of(i, laws.area), laws.beam
    findings = sense(key, scene, axis, look)
    for k in range(len(slots.existence)):
        if slots.existence[k] > 0.0 and abs(sine_of(k, time, slots) - axis) <= BESIDE * beam.width:
            used = look_for(k, time, slots, axis, look, laws, findings)
            if used >= 0:
                scene.origin[k] = int(findings.found[used, 4])
    begin_tracks(time, slots, findings, i, undetected, scene.origin, look, laws)
    thin(undetected, i, covers)


@kernel
def update(time, slots, k, scene, key, look, laws):
    """Point the beam at track k and look for it."""
    axis = sine_of(k, time, slots)
    findings = sense(key, scene, axis, look)
    used = look_for(k, time, slots, axis, look, laws, findings)
    if used >= 0:
        scene.origin[k] = int(findings.found[used, 4])
