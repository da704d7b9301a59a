"""The GOSPA metric: position errors, missed targets and false tracks of a multitarget tracker in one distance.

Reference: Rahmathullah, Garcia-Fernandez and Svensson, *Generalized optimal sub-pattern assignment metric* (2017), with
alpha = 2.
"""

from __future__ import annotations

import math
import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_positive, check_within
from wavegym.trackers import gospa_kernels as kernels
from wavegym.trackers.pictures import flat_pictures

MOST_TARGETS = 12  # the assignment goes through all 2^targets subsets


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
