"""The joint probabilistic data association update, for any number of environments at once.

References: Bar-Shalom & Fortmann, *Tracking and Data Association* (1988), chapter 9.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from wavegym import sensors
from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_positive
from wavegym.trackers import jpda_kernels
from wavegym.trackers.checks import check_association_terms
from wavegym.trackers.joint_association_kernels import CLUSTER_LIMIT
from wavegym.trackers.kalman import check_positive_definite


def jpda_update(
    mean: ArrayLike,
    covariance: ArrayLike,
    measurements: ArrayLike,
    predicted: ArrayLike,
    S: ArrayLike,
    cross_covariance: ArrayLike,
    pd: ArrayLike,
    clutter_density: ArrayLike,
    gate: float = 4.0,
    gate_probability: float | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Update all targets with one scan of two-dimensional measurements of unknown origin.

    The filter decides what the predicted measurement is made of: an EKF has h(x), H P H' + R and P H', an unscented
    filter the transform's moments.

    Args:
        mean: predicted x, (..., target, n).
        covariance: predicted P, (..., target, n, n).
        measurements: z, (..., measurement, 2).
        predicted: predicted measurements, (..., target, 2).
        S: innovation covariances, (..., target, 2, 2).
        cross_covariance: cov(x, z), (..., target, n, 2).
        pd: detection probabilities, (..., target), each in (0, 1).
        clutter_density: false returns per unit of measurement space, (...), > 0.
        gate: a target is associated only with measurements within this many standard deviations of its prediction.
        gate_probability: that its own return is; 1 - exp(-gate^2 / 2) if None.

    Returns:
        Updated mean (..., target, n) and covariance (..., target, n, n).

    Raises:
        InputError: shapes that disagree, pd or gate_probability out of range, a clutter density or gate not > 0, an S
            that is not positive definite, or more targets than the exact association takes in one cluster.
    """
    check_positive("gate", gate)
    share = float(sensors.gate_probability(gate)) if gate_probability is None else gate_probability
    detection, density, share = check_association_terms(pd, clutter_density, share)
    x, P, *rest = _aligned(mean, covariance, measurements, predicted, S, cross_covariance, detection, density)
    lead, targets, n = x.shape[:-2], *x.shape[-2:]
    count = math.prod(lead)
    flat = [array.reshape(count, *array.shape[len(lead) :]) for array in (x, P, *rest)]
    jpda_kernels.jpda_update(*flat, gate, share, (0,) * n)
    if np.isnan(P).any():
        check_positive_definite("S", S)
        many = f"more than CLUSTER_LIMIT = {CLUSTER_LIMIT} of {targets} targets share measurements in one cluster"
        raise InputError(f"{many}, expected fewer (use a smaller gate)")
    return x, P


def _aligned(*given: ArrayLike) -> list[FloatArray]:
    """The arguments of ``jpda_update`` as fresh arrays whose leading axes are broadcast."""
    arrays = [np.asarray(a, np.float64) for a in given]
    T, n = arrays[0].shape[-2:] if arrays[0].ndim > 1 else (0, 0)
    M = arrays[2].shape[-2] if arrays[2].ndim > 1 else 0
    cores = ((T, n), (T, n, n), (M, 2), (T, 2), (T, 2, 2), (T, n, 2), (T,), ())
    shapes = [a.shape for a in arrays]
    leads = [s[: len(s) - len(core)] for s, core in zip(shapes, cores, strict=True)]
    try:
        lead = leads[0] if len(set(leads)) == 1 else np.broadcast_shapes(*leads)  # which takes as long as all the rest
    except ValueError:
        lead = None
    if lead is None or any(s != own + core for s, own, core in zip(shapes, leads, cores, strict=True)):
        wanted = (
            "(..., t, n), (..., t, n, n), (..., m, 2), (..., t, 2), (..., t, 2, 2), (..., t, n, 2), (..., t), (...)"
        )
        raise InputError(f"argument shapes are {', '.join(map(str, shapes))}, expected {wanted}")
    return [_copy(a, lead + core) for a, core in zip(arrays, cores, strict=True)]


def _copy(array: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """A fresh array that ``array`` is broadcast to."""
    fresh = np.empty(shape)
    fresh[...] = array
    return fresh
