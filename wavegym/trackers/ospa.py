"""The OSPA metric, and the SIAP metrics of a single integrated air picture.

References: Schuhmacher, Vo and Vo, *A consistent metric for performance evaluation of multi-object filters* (2008).
Votruba, Nisley, Rothrock and Zombro, *Single Integrated Air Picture (SIAP) Metrics Implementation* (2001).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import check_positive, check_within
from wavegym.trackers.pictures import Mask, flat_pictures


class Siap(NamedTuple):
    """The result of ``siap``, each field (...); NaN where nothing counts."""

    completeness: FloatArray  # share of the targets that have a track; best: 1
    ambiguity: FloatArray  # tracks for each target that has one; best: 1
    spuriousness: FloatArray  # share of the tracks without a target; best: 0
    position_accuracy: FloatArray  # mean distance of a track from its target, m


def ospa(
    targets: ArrayLike,
    tracks: ArrayLike,
    present: ArrayLike = True,
    alive: ArrayLike = True,
    cutoff: float = 20.0,
    order: float = 2.0,
) -> FloatArray:
    """The OSPA distance: the mean error of a target or track, where a missing partner costs the cutoff.

    Unlike GOSPA it is divided by the larger of the two numbers, so it does not grow with the number of false tracks.

    Args:
        targets: true positions in m, (..., T, d).
        tracks: estimated positions in m, (..., N, d).
        present: whether each target exists, (..., T).
        alive: whether each track counts, (..., N).
        cutoff: c in m, > 0.
        order: p in [1, 100].

    Returns:
        Distances in m, (...); leading axes broadcast. 0 without targets and tracks.

    Raises:
        InputError: shapes that do not fit, a cutoff or order out of range, or a position that counts and is not finite.
    """
    c, p = check_positive("cutoff", cutoff, "m"), check_within("order", order, 1.0, 100.0)
    pictures, lead = flat_pictures(targets, tracks, present, alive)
    return np.array([_ospa(*each, c, p) for each in zip(*pictures, strict=True)]).reshape(lead)


def _ospa(targets: FloatArray, present: Mask, tracks: FloatArray, alive: Mask, c: float, p: float) -> float:
    truth, found = targets[present], tracks[alive]
    few, many = sorted((len(truth), len(found)))
    if not many:
        return 0.0
    # Relative to c: c^p may overflow.
    cost = (np.minimum(np.linalg.norm(truth[:, None] - found[None], axis=-1), c) / c) ** p
    rows, columns = linear_sum_assignment(cost)
    return float(c * ((cost[rows, columns].sum() + many - few) / many) ** (1.0 / p))


def siap(
    targets: ArrayLike, tracks: ArrayLike, present: ArrayLike = True, alive: ArrayLike = True, cutoff: float = 20.0
) -> Siap:
    """The SIAP metrics of one time; a track belongs to the nearest target, if that is closer than the cutoff.

    Args:
        targets: true positions in m, (..., T, d).
        tracks: estimated positions in m, (..., N, d).
        present: whether each target exists, (..., T).
        alive: whether each track counts, (..., N).
        cutoff: in m, > 0.

    Returns:
        See ``Siap``; leading axes broadcast.

    Raises:
        InputError: shapes that do not fit, a cutoff that is not > 0, or a position that counts and is not finite.
    """
    check_positive("cutoff", cutoff, "m")
    pictures, lead = flat_pictures(targets, tracks, present, alive)
    figures = [_siap(*each, cutoff) for each in zip(*pictures, strict=True)]
    return Siap(*(np.array(column).reshape(lead) for column in zip(*figures, strict=True)))


def _siap(
    targets: FloatArray, present: Mask, tracks: FloatArray, alive: Mask, cutoff: float
) -> tuple[float, float, float, float]:
    truth, found = targets[present], tracks[alive]
    away = np.linalg.norm(truth[:, None] - found[None], axis=-1)  # (target, track)
    nearest = away.argmin(axis=0) if len(truth) else np.zeros(len(found), np.int64)
    distance = away[nearest, np.arange(len(found))] if len(truth) else np.full(len(found), np.inf)
    belongs = distance < cutoff
    tracked, owned = len(set(nearest[belongs].tolist())), int(belongs.sum())
    return (
        tracked / len(truth) if len(truth) else np.nan,
        owned / tracked if tracked else np.nan,
        1.0 - owned / len(found) if len(found) else np.nan,
        float(distance[belongs].mean()) if owned else np.nan,
    )
