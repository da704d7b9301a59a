"""Kernels of track management: tracks are confirmed, merged and ended."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.trackers.urban.kernels import CONFIRMED, EMPTY, TENTATIVE, cell_of, place_of


@inlined
def end(t, tracks, mm):
    """Empty a slot."""
    tracks.status[t] = EMPTY
    tracks.existence[t] = 0.0
    tracks.age[t] = 0
    for m in range(len(mm)):
        tracks.mu[t, m] = 1.0 / len(mm)


@inlined
def off_road(t, a, b, tracks, constants, mm):
    """Whether a track is farther from all roads than its own uncertainty explains.

    The mirror image of a target moves into a building when the target turns.
    """
    i, j = cell_of(a, b, constants)
    if i < 0:
        return True
    variance = 0.0
    for m in range(len(mm)):
        row = t * len(mm) + m
        variance += tracks.mu[t, m] * (tracks.P[row, 0, 0] + tracks.P[row, 1, 1])
    return constants.road[i, j] > constants.slack + 2.0 * np.sqrt(variance)


@kernel
def update_status(tracks, constants, mm):
    """Confirm, end and merge tracks: of two at one place the tentative one ends, of equal status the younger one."""
    for t in range(len(tracks.mu)):
        if tracks.status[t] == EMPTY:
            continue
        least = constants.drop_tentative if tracks.status[t] == TENTATIVE else constants.drop_confirmed
        a, b, u, v = place_of(t, tracks.x, tracks.mu, len(mm))
        if (
            not tracks.existence[t] >= least
            or off_road(t, a, b, tracks, constants, mm)
            or not np.hypot(u, v) < 2.0 * constants.fastest
        ):
            end(t, tracks, mm)
        elif tracks.existence[t] >= constants.confirm and tracks.age[t] + 1 >= constants.confirm_after:
            tracks.status[t] = CONFIRMED
        tracks.age[t] += tracks.status[t] != EMPTY
    for t in range(len(tracks.mu)):
        for s in range(t):
            if tracks.status[t] != EMPTY and tracks.status[s] != EMPTY:
                a, b, u, v = place_of(t, tracks.x, tracks.mu, len(mm))
                c, d, p, q = place_of(s, tracks.x, tracks.mu, len(mm))
                apart, faster = np.hypot(a - c, b - d), np.hypot(u - p, v - q)
                if apart < constants.merge_distance and faster < constants.merge_speed:
                    older = tracks.status[s] > tracks.status[t] or (
                        tracks.status[s] == tracks.status[t] and tracks.age[s] >= tracks.age[t]
                    )
                    end(t if older else s, tracks, mm)
