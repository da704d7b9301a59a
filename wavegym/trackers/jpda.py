"""The joint probabilistic data association (JPDA) update for any number of environments at once.

References: Bar-Shalom & Fortmann, *Tracking and Data Association* (1988), chapter 9.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from wavegym import sensors
from wavegym.core.array_checks import check_finite
from wavegym.core.arrays import FloatArray
from wavegym.core.covariance_checks import check_covariance, check_positive_definite
from wavegym.core.errors import InputError, check_positive
from wavegym.trackers import jpda_kernels
from wavegym.trackers.checks import check_association_terms
from wavegym.trackers.joint_association_kernels import CLUSTER_LIMIT


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

    The caller computes the predicted measurements: an EKF gives h(x), H P H' + R and P H', an unscented filter the
    moments of its transform.

    Args:
        mean: predicted x, (..., target, n).
        covariance: predicted P, (..., target, n, n).
        measurements: z, (..., measurement, 2).
        predicted: predicted measurements, (..., target, 2).
        S: innovation covariances, (..., target, 2, 2).
        cross_covariance: cov(x, z), (..., target, n, 2).
        pd: detection probabilities, (..., target), each in (0, 1).
        clutter_density: expected false returns per unit volume of the measurement space, (...), > 0.
        gate: size of the gates in standard deviations; a target is associated only with measurements in its gate.
        gate_probability: probability that a detected target's return lies in its gate; 1 - exp(-gate^2 / 2) if None.

    Returns:
        Updated mean (..., target, n) and covariance (..., target, n, n).

    Raises:
        InputError: an invalid shape or value, or more than ten targets in one cluster.
    """
    check_positive("gate", gate)
    check_covariance("covariance", covariance)
    check_positive_definite("S", S)
    for name, values in (("mean", mean), ("measurements", measurements), ("predicted", predicted),
                         ("cross_covariance", cross_covariance)):  # fmt: skip
        check_finite(name, values)
    share = float(sensors.gate_probability(gate)) if gate_probability is None else gate_probability
    detection, density, share = check_association_terms(pd, clutter_density, share)
    x, P, *rest = _check_shapes(mean, covariance, measurements, predicted, S, cross_covariance, detection, density)
    lead, targets, n = x.shape[:-2], *x.shape[-2:]
    count = math.prod(lead)
    flat = [array.reshape(count, *array.shape[len(lead) :]) for array in (x, P, *rest)]
    jpda_kernels.jpda_update(*flat, gate, share, (0,) * n)
    if np.isnan(P).any() or np.isnan(x).any():
        many = f"more than CLUSTER_LIMIT = {CLUSTER_LIMIT} of {targets} targets share measurements in one cluster"
        raise InputError(f"{many}, expected fewer (use a smaller gate)")
    return x, P


def _check_shapes(*given: ArrayLike) -> list[FloatArray]:
    """Return the array arguments of ``jpda_update`` as copies with broadcast leading axes; otherwise raise."""
    arrays = [np.asarray(a, np.float64) for a in given]
    T, n = arrays[0].shape[-2:] if arrays[0].ndim > 1 else (0, 0)
    M = arrays[2].shape[-2] if arrays[2].ndim > 1 else 0
    cores = ((T, n), (T, n, n), (M, 2), (T, 2), (T, 2, 2), (T, n, 2), (T,), ())
    shapes = [a.shape for a in arrays]
    leads = [s[: len(s) - len(core)] for s, core in zip(shapes, cores, strict=True)]
    try:
        lead = leads[0] if len(set(leads)) == 1 else np.broadcast_shapes(*leads)  # broadcast_shapes is slow
    except ValueError:
        lead = None
    if lead is None or any(s != own + core for s, own, core in zip(shapes, leads, cores, strict=True)):
        wanted = (
            "(..., t, n), (..., t, n, n), (..., m, 2), (..., t, 2), (..., t, 2, 2), (..., t, n, 2), (..., t), (...)"
        )
        raise InputError(f"argument shapes are {', '.join(map(str, shapes))}, expected {wanted}")
    return [_copy(a, lead + core) for a, core in zip(arrays, cores, strict=True)]


def _copy(array: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """A copy of ``array``, broadcast to ``shape``."""
    fresh = np.empty(shape)
    fresh[...] = array
    return fresh
