"""Checks of the arguments that several association methods share."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_each
from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError


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
