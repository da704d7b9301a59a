"""Which measurement comes from which target: exact joint association, LMIPDA, and the checks of their arguments.

References: Bar-Shalom, Fortmann, *Tracking and Data Association* (1988), chapter 9: joint association with Poisson
clutter of known density. Sira, Papandreou-Suppappola, Morrell, Cochran, *Waveform-agile sensing for tracking multiple
targets in clutter*, use the same sum as a particle filter's likelihood. Their eq. (11) as printed does not factorise
for targets with disjoint gates, and divides by zero where a gate is empty. ``joint_association`` computes the sum over
feasible associations that the equation is meant to be.
Musicki and La Scala, *Multi-target tracking in clutter without measurement assignment* (2008), for LMIPDA, linear
multitarget integrated probabilistic data association; Musicki, Evans and Stankovic, *Integrated probabilistic data
association* (1994), for the case of one track. Barbosa et al., section 4.2.4, print a wrong ``1 -`` before Pd Pg in the
association probabilities and omit the model probabilities in p = sum mu_r p_r.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import FloatArray, check_each, check_finite, flatten_lead
from wavegym.core.errors import InputError
from wavegym.trackers import association_kernels
from wavegym.trackers.association_kernels import CLUSTER_LIMIT, associate, largest_cluster


def check_association_terms(
    pd: ArrayLike, clutter_density: ArrayLike, gate_probability: float
) -> tuple[FloatArray, FloatArray, float]:
    """Return ``pd`` and ``clutter_density`` as arrays of any shape and ``gate_probability`` as a float.

    Raises:
        InputError: a pd outside (0, 1), a clutter density not > 0, or a gate probability outside (0, 1].
    """
    Pd, rho = np.asarray(pd, np.float64), np.asarray(clutter_density, np.float64)
    check_each("pd", Pd, (Pd > 0.0) & (Pd < 1.0), "probabilities in (0, 1)")
    check_each("clutter_density", rho, (rho > 0.0) & np.isfinite(rho), "finite numbers > 0")
    if not 0.0 < gate_probability <= 1.0:
        raise InputError(f"gate_probability is {gate_probability!r}, expected a probability in (0, 1]")
    return Pd, rho, float(gate_probability)


def check_distribution(name: str, values: FloatArray, row: str = "") -> None:
    """Raise an InputError unless each row of ``values`` (..., n) holds probabilities that sum to 1.

    ``row`` stands before the name in the message on the sum, such as ``"a row of "``.
    """
    check_each(name, values, (values >= 0.0) & (values <= 1.0), "probabilities")
    total = values.sum(axis=-1)
    check_each(f"the sum of {row}{name}", total, abs(total - 1.0) < 1e-9, "1 (nearest: divide by the sum)")


def check_scans(
    measurements: Sequence[ArrayLike], pd: ArrayLike, noise: ArrayLike, sensors: ArrayLike, targets: int
) -> tuple[list[FloatArray], FloatArray, FloatArray, FloatArray]:
    """Return the scans, Pd, noise covariances and sensor positions as arrays; a scan may be an empty list."""
    rows = (np.empty((0, 2)) if np.size(z) == 0 else z for z in measurements)
    scans = [check_array(f"measurements[{i}]", z, (None, 2)) for i, z in enumerate(rows)]
    Pd, N = check_array("pd", pd, (len(scans), targets)), check_array("noise", noise, (len(scans), targets, 2, 2))
    return scans, Pd, N, check_array("sensors", sensors, (len(scans), 2))


def check_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Return a C-contiguous copy of ``value`` if it is finite and has that shape (None: any size); otherwise raise."""
    array = np.array(value, np.float64, order="C")
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        wanted = ", ".join("any" if n is None else str(n) for n in shape)
        raise InputError(f"{name} has the shape {array.shape}, expected ({wanted})")
    check_finite(name, array)
    return array


