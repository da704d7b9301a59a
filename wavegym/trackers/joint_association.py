"""Exact joint data association: association probabilities of all targets, and the likelihood of the whole scan.

References: Bar-Shalom, Fortmann, *Tracking and Data Association* (1988), chapter 9: the joint probabilistic data
association filter with Poisson clutter of known density. Sira, Papandreou-Suppappola, Morrell, Cochran,
*Waveform-agile sensing for tracking multiple targets in clutter*, use the same sum as a particle filter's likelihood.
Their eq. (11) as printed does not factorise for targets with disjoint gates, and divides by zero where a gate is empty.
This module computes the sum over feasible associations that the equation is meant to be.
"""

from __future__ import annotations

from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_each
from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError
from wavegym.trackers import joint_association_kernels as kernels
from wavegym.trackers.checks import check_association_terms


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
    kernels.associate(W.reshape(flat), beta.reshape(flat), log_evidence.reshape(-1))
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
    largest = kernels.largest_cluster(W[index])
    if largest > kernels.CLUSTER_LIMIT:
        raise InputError(
            f"{largest} targets share measurements{where}, expected at most {kernels.CLUSTER_LIMIT} in one cluster; "
            "use smaller gates"
        )
    raise InputError(f"pd * likelihood / clutter_density{where} is {W[index].max():.6g}, expected numbers below 1e308")
