"""Compiled dwells of the multifunction radar: how an update or a search changes tracks and undetected targets.

Shapes: e environments, k slots, s sectors, b range bins, f findings; see ``track_kernels`` and ``beam_kernels``.
``undetected`` (s, b): the expected number of targets without a track. It is a Poisson intensity: targets move between
neighbouring cells at the rates of an isotropic flow, and a search reduces their number. Outside the region the
intensity is that of the whole traffic, so the right number of targets comes in over the edges.

Dwells read of the truth: the true beam; x (g, n), here (g,); and the seconds since the cell of time began. They write
origin (k,), the target whose echo a slot has used last (-1: false alarm).
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.array_kernels import copy_matrix
from wavegym.core.kernels import inlined, kernel
from wavegym.core.traits import CONFIRMED
from wavegym.sensors.platform_kernels import bearing, wrapped
from wavegym.systems.multifunction_radar.beam_kernels import (
    REACH,
    echoes,
    errors,
    expected_detection,
    false_alarms,
    false_density,
)
from wavegym.systems.multifunction_radar.track_kernels import (
    NN,
    PLACE,
    begin_slot,
    distance_to,
    keep_slot,
    look_at,
    predict_slot,
    spread_at,
    update_slot,
)
from wavegym.trackers.imm_kernels import LOG_2PI
from wavegym.trackers.kernels import gain_one, shrink_one

MOST_FOUND = 32  # detections of a dwell
WIDEST = 4.0  # trace of the position's covariance, in c0, at which a track is dropped; from 1 on it is not reported


class Area(NamedTuple):
    """The region as sectors and range bins, and how undetected targets move in it."""

    half_sector: float  # rad
    nearest: float  # m
    farthest: float  # m
    beams: int  # of a sector
    traffic: float  # targets for each square metre without any search
    radial: float  # flow to the next bin on either side, 1/s
    lateral: float  # flow to the next sector on either side times the range, m/s
    dropped: float  # existence below which a track is dropped
    speed: float  # standard deviation of the velocity of a new track on each axis, m/s
    priority: float  # weight of the cost of a target at the nearest range; at the farthest it is 1


@inlined
def cell_of(r, azimuth, shape, area):
    """Sector and bin of a place; the nearest ones for a place outside."""
    s = int((azimuth + area.half_sector) / (2.0 * area.half_sector) * shape[0])
    b = int((r - area.nearest) / (area.farthest - area.nearest) * shape[1])
    return min(max(s, 0), shape[0] - 1), min(max(b, 0), shape[1] - 1)


@inlined
def middle_of(b, bins, area):
    """Range in the middle of a bin, m."""
    return area.nearest + (b + 0.5) * (area.farthest - area.nearest) / bins


@inlined
def usual_number(b, shape, area):
    """Targets in a cell of bin b without any search."""
    sectors, bins = shape
    deep = (area.farthest - area.nearest) / bins
    return area.traffic * deep * middle_of(b, bins, area) * 2.0 * area.half_sector / sectors


@inlined
def weight_at(r, area):
    """Weight of the cost of a target at range r: linear in the range."""
    share = (area.farthest - r) / (area.farthest - area.nearest)
    return 1.0 + (area.priority - 1.0) * np.minimum(np.maximum(share, 0.0), 1.0)


@kernel
def weighted_number(undetected, area):
    """Undetected targets (s, b), each with its weight."""
    if area.priority == 1.0:
        return undetected.sum()
    total, bins = 0.0, undetected.shape[1]
    for b in range(bins):
        total += weight_at(middle_of(b, bins, area), area) * undetected[:, b].sum()
    return total


@kernel
def drift(undetected, seconds, area, before):
    """Advance the intensity (s, b) by ``seconds``, much less than the inverse of the rates; before: scratch space."""
    sectors, bins = undetected.shape
    copy_matrix(undetected, before)
    for b in range(bins):
        lateral, usual = area.lateral / middle_of(b, bins, area), usual_number(b, undetected.shape, area)
        for s in range(sectors):
            inner = before[s, b - 1] if b > 0 else usual_number(-1, undetected.shape, area)
            outer = before[s, b + 1] if b < bins - 1 else usual_number(bins, undetected.shape, area)
            left = before[s - 1, b] if s > 0 else usual
            right = before[s + 1, b] if s < sectors - 1 else usual
            flow = area.radial * (inner + outer) + lateral * (left + right)
            flow -= 2.0 * (area.radial + lateral) * before[s, b]
            undetected[s, b] = before[s, b] + seconds * flow


@kernel
def hit(k, time, slots, modes, prediction, finding, gated, threshold, beam):
    """Update slot k with a finding (3,): state, and existence by the likelihood against that of a false alarm.

    gated: squared distance of the finding, log det of its innovation, probability of detection, variances (2,).
    """
    (x, P, mu), (squared, log_det, pd, variance) = prediction, gated
    likelihood = np.exp(-0.5 * (squared + log_det) - LOG_2PI) / false_density(threshold, beam)
    odds = slots.existence[k] * (1.0 - pd + pd * likelihood)
    slots.existence[k] = odds / (odds + 1.0 - slots.existence[k])
    update_slot(k, time, slots, modes, x, P, mu, finding[0], finding[1], variance)


@kernel
def miss(k, time, slots, modes, prediction, pd, ratio):
    """A dwell on slot k without a finding: existence falls, and the azimuth spreads, as the beam may have missed it."""
    x, P, mu = prediction
    slots.existence[k] *= (1.0 - pd) / (1.0 - slots.existence[k] * pd)
    h, H, v = np.empty(2), np.empty((2, 4)), np.empty(4)
    for j in range(2):
        look_at(x, j, h, H)
        s = gain_one(j, P, H, 1, v, NN, PLACE)
        shrink_one(j, P, v, s / (1.0 - ratio) if ratio != 1.0 else np.inf, NN)
    keep_slot(k, time, slots, modes, x, P, mu)


@kernel
def look_for(k, time, slots, pointing, seconds, threshold, modes, beam, findings):
    """Use the nearest finding in slot k's gate that no other slot has used, if the beam covers it; -1 for none.

    pointing: the beam's axis. findings: their number, the findings (f, 4), and which are used (f,).
    """
    x, P, mu = np.empty((2, 4)), np.empty((2, 4, 4)), np.empty((1, 2))
    mean, covariance = np.empty((1, 4)), np.empty((1, 4, 4))
    h, H, v, variance = np.empty(2), np.empty((2, 4)), np.empty(4), np.empty(2)
    count, found, used = findings
    predict_slot(k, time, slots, modes, x, P, mu, mean, covariance)
    look_at(mean, 0, h, H)
    across = gain_one(0, covariance, H, 1, v, NN, PLACE)
    pd, ratio = expected_detection(h[0], wrapped(h[1] - pointing), across, seconds, threshold, beam)
    best, least, log_det = -1, beam.gate, 0.0
    for f in range(count):
        if not used[f]:
            errors(found[f, 2], beam, variance)
            squared, log_determinant = distance_to(mean, covariance, found[f, 0], found[f, 1], variance, h, H)
            if squared < least:
                best, least, log_det = f, squared, log_determinant
    if best < 0:
        miss(k, time, slots, modes, (x, P, mu), pd, ratio)
        return best
    used[best] = True
    errors(found[best, 2], beam, variance)
    hit(k, time, slots, modes, (x, P, mu), found[best], (least, log_det, pd, variance), threshold, beam)
    return best


@kernel
def azimuth_of(k, time, slots):
    """Azimuth at which slot k is predicted, and its range; modes fly straight on."""
    px, py, seconds = 0.0, 0.0, time - slots.time[k]
    for j in range(2):
        px += slots.probability[k, j] * (slots.mean[k, j, 0] + seconds * slots.mean[k, j, 1])
        py += slots.probability[k, j] * (slots.mean[k, j, 2] + seconds * slots.mean[k, j, 3])
    return bearing(px, py), np.sqrt(px * px + py * py)


@kernel
def begin_tracks(time, slots, findings, undetected, origin, covers, laws):
    """Begin a track in a free slot for every finding that no slot has used, while there are free slots.

    Its existence weighs the undetected targets expected there against false alarms. covers: see ``search``.
    """
    (count, found, used), variance, k = findings, np.empty(2), 0
    threshold, modes, beam, area = laws
    width = (area.farthest - area.nearest) / undetected.shape[1]
    for f in range(count):
        while k < len(slots.existence) and slots.existence[k] > 0.0:
            k += 1
        if used[f] or k == len(slots.existence):
            continue
        s, b = cell_of(found[f, 0], found[f, 1], undetected.shape, area)
        expected = undetected[s, b] / area.beams * covers[b] / (width * beam.width)
        errors(found[f, 2], beam, variance)
        begin_slot(k, time, slots, modes, found[f, 0], found[f, 1], variance, area.speed)
        slots.existence[k] = expected / (expected + false_density(threshold, beam))
        origin[k] = found[f, 3]


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
                s, b = cell_of(r, azimuth, undetected.shape, area)
                undetected[s, b] += slots.existence[k]
            slots.existence[k] = 0.0


@inlined
def reported_cost(e, trace, most):
    """Cost per second of a track of existence e, reported or not: the lower of the two."""
    return min(e * trace + (1.0 - e) * most, e * most)


@inlined
def rate_of_slot(k, time, slots, modes, most, area):
    """The cost per second of the track in slot k at ``time``, with the weight of its range.

    A reported track costs e tr P + (1 - e) c0, an unreported one e c0. The lower cost counts: it is the expected
    squared GOSPA distance with the best choice of reports.
    """
    xx, _, yy = spread_at(slots.moments[k], modes, time - slots.time[k])
    weight = 1.0 if area.priority == 1.0 else weight_at(azimuth_of(k, time, slots)[1], area)
    return weight * reported_cost(slots.existence[k], xx + yy, most)


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
def sense(key, truth, axis, seconds, threshold):
    """A dwell's findings: their number, the echoes and false alarms (f, 4), and flags (f,): used by a slot."""
    found, (beam, x, here, late, _) = np.empty((MOST_FOUND, 4)), truth
    count = echoes(key, x, here, late, axis, seconds, threshold, beam, found)
    count = false_alarms(key, axis, beam.nearest, beam.farthest, threshold, beam, found, count)
    return count, found, np.zeros(MOST_FOUND, np.bool_)