def raise_without_evidence(sensor: int, targets: int, clutter_density: float) -> NoReturn:
    """Raise an InputError for a sensor whose log evidence is not finite."""
    if targets > CLUSTER_LIMIT:
        raise InputError(
            f"{targets} targets, expected at most {CLUSTER_LIMIT} that share measurements of sensor {sensor}"
        )
    raise InputError(
        f"clutter_density is {clutter_density!r}, expected more: the evidence of sensor {sensor} overflows"
    )


class Association(NamedTuple):
    """The result of ``joint_association``."""

    probabilities: FloatArray  # (..., T, M+1): column 0 missed, column m detected as measurement m; rows sum to 1
    log_evidence: FloatArray  # (...): log likelihood of the scan relative to clutter alone


def joint_association(
    likelihood: ArrayLike, pd: ArrayLike, clutter_density: ArrayLike, gate_probability: float = 1.0
) -> Association:
    """Marginal association probabilities and evidence, summed over all feasible joint associations.

    A joint association is feasible if each target has at most one measurement and each measurement at most one target.
    Its weight is the product of 1 - Pd Pg over the missed targets and of Pd N / rho over the detected targets. The sum
    is exact. Dynamic programming over subsets of targets takes M T 2^T steps for each cluster; targets that share
    measurements, directly or through others, form a cluster. Targets with disjoint gates factorise bit for bit.

    Args:
        likelihood: N(z_m; target t's predicted measurement, S_t), 0 outside the gate, (..., T, M), in 1/unit volume.
        pd: probability of detection Pd, (..., T), in (0, 1).
        clutter_density: expected number of clutter points per unit volume rho, (...), > 0, in 1/unit volume.
        gate_probability: Pg, the probability that a detected target's measurement lies in its gate; 1 without gates.

    Returns:
        See ``Association``. M = 0 and T = 0 are valid.

    Raises:
        InputError: values outside these ranges, shapes that do not fit, or more than ten targets in one cluster.
    """
    N, Pd, rho = (np.asarray(a, dtype=np.float64) for a in (likelihood, pd, clutter_density))
    lead = _check_lead(N, Pd, rho)
    check_each("likelihood", N, (N >= 0.0) & np.isfinite(N), "finite numbers >= 0")
    check_association_terms(Pd, rho, gate_probability)

    T, M = N.shape[-2:]
    W = np.empty((*lead, T, M + 1))
    W[..., 0] = 1.0 - Pd * gate_probability
    with np.errstate(over="ignore"):
        W[..., 1:] = Pd[..., None] * N / rho[..., None, None]
    beta, log_evidence = np.empty(W.shape), np.empty(lead)
    flat = (log_evidence.size, T, M + 1)
    associate(W.reshape(flat), beta.reshape(flat), log_evidence.reshape(-1))
    if np.isnan(log_evidence).any():
        _raise_without_evidence(W, log_evidence)
    return Association(beta, log_evidence)


def _check_lead(N: FloatArray, Pd: FloatArray, rho: FloatArray) -> tuple[int, ...]:
    """Return the broadcast leading axes of likelihood, pd and clutter density; otherwise raise an InputError."""
    try:
        if N.ndim < 2 or Pd.shape[-1:] != N.shape[-2:-1]:
            raise ValueError(N.shape)
        return np.broadcast_shapes(N.shape[:-2], Pd.shape[:-1], rho.shape)
    except ValueError as error:
        raise InputError(
            f"likelihood, pd and clutter_density have the shapes {N.shape}, {Pd.shape} and {rho.shape}, "
            "expected (..., T, M), (..., T) and (...) with leading axes that broadcast"
        ) from error


def _raise_without_evidence(W: FloatArray, log_evidence: FloatArray) -> NoReturn:
    """Raise an InputError for the first environment whose log evidence is NaN."""
    index = tuple(int(i) for i in np.argwhere(np.isnan(log_evidence))[0])
    where = f" in environment {index[0] if len(index) == 1 else index}" if index else ""
    largest = largest_cluster(W[index])
    if largest > CLUSTER_LIMIT:
        raise InputError(
            f"{largest} targets share measurements{where}, expected at most {CLUSTER_LIMIT} in one cluster; "
            "use smaller gates"
        )
    raise InputError(f"pd * likelihood / clutter_density{where} is {W[index].max():.6g}, expected numbers below 1e308")


