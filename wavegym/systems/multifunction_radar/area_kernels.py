"""Compiled intensity of the undetected targets of the multifunction radar: its flow, and what searches take from it.

Shapes: i beams side by side in the sine of the azimuth, b range bins, c classes of cross section. ``undetected``
(i, b, c): the expected number of targets without a track. It is a Poisson intensity: targets move between neighbouring
cells at the rates of an isotropic flow, and a search reduces their number in its beam and in the two beside it. Outside
the region the intensity is that of the whole traffic, so the right number of targets comes in over the edges.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.array_kernels import copy_matrices
from wavegym.core.kernels import inlined, kernel


class Area(NamedTuple):
    """The region as beams and range bins, and how undetected targets move in it."""

    half_sector: float  # rad
    nearest: float  # m
    farthest: float  # m
    first: np.ndarray  # (s + 1,) int: first beam of each sector, and the number of beams
    edges: np.ndarray  # (i + 1,) sines of the azimuths of the beams' edges
    angle: np.ndarray  # (i,) rad: difference between the azimuths of a beam's edges
    traffic: float  # targets for each square metre without any search
    radial: float  # flow to the next bin on either side, 1/s
    lateral: float  # flow to the next beam on either side, times the range and the angle, m/s
    dropped: float  # existence below which a track is dropped
    speed: float  # standard deviation of the velocity of a new track on each axis, m/s
    priority: float  # weight of the cost of a target at the nearest range; at the farthest it is 1


@inlined
def bin_of(r, bins, area):
    """Bin of a range; the nearest one for a range outside."""
    b = int((r - area.nearest) / (area.farthest - area.nearest) * bins)
    return min(max(b, 0), bins - 1)


@inlined
def beam_of(sine, area):
    """Beam in which a direction lies; the nearest one for a direction outside."""
    i = np.searchsorted(area.edges, sine) - 1
    return min(max(i, 0), len(area.angle) - 1)


@inlined
def axis_of(i, area):
    """Sine of the azimuth of a beam's axis."""
    return 0.5 * (area.edges[i] + area.edges[i + 1])


@inlined
def next_beam(sector, turn, area):
    """The beam of a sector's search after ``turn`` others."""
    return area.first[sector] + turn


@inlined
def next_turn(sector, turn, area):
    """The turn after ``turn``: the first again after the sector's last beam."""
    return (turn + 1) % (area.first[sector + 1] - area.first[sector])


@inlined
def middle_of(b, bins, area):
    """Range in the middle of a bin, m."""
    return area.nearest + (b + 0.5) * (area.farthest - area.nearest) / bins


@inlined
def usual_number(i, b, shape, area):
    """Targets of each class in a cell without any search."""
    deep = (area.farthest - area.nearest) / shape[1]
    return area.traffic * deep * middle_of(b, shape[1], area) * area.angle[i] / shape[2]


@inlined
def weight_at(r, area):
    """Weight of the cost of a target at range r: linear in the range."""
    share = (area.farthest - r) / (area.farthest - area.nearest)
    return 1.0 + (area.priority - 1.0) * np.minimum(np.maximum(share, 0.0), 1.0)


@kernel
def weighted_number(undetected, area):
    """Undetected targets (i, b, c), each with its weight."""
    total, (beams, bins, classes) = 0.0, undetected.shape
    for b in range(bins):
        weight = weight_at(middle_of(b, bins, area), area)
        for i in range(beams):
            for c in range(classes):
                total += weight * undetected[i, b, c]
    return total


@kernel
def drift(undetected, seconds, area, before):
    """Advance the intensity (i, b, c) by ``seconds``, in steps in which no cell empties; before: scratch space."""
    fastest = 2.0 * (area.radial + area.lateral / (middle_of(0, undetected.shape[1], area) * area.angle.min()))
    steps = 1 + int(2.0 * seconds * fastest)
    for _ in range(steps):
        drift_step(undetected, seconds / steps, area, before)


@kernel
def drift_step(undetected, seconds, area, before):
    """One step of ``drift``.

    No search knows the class of a target outside the region, so all classes have the usual numbers there.
    """
    beams, bins, classes = undetected.shape
    copy_matrices(undetected, before)
    for i in range(beams):
        for b in range(bins):
            lateral = area.lateral / middle_of(b, bins, area)
            own, usual = lateral / area.angle[i], lateral / area.angle[i] * usual_number(i, b, undetected.shape, area)
            left_rate = lateral / area.angle[i - 1] if i > 0 else 0.0
            right_rate = lateral / area.angle[i + 1] if i < beams - 1 else 0.0
            below = usual_number(i, -1, undetected.shape, area)
            above = usual_number(i, bins, undetected.shape, area)
            for c in range(classes):
                inner = before[i, b - 1, c] if b > 0 else below
                outer = before[i, b + 1, c] if b < bins - 1 else above
                left = left_rate * before[i - 1, b, c] if i > 0 else usual
                right = right_rate * before[i + 1, b, c] if i < beams - 1 else usual
                flow = area.radial * (inner + outer) + left + right
                flow -= 2.0 * (area.radial + own) * before[i, b, c]
                undetected[i, b, c] = before[i, b, c] + seconds * flow


@kernel
def thin(undetected, i, covers):
    """Subtract what a search with beam i finds from the undetected targets (i, b, c).

    covers (3, b, c): the share that it finds in the beam before, in beam i and in the beam after.
    """
    for n in range(3):
        if 0 <= i + n - 1 < len(undetected):
            for b in range(undetected.shape[1]):
                for c in range(undetected.shape[2]):
                    undetected[i + n - 1, b, c] *= 1.0 - covers[n, b, c]


@inlined
def found_in(undetected, i, b, c, covers):
    """Undetected targets of a bin and class that a search with beam i finds; covers as in ``thin``."""
    total = 0.0
    for n in range(3):
        if 0 <= i + n - 1 < len(undetected):
            total += undetected[i + n - 1, b, c] * covers[n, b, c]
    return total


@kernel
def worth_of_search(undetected, i, covers, worths):
    """Sum over the undetected targets that a search with beam i finds of what each is worth, worths (i, b, c)."""
    total = 0.0
    for n in range(3):
        if 0 <= i + n - 1 < len(undetected):
            for b in range(undetected.shape[1]):
                for c in range(undetected.shape[2]):
                    total += undetected[i + n - 1, b, c] * covers[n, b, c] * worths[i + n - 1, b, c]
    return total
