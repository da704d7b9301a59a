"""A Rao-Blackwellised particle filter over joint associations: the update of one step, for one environment.

What is sampled is which return is whose. Given that, a target is a Gaussian and is updated by an unscented Kalman
filter, so a particle is one history of associations with a mean and a covariance for each target. A posterior of many
modes, which clutter makes of a target just found, then costs a few particles for each mode, where moments would merge
them. Associations are drawn target after target from their exact joint posterior, so that a particle's weight changes
by nothing but the evidence of its scan: the sum over all feasible associations, exactly.

References: Särkkä, Vehtari & Lampinen, *Rao-Blackwellized particle filter for multiple target tracking*, Information
Fusion 8 (2007); Sira, Papandreou-Suppappola, Morrell, Cochran, *Waveform-agile sensing for tracking multiple targets in
clutter*, section 4, whose likelihood (11) is built in the form described in ``association.py``. Kitagawa, *Monte Carlo
filter and smoother*, Journal of Computational and Graphical Statistics 5 (1996), for the systematic resampling.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import FloatArray
from wavegym.core.counter_rng_kernels import stream
from wavegym.core.errors import InputError, check_int
from wavegym.trackers import rbpf_kernels as kernels
from wavegym.trackers.checks import check_association_terms
from wavegym.trackers.joint_association_kernels import CLUSTER_LIMIT
from wavegym.trackers.kalman import check_positive_definite

STATES = 4  # [x y xdot ydot]
SIZES = (0,) * STATES


class Particles(NamedTuple):
    """Equally weighted histories of associations, what they say about each target."""

    mean: FloatArray  # (..., particle, target, 4)
    covariance: FloatArray  # (..., particle, target, 4, 4)


class RbpfUpdate(NamedTuple):
    """What ``rbpf_update`` returns."""

    mean: FloatArray  # (target, 4), of the weighted mixture
    covariance: FloatArray  # (target, 4, 4), of the weighted mixture
    effective_sample_size: float  # 1 / sum of the squared weights, before resampling
    ancestors: int  # how many different particles survive the resampling
    particles: Particles  # resampled: of equal weight
    log_evidence: float  # log likelihood of all scans relative to their being clutter throughout


def rbpf_update(
    key: int,
    mean: ArrayLike,
    covariance: ArrayLike,
    measurements: Sequence[ArrayLike],
    pd: ArrayLike,
    noise: ArrayLike,
    sensors: ArrayLike,
    clutter_density: float,
    gate_probability: float = 1.0,
    present: ArrayLike | None = None,
) -> RbpfUpdate:
    """Update equally weighted particles with one scan of every sensor: range and range-rate, in m and m/s.

    Sensors are taken in sequence; then the particles are resampled systematically. To begin with, repeat one mean and
    covariance N times. Between steps predict all particles: ``wavegym.trackers.predict`` broadcasts.

    Args:
        key: 0 <= key < 2^64, the name of the random numbers: the same key gives the same particles.
        mean: predicted states [x y xdot ydot] of each particle's targets, (particle, target, 4), in m and m/s.
        covariance: their covariances, (particle, target, 4, 4).
        measurements: for each sensor (r, rdot), (measurement, 2). A return more than sqrt(60) = 7.7 standard
            deviations from a particle's prediction is not that target's.
        pd: detection probabilities, (sensor, target), in (0, 1).
        noise: measurement covariances, (sensor, target, 2, 2).
        sensors: positions, (sensor, 2), in m.
        clutter_density: false returns per m x m/s, > 0.
        gate_probability: that a detected target's return is among the measurements, for every particle: returns are
            taken to be received wherever they fall. Where they were gated around the moments of a posterior of several
            modes, only the particles whose predicted return lies in a gate learn from its absence; the gates are an
            argument of ``update_particles`` in ``particle_kernels.py``.
        present: which targets there are, (target,); all if None. Absent ones are not updated.

    Returns:
        Moments, health figures, particles and evidence.

    Raises:
        InputError: shapes that disagree, values out of range, covariances that are not positive definite, or more
            targets than the exact association takes.
    """
    X, V = _particles(mean, covariance)
    there = np.ones(X.shape[1], bool) if present is None else np.array(present, bool)
    if there.shape != X.shape[1:2]:
        raise InputError(f"present has the shape {there.shape}, expected {X.shape[1:2]}")
    scans, Pd, N, place = _scans(measurements, pd, noise, sensors, X.shape[1])
    _check_values(key, Pd[:, there], clutter_density, gate_probability)
    for name, matrix in (("covariance", V[:, there]), ("noise", N[:, there])):
        if matrix.size:
            check_positive_definite(name, matrix)

    log_weight, own = np.zeros(len(X)), np.uint64(key)
    everywhere = np.zeros((len(there), 2)), np.ones((len(there), 2, 2)), np.inf, float(gate_probability)
    for i, z in enumerate(scans):
        kernels.update_particles(
            np.uint64(stream(own, i)), there, X, V, log_weight, z, len(z), Pd[i], N[i], place[i, 0], place[i, 1],
            everywhere, float(clutter_density), SIZES,
        )  # fmt: skip
        if not np.isfinite(log_weight).all():
            _explain(i, int(there.sum()), clutter_density)
    return _summary(np.uint64(stream(own, len(scans))), log_weight, X, V)


def systematic_resample(weights: ArrayLike, u: ArrayLike) -> NDArray[np.int64]:
    """Indices of the particles that survive: each floor(N w) or ceil(N w) times, in ascending order.

    A particle survives once for every i with (i + u) / N within its share of the cumulative weights (Kitagawa 1996).

    Args:
        weights: (..., N), >= 0, each row with a positive sum; they are normalised here.
        u: (...), in [0, 1): one number for each row.

    Returns:
        Indices (..., N).

    Raises:
        InputError: for weights that are negative, not finite or all zero, or a u outside [0, 1).
    """
    w, start = np.asarray(weights, np.float64), np.asarray(u, np.float64)
    total = w.sum(-1, keepdims=True) if w.ndim and w.shape[-1] else np.zeros(1)
    if not ((w >= 0.0).all() and (total > 0.0).all() and np.isfinite(total).all()):
        least = f"{w.min(initial=np.inf):g} and the least sum {total.min(initial=np.inf):g}"
        raise InputError(f"weights {w.shape} have the least value {least}, expected numbers >= 0 with a positive sum")
    if not ((start >= 0.0) & (start < 1.0)).all():
        raise InputError(f"u is {start.tolist()}, expected numbers in [0, 1)")
    try:
        lead = np.broadcast_shapes(w.shape[:-1], start.shape)
    except ValueError as error:
        raise InputError(
            f"weights and u have the shapes {w.shape} and {start.shape}, expected (..., N), (...)"
        ) from error
    share, index = np.array(np.broadcast_to(w / total, lead + w.shape[-1:])), np.empty(lead + w.shape[-1:], np.int64)
    for row in np.ndindex(lead):
        kernels.systematic(float(np.broadcast_to(start, lead)[row]), share[row], index[row])
    return index


def _summary(key: np.uint64, log_weight: FloatArray, X: FloatArray, V: FloatArray) -> RbpfUpdate:
    """Moments of the weighted particles, and equally weighted ones."""
    weight, x, P = np.empty(len(X)), np.empty(X.shape[1:]), np.empty(V.shape[1:])
    effective = kernels.normalise(log_weight, weight)
    kernels.mixture(weight, X, V, np.ones(X.shape[1], bool), x, P, SIZES)
    fresh = Particles(np.empty(X.shape), np.empty(V.shape))
    ancestors = kernels.resample(key, weight, X, V, *fresh, SIZES)
    top = log_weight.max()
    return RbpfUpdate(x, P, effective, ancestors, fresh, float(top + np.log(np.exp(log_weight - top).mean())))


def _particles(mean: ArrayLike, covariance: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Fresh arrays X (particle, target, 4) and V (particle, target, 4, 4)."""
    X = _array("mean", mean, (None, None, STATES))
    if not len(X):
        raise InputError(f"mean has the shape {X.shape}, expected at least one particle")
    return X, _array("covariance", covariance, (*X.shape, STATES))


