"""Checks of what all association in clutter needs, for arrays of any shape."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError


def flat(array: ArrayLike, lead: tuple[int, ...], *core: int) -> NDArray[Any]:
    """A fresh array with the leading axes ``lead``, to which ``array`` broadcasts, made one: (prod(lead), *core)."""
    return np.array(np.broadcast_to(np.asarray(array), (*lead, *core)), order="C").reshape(math.prod(lead), *core)


def association_terms(
    pd: ArrayLike, clutter_density: ArrayLike, gate_probability: float
) -> tuple[FloatArray, FloatArray, float]:
    """The three as arrays and a float.

    Raises:
        InputError: a pd outside (0, 1), a clutter density not > 0, or a gate probability outside (0, 1].
    """
    Pd, rho = np.asarray(pd, np.float64), np.asarray(clutter_density, np.float64)
    require_each("pd", Pd, (Pd > 0.0) & (Pd < 1.0), "probabilities in (0, 1)")
    require_each("clutter_density", rho, (rho > 0.0) & np.isfinite(rho), "finite numbers > 0")
    if not 0.0 < gate_probability <= 1.0:
        raise InputError(f"gate_probability is {gate_probability!r}, expected a probability in (0, 1]")
    return Pd, rho, float(gate_probability)


def require_distribution(name: str, values: FloatArray, row: str = "") -> None:
    """InputError unless rows of ``values`` (..., n), of which ``row`` tells, are probabilities that sum to 1."""
    require_each(name, values, (values >= 0.0) & (values <= 1.0), "probabilities")
    total = values.sum(axis=-1)
    require_each(f"the sum of {row}{name}", total, abs(total - 1.0) < 1e-9, "1")


def require_each(name: str, values: FloatArray, valid: NDArray[np.bool_], wanted: str) -> None:
    """InputError with the first of ``values`` that is not ``valid``."""
    if not valid.all():
        index = tuple(int(i) for i in np.argwhere(~valid)[0])
        where = f"[{', '.join(map(str, index))}]" if index else ""
        raise InputError(f"{name}{where} is {float(values[index])!r}, expected {wanted}")