@inlined
def axis_of(sector, turn, sectors, area):
    """Azimuth of a sector's beam number ``turn``."""
    return -area.half_sector + (sector + (turn + 0.5) / area.beams) * 2.0 * area.half_sector / sectors


@inlined
def thin(undetected, covers, area):
    """Subtract what a search with their sector's next beam finds from the undetected targets (b,)."""
    for b in range(len(undetected)):
        undetected[b] *= max(1.0 - covers[b] / area.beams, 0.0)


@kernel
def search(time, slots, sector, turn, undetected, truth, key, seconds, covers, laws):
    """Search one beam of a sector: tracks in the beam are updated or missed, other findings begin tracks.

    covers (b,): ``coverage`` of the beam in each bin.
    """
    threshold, modes, beam, area = laws
    axis, origin = axis_of(sector, turn, len(undetected), area), truth[4]
    findings = sense(key, truth, axis, seconds, threshold)
    for k in range(len(slots.existence)):
        if slots.existence[k] > 0.0 and abs(wrapped(azimuth_of(k, time, slots)[0] - axis)) <= REACH * beam.width:
            used = look_for(k, time, slots, axis, seconds, threshold, modes, beam, findings)
            if used >= 0:
                origin[k] = findings[1][used, 3]
    begin_tracks(time, slots, findings, undetected, origin, covers, laws)
    thin(undetected[sector], covers, area)


@kernel
def update(time, slots, k, truth, key, seconds, laws):
    """Point the beam at track k and look for it."""
    threshold, modes, beam, _ = laws
    axis, origin = azimuth_of(k, time, slots)[0], truth[4]
    findings = sense(key, truth, axis, seconds, threshold)
    used = look_for(k, time, slots, axis, seconds, threshold, modes, beam, findings)
    if used >= 0:
        origin[k] = findings[1][used, 3]
