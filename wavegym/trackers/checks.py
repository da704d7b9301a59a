"""Checks of the arguments that several association methods share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_each, check_finite
from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError
from wavegym.trackers.joint_association_kernels import CLUSTER_LIMIT


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
