"""Joint probabilistic data association (JPDA): the update by a scan, and the expected information of a scan.

The update: Bar-Shalom & Fortmann, *Tracking and Data Association* (1988), chapter 9.

The information reduction factor q2 is the share of a measurement's information left by missed detections and clutter.
The expected covariance of a probabilistic data association (PDA) filter after a scan is P - q2 K S K' (T. E. Fortmann,
Y. Bar-Shalom, M. Scheffe and S. Gelfand, "Detection thresholds for tracking in clutter", IEEE Trans. Automatic Control
30, 1985). Here q2 = tr E[nu nu'] / 2, where nu is the combined innovation of a two-dimensional measurement in whitened
coordinates. By the law of total covariance this expectation is exact. The usual PDA equations keep P after a missed
detection, also where the return fell outside the gate g. Their q2 is larger by Pd (g^2 / 2) exp(-g^2 / 2): 0.0027 Pd at
g = 4.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from wavegym import sensors
from wavegym.core.arrays import FloatArray, check_broadcast, check_elements, check_finite
from wavegym.core.covariances import check_covariance, check_positive_definite
from wavegym.core.errors import InputError, check_non_negative, check_positive, check_within
from wavegym.trackers import jpda_kernels
from wavegym.trackers.association import check_association_terms
from wavegym.trackers.association_kernels import CLUSTER_LIMIT
from wavegym.trackers.jpda_kernels import GATE, LIMIT, reduction

TABLE = Path(__file__).with_name("information_reduction_table.csv")
FAINTEST = np.log(LIMIT / 2 / (1 - (1 + GATE**2) * np.exp(-(GATE**2))))  # log f at Pd = 0


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


def information_reduction(pd: ArrayLike, clutter: ArrayLike) -> FloatArray:
    """q2 by interpolation in the shipped table: within 0.1 % for Pd >= 0.001, within 1 % below.

    Args:
        pd: probability of detection in [0, 1], any shape.
        clutter: mean number rho V >= 0 of clutter points in the gate g = 4, V = 16 pi sqrt(det S); broadcasts with
            ``pd``. Give 16 pi rho sqrt(det S) for any other gate, too, because q2 depends on the clutter density. The
            error for another gate is below 0.31 % for g >= 4, 1.3 % for g = 3.5 and 5.9 % for g = 3.

    Returns:
        q2 in the broadcast shape, from 0.997 Pd without clutter to 2 Pd^2 / (rho V) in heavy clutter.

    Raises:
        InputError: a pd outside [0, 1], or a clutter that is negative or not finite.
    """
    shape, p, n = _check_arguments(pd, clutter)
    return np.asarray(reduction(p.ravel(), n.ravel(), *reduction_table())).reshape(shape)


def fitted_information_reduction(pd: ArrayLike, clutter: ArrayLike) -> FloatArray:
    """The published fit 0.997 Pd / (1 + 0.37 Pd^-1.57 rho V) to q2, for comparison; arguments as for the table.

    The fit is within 9 % for Pd in [0.5, 1] and rho V <= 1. For rho V >= 50 it is too high at large Pd: by 27 % at 0.9
    and 35 % at 1. It is too low at small Pd: by 9 % at 0.5 and 64 % at 0.1.
    """
    shape, p, n = _check_arguments(pd, clutter)
    power = p**1.57
    scale = power + 0.37 * n
    return np.asarray(np.divide(0.997 * p * power, scale, out=np.zeros(shape), where=scale > 0.0))


@lru_cache(maxsize=1)
def reduction_table() -> tuple[FloatArray, FloatArray, FloatArray]:
    """The shipped values of q2 as log f, the form that ``reduction_one`` reads; the first row is the limit at Pd = 0.

    Returns:
        pd (p,), log clutter (n,), log f (p, n). All callers share these arrays: do not write to them. They stay
        writeable so that kernels are compiled for one array type only.
    """
    rows = np.loadtxt(TABLE, delimiter=",", skiprows=1)
    clutter = np.array(TABLE.read_text("utf-8").split("\n", 1)[0].split(",")[1:], np.float64)
    pd, q2 = rows[:, :1], rows[:, 1:]
    f = pd * (LIMIT * pd / q2 - 1.0) / clutter
    table = np.vstack([np.full(len(clutter), FAINTEST), np.log(f)])
    return np.append(0.0, rows[:, 0]), np.log(clutter), table


def _check_arguments(pd: ArrayLike, clutter: ArrayLike) -> tuple[tuple[int, ...], FloatArray, FloatArray]:
    """Return the broadcast shape and fresh C-contiguous arrays of that shape; otherwise raise an InputError."""
    p = check_elements(lambda name, value: check_within(name, value, 0.0, 1.0), "pd", pd)
    n = check_elements(check_non_negative, "clutter", clutter)
    p, n = (np.array(values, order="C") for values in check_broadcast(pd=p, clutter=n))
    return p.shape, p, n