class LmipdaUpdate(NamedTuple):
    """The result of ``lmipda``."""

    association: FloatArray  # (..., T, r, 1 + M): column 0 missed, column m detected as measurement m; rows sum to 1
    models: FloatArray  # updated model probabilities mu, (..., T, r)
    existence: FloatArray  # updated existence probabilities psi, (..., T)


def lmipda(
    likelihood: ArrayLike,
    models: ArrayLike,
    existence: ArrayLike,
    pd: ArrayLike,
    clutter_density: ArrayLike,
    gate_probability: float = 1.0,
) -> LmipdaUpdate:
    """Association, model and existence probabilities of all tracks after one scan.

    For each track the other tracks are additional clutter. Its density at a measurement grows with the probability that
    they caused the measurement. The cost grows with tracks times measurements, not with the number of joint
    associations.

    Args:
        likelihood: p = N(z_m; the model's predicted measurement, S) / Pg, 0 outside the gate, (..., T, r, M), in
            1/unit volume.
        models: predicted model probabilities mu, (..., T, r).
        existence: predicted existence probabilities psi, (..., T), in [0, 1].
        pd: probability of detection Pd, (..., T), in (0, 1).
        clutter_density: expected number of clutter points per unit volume rho > 0, (...); or its value at each
            measurement in each track's gate, (..., T, M).
        gate_probability: Pg, in (0, 1].

    Returns:
        See ``LmipdaUpdate``. M = 0 and T = 0 are valid.

    Raises:
        InputError: values outside these ranges, or shapes that do not fit.
    """
    p, mu, psi, Pd = (np.asarray(a, np.float64) for a in (likelihood, models, existence, pd))
    rho = np.asarray(clutter_density, np.float64)
    if p.ndim < 3 or mu.shape[-2:] != p.shape[-3:-1] or {psi.shape[-1:], Pd.shape[-1:]} != {p.shape[-3:-2]}:
        raise InputError(_shapes(p, mu, psi, Pd, rho))
    T, r, M = p.shape[-3:]
    if rho.shape[-2:] != (T, M):
        rho = rho[..., None, None]
    try:
        lead = np.broadcast_shapes(p.shape[:-3], mu.shape[:-2], psi.shape[:-1], Pd.shape[:-1], rho.shape[:-2])
    except ValueError:
        raise InputError(_shapes(p, mu, psi, Pd, np.asarray(clutter_density))) from None
    check_each("likelihood", p, (p >= 0.0) & np.isfinite(p), "finite numbers >= 0")
    check_each("existence", psi, (psi >= 0.0) & (psi <= 1.0), "probabilities")
    check_distribution("models", mu)
    check_association_terms(Pd, rho, gate_probability)
    mu, psi = flatten_lead(mu, lead, T, r), flatten_lead(psi, lead, T)
    seen = flatten_lead(Pd * gate_probability, lead, T)
    beta = np.empty((len(mu), T * r, 1 + M))
    association_kernels.lmipda(flatten_lead(p, lead, T, r, M), mu, seen, psi, flatten_lead(rho, lead, T, M), beta)
    if not np.isfinite(psi).all():
        raise InputError(
            f"likelihood goes up to {p.max():g}, expected numbers whose ratio to clutter_density is finite"
        )
    return LmipdaUpdate(beta.reshape(*lead, T, r, 1 + M), mu.reshape(*lead, T, r), psi.reshape(*lead, T))


def _shapes(p: FloatArray, mu: FloatArray, psi: FloatArray, Pd: FloatArray, rho: FloatArray) -> str:
    return (
        f"likelihood, models, existence, pd and clutter_density have the shapes {p.shape}, {mu.shape}, {psi.shape}, "
        f"{Pd.shape} and {rho.shape}, expected (..., T, r, M), (..., T, r), (..., T), (..., T) and (...) or (..., T, M)"
    )
