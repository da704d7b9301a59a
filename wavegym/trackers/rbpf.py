"""Rao-Blackwellised particle filter (RBPF) over joint associations: the update of one step, for one environment.

The filter samples associations only: which return comes from which target. Given the associations, each target has a
Gaussian belief, updated by an unscented Kalman filter. A particle is thus one history of associations with a mean and a
covariance for each target. Clutter around a new target makes a posterior with many modes; each mode costs a few
particles, where a single Gaussian would merge the modes. The associations of a particle are drawn target after target
from their exact joint posterior. Its weight changes only by the evidence of the scan, an exact sum over all feasible
associations.

References: Särkkä, Vehtari & Lampinen, *Rao-Blackwellized particle filter for multiple target tracking*, Information
Fusion 8 (2007); Sira, Papandreou-Suppappola, Morrell, Cochran, *Waveform-agile sensing for tracking multiple targets in
clutter*, section 4, with likelihood (11) in the form of ``joint_association``. Kitagawa, *Monte Carlo filter and
smoother*, Journal of Computational and Graphical Statistics 5 (1996), for the systematic resampling.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import FloatArray, check_key
from wavegym.core.counter_rng_kernels import stream
from wavegym.core.covariances import check_positive_definite
from wavegym.core.errors import InputError
from wavegym.trackers import rbpf_kernels as kernels
from wavegym.trackers.association import check_array, check_association_terms, check_scans, raise_without_evidence

STATES = 4  # [x y xdot ydot]
SIZES = (0,) * STATES


class Particles(NamedTuple):
    """Equally weighted particles: the belief about each target under each history of associations."""

    mean: FloatArray  # (..., particle, target, 4)
    covariance: FloatArray  # (..., particle, target, 4, 4)


class RbpfUpdate(NamedTuple):
    """The result of ``rbpf_update``."""

    mean: FloatArray  # (target, 4), of the weighted mixture
    covariance: FloatArray  # (target, 4, 4), of the weighted mixture
    effective_sample_size: float  # 1 / sum of the squared weights, before resampling
    ancestors: int  # number of different particles that survive the resampling
    particles: Particles  # resampled, of equal weight
    log_evidence: float  # log likelihood of all scans relative to clutter alone


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

    The sensors are processed in sequence; then the particles are resampled systematically. Start with N copies of one
    mean and covariance. Between steps predict all particles: ``wavegym.trackers.predict`` broadcasts.

    Args:
        key: seed of the random numbers, 0 <= key < 2^64: equal keys give equal particles.
        mean: predicted states [x y xdot ydot] of each particle's targets, (particle, target, 4), in m and m/s.
        covariance: their covariances, (particle, target, 4, 4).
        measurements: for each sensor (r, rdot), (measurement, 2). A return more than sqrt(60) = 7.7 standard
            deviations from a particle's prediction is not associated with that target.
        pd: detection probabilities, (sensor, target), in (0, 1).
        noise: measurement covariances, (sensor, target, 2, 2).
        sensors: positions, (sensor, 2), in m.
        clutter_density: false returns per m x m/s, > 0.
        gate_probability: probability that a detected target's return is among the measurements, the same for all
            particles. If the measurements were gated around the moments of a posterior with several modes, a missing
            return tells only about particles that predict it inside a gate: see the argument ``gates`` of
            ``update_particles`` in ``rbpf_kernels.py``.
        present: which targets exist, (target,); all if None. Absent targets are not updated.

    Returns:
        See ``RbpfUpdate``.

    Raises:
        InputError: shapes that do not fit, values out of range, covariances that are not positive definite, or more
            than ten targets that share measurements.
    """
    X, V = _check_particles(mean, covariance)
    there = np.ones(X.shape[1], bool) if present is None else np.array(present, bool)
    if there.shape != X.shape[1:2]:
        raise InputError(f"present has the shape {there.shape}, expected {X.shape[1:2]}")
    scans, Pd, N, place = check_scans(measurements, pd, noise, sensors, X.shape[1])
    own = check_key(key)
    check_association_terms(Pd[:, there], clutter_density, gate_probability)
    for name, matrix in (("covariance", V[:, there]), ("noise", N[:, there])):
        if matrix.size:
            check_positive_definite(name, matrix)

    log_weight = np.zeros(len(X))
    everywhere = np.zeros((len(there), 2)), np.ones((len(there), 2, 2)), np.inf, float(gate_probability)
    for i, z in enumerate(scans):
        kernels.update_particles(
            np.uint64(stream(own, i)), there, X, V, log_weight, z, len(z), Pd[i], N[i], place[i, 0], place[i, 1],
            everywhere, float(clutter_density), SIZES,
        )  # fmt: skip
        if not np.isfinite(log_weight).all():
            raise_without_evidence(i, int(there.sum()), clutter_density)
    return _summary(np.uint64(stream(own, len(scans))), log_weight, X, V)


def systematic_resample(weights: ArrayLike, u: ArrayLike) -> NDArray[np.int64]:
    """Systematic resampling: ascending indices of the surviving particles, each floor(N w) or ceil(N w) times.

    A particle survives once for each i with (i + u) / N in its interval of the cumulative weights (Kitagawa 1996).

    Args:
        weights: (..., N), >= 0, each row with a positive sum; they need not be normalised.
        u: (...), in [0, 1), one random number for each row.

    Returns:
        Indices (..., N).

    Raises:
        InputError: weights that are negative, not finite or all zero, or a u outside [0, 1).
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
    """Moments of the weighted particles, and the resampled particles."""
    weight, x, P = np.empty(len(X)), np.empty(X.shape[1:]), np.empty(V.shape[1:])
    effective = kernels.normalise(log_weight, weight)
    kernels.mixture(weight, X, V, np.ones(X.shape[1], bool), x, P, SIZES)
    fresh = Particles(np.empty(X.shape), np.empty(V.shape))
    ancestors = kernels.resample(key, weight, X, V, *fresh, SIZES)
    top = log_weight.max()
    return RbpfUpdate(x, P, effective, ancestors, fresh, float(top + np.log(np.exp(log_weight - top).mean())))


def _check_particles(mean: ArrayLike, covariance: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return copies X (particle, target, 4) and V (particle, target, 4, 4); otherwise raise an InputError."""
    X = check_array("mean", mean, (None, None, STATES))
    if not len(X):
        raise InputError(f"mean has the shape {X.shape}, expected at least one particle")
    return X, check_array("covariance", covariance, (*X.shape, STATES))
