"""Linear multitarget integrated probabilistic data association (LMIPDA): association and existence probabilities.

References: Musicki and La Scala, *Multi-target tracking in clutter without measurement assignment* (2008), for LMIPDA;
Musicki, Evans and Stankovic, *Integrated probabilistic data association* (1994), for the case of one track.
Barbosa et al., section 4.2.4, print a wrong ``1 -`` before Pd Pg in the association probabilities and omit the model
probabilities in p = sum mu_r p_r.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_each, flatten_lead
from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError
from wavegym.trackers import lmipda_kernels as kernels
from wavegym.trackers.checks import check_association_terms, check_distribution


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
    kernels.lmipda(flatten_lead(p, lead, T, r, M), mu, seen, psi, flatten_lead(rho, lead, T, M), beta)
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