def _scans(
    measurements: Sequence[ArrayLike], pd: ArrayLike, noise: ArrayLike, sensors: ArrayLike, targets: int
) -> tuple[list[FloatArray], FloatArray, FloatArray, FloatArray]:
    """What each sensor returned, Pd, noise covariances and places as arrays; a scan may come as an empty list."""
    rows = (np.empty((0, 2)) if np.size(z) == 0 else z for z in measurements)
    scans = [_array(f"measurements[{i}]", z, (None, 2)) for i, z in enumerate(rows)]
    Pd, N = _array("pd", pd, (len(scans), targets)), _array("noise", noise, (len(scans), targets, 2, 2))
    return scans, Pd, N, _array("sensors", sensors, (len(scans), 2))


def _array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """A C-contiguous copy of ``value``; InputError unless it has that shape (None: any size) and is finite."""
    array = np.array(value, np.float64, order="C")
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        wanted = ", ".join("any" if n is None else str(n) for n in shape)
        raise InputError(f"{name} has the shape {array.shape}, expected ({wanted})")
    if not np.isfinite(array).all():
        raise InputError(f"{name} has values that are not finite, the first at {np.argwhere(~np.isfinite(array))[0]}")
    return array


def _check_values(key: int, pd: FloatArray, clutter_density: float, gate_probability: float) -> None:
    """InputError for the first value out of range."""
    if not check_int("key", key, 0) < 2**64:
        raise InputError(f"key is {key}, expected an integer below 2^64 (nearest: {2**64 - 1})")
    check_association_terms(pd, clutter_density, gate_probability)


def _explain(sensor: int, targets: int, clutter_density: float) -> None:
    """InputError for a scan whose evidence is not a number."""
    if targets > CLUSTER_LIMIT:
        raise InputError(
            f"{targets} targets, expected at most {CLUSTER_LIMIT} that share measurements of sensor {sensor}"
        )
    raise InputError(
        f"clutter_density is {clutter_density!r}, expected more: the evidence of sensor {sensor} overflows"
    )
