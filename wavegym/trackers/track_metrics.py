"""Metrics of several targets and tracks at one time: GOSPA, OSPA and SIAP.

References: Rahmathullah, Garcia-Fernandez and Svensson, *Generalized optimal sub-pattern assignment metric* (2017),
with alpha = 2. Schuhmacher, Vo and Vo, *A consistent metric for performance evaluation of multi-object filters* (2008).
Votruba, Nisley, Rothrock and Zombro, *Single Integrated Air Picture (SIAP) Metrics Implementation* (2001).
"""

from __future__ import annotations

import math
import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from wavegym.core.arrays import FloatArray, check_finite, check_last_axes, flatten_lead
from wavegym.core.errors import InputError, check_positive, check_within
from wavegym.trackers import gospa_kernels as kernels

Mask = NDArray[np.bool_]
MOST_TARGETS = 12  # the assignment goes through all 2^targets subsets


class Pictures(NamedTuple):
    """Positions and what counts of them, with one flat leading axis."""

    targets: FloatArray  # (batch, T, d)
    present: Mask  # (batch, T)
    tracks: FloatArray  # (batch, N, d)
    alive: Mask  # (batch, N)


def flat_pictures(
    targets: ArrayLike, tracks: ArrayLike, present: ArrayLike, alive: ArrayLike
) -> tuple[Pictures, tuple[int, ...]]:
    """Check the arguments of a metric and flatten their leading axes.

    Args:
        targets: true positions in m, (..., T, d).
        tracks: estimated positions in m, (..., N, d).
        present: whether each target exists, (..., T).
        alive: whether each track counts, (..., N).

    Returns:
        The pictures, and the leading axes, which broadcast.

    Raises:
        InputError: shapes that do not fit, or a position that counts and is not finite.
    """
    truth, found = check_last_axes("targets", targets), check_last_axes("tracks", tracks)
    if min(truth.ndim, found.ndim) < 2 or truth.shape[-1] != found.shape[-1]:
        raise InputError(
            f"targets and tracks have shapes {truth.shape} and {found.shape}, expected (..., T, d) and (..., N, d)"
        )
    (T, d), N = truth.shape[-2:], found.shape[-2]
    there, counts = np.asarray(present, np.bool_), np.asarray(alive, np.bool_)
    try:
        lead = np.broadcast_shapes(truth.shape[:-2], found.shape[:-2], there.shape[:-1], counts.shape[:-1])
        flat = Pictures(
            flatten_lead(truth, lead, T, d),
            flatten_lead(there, lead, T),
            flatten_lead(found, lead, N, d),
            flatten_lead(counts, lead, N),
        )
    except ValueError:
        raise InputError(
            f"present and alive have shapes {there.shape} and {counts.shape} beside targets {truth.shape} and tracks "
            f"{found.shape}, expected (..., {T}) and (..., {N}) that broadcast"
        ) from None
    for name, positions, counted in (("targets", *flat[:2]), ("tracks", *flat[2:])):
        check_finite(f"{name} that count", np.where(counted[..., None], positions, 0.0))
    return flat, lead


class Gospa(NamedTuple):
    """The result of ``gospa``, each field (...): distance^p = localisation + missed + false."""

    distance: FloatArray  # m
    localisation: FloatArray  # sum of d^p over targets that have a track, m^p
    missed: FloatArray  # c^p / 2 for each target without a track, m^p
    false: FloatArray  # c^p / 2 for each track without a target, m^p


def gospa(
    targets: ArrayLike,
    tracks: ArrayLike,
    present: ArrayLike = True,
    alive: ArrayLike = True,
    cutoff: float = 20.0,
    order: float = 2.0,
) -> Gospa:
    """The GOSPA distance (alpha = 2): the least sum over all assignments of tracks to targets.

    Args:
        targets: true positions in m, (..., T, d); at most 12 targets.
        tracks: estimated positions in m, (..., N, d).
        present: whether each target exists, (..., T).
        alive: whether each track counts, (..., N).
        cutoff: c in m, > 0; a target and a track at least c apart are never assigned to each other.
        order: p in [1, 100].

    Returns:
        See ``Gospa``; leading axes broadcast.

    Raises:
        InputError: an invalid shape or value, or more than 12 targets.
    """
    c, p = check_positive("cutoff", cutoff, "m"), check_within("order", order, 1.0, 100.0)
    if p * math.log(c) > math.log(sys.float_info.max):
        most = math.log(sys.float_info.max) / math.log(c)
        raise InputError(
            f"order is {order!r}, expected at most {most:.4g} with a cutoff of {cutoff!r} m: c^p overflows"
        )
    flat, lead = flat_pictures(targets, tracks, present, alive)
    if flat.targets.shape[1] > MOST_TARGETS:
        raise InputError(f"targets holds {flat.targets.shape[1]} targets, expected at most {MOST_TARGETS}")
    out = np.empty((len(flat.targets), 4))
    kernels.gospa(*flat, c, p, out)
    return Gospa(*(out[:, k].reshape(lead) for k in range(4)))


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
