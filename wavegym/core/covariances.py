"""Covariance matrices: the cost of a belief, and checks whose one line names the matrix and the nearest valid value."""

from __future__ import annotations

from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_kernels import ROUNDING, first_invalid, summed_trace, summed_weighted
from wavegym.core.arrays import Array, FloatArray, check_finite, for_kernel
from wavegym.core.errors import InputError

MOST_RATIO = 1e12
"""Greatest ratio of a predicted variance to a measurement variance: an update loses ratio times 1e-16 of P."""


def check_positive_definite(name: str, matrix: ArrayLike) -> FloatArray:
    """Return ``matrix`` (..., n, n) if finite, symmetric and positive definite; otherwise raise an InputError."""
    return _checked(name, matrix, 0.0, "positive definite", "above 0")


def check_covariance(name: str, matrix: ArrayLike) -> FloatArray:
    """Return ``matrix`` (..., n, n) if finite, symmetric and positive semidefinite; otherwise raise an InputError.

    Rounding is tolerated: the correlation matrix may have eigenvalues down to -1e-6.
    """
    return _checked(name, matrix, ROUNDING, "positive semidefinite", "0")


def _checked(name: str, matrix: ArrayLike, slack: float, kind: str, least: str) -> FloatArray:
    array = np.asarray(matrix, dtype=np.float64)
    if array.ndim < 2 or array.shape[-1] != array.shape[-2]:
        raise InputError(f"{name} has shape {array.shape}, expected (..., n, n)")
    n = array.shape[-1]
    # One memory layout: each other layout would compile a second version of the kernel.
    plain = array if array.flags.c_contiguous and array.flags.writeable else np.array(array, order="C")
    first = first_invalid(plain.reshape(-1, n, n), slack, (0,) * n)
    if first >= 0:
        _raise_invalid(name, array, np.unravel_index(first, array.shape[:-2]), kind, least)
    return array


def _raise_invalid(name: str, array: FloatArray, index: tuple[np.intp, ...], kind: str, least: str) -> NoReturn:
    """Raise an InputError for the matrix at ``index``: an element, an asymmetry or the smallest eigenvalue."""
    check_finite(name, array)
    at = tuple(int(i) for i in index)
    matrix, where = array[at], f"[{', '.join(map(str, at))}]" if at else ""
    scale = np.sqrt(np.abs(np.diag(matrix)))
    skew = np.abs(matrix - matrix.T) > ROUNDING * np.outer(scale, scale)
    if skew.any():
        i, j = (int(k) for k in np.argwhere(skew)[0])
        pair = f"[{i}, {j}] = {matrix[i, j]:g} and [{j}, {i}] = {matrix[j, i]:g}"
        mean = 0.5 * (matrix[i, j] + matrix[j, i])
        raise InputError(f"{name}{where} has {pair}, expected a symmetric matrix (nearest: {mean:g} for both)")
    smallest = np.linalg.eigvalsh(matrix).min()
    raise InputError(
        f"{name}{where} has the eigenvalue {smallest:.6g}, expected a {kind} matrix (nearest eigenvalue: {least})"
    )


def check_precision(P: Array, C: Array, eta: Array, reference_range: float) -> None:
    """Raise an InputError for pulses so much finer than the first prediction that an update loses all digits.

    Args:
        P: first predicted covariance of range and range-rate, (..., 2, 2).
        C: measurement covariances of all waveforms at unit SNR, (waveform, 2, 2).
        eta: SNR at the first range, (...).
        reference_range: the range at which eta = 1, m. The error names its nearest valid value.
    """
    P, power = np.asarray(P)[..., None, :, :], np.asarray(eta)[..., None]
    det = C[:, 0, 0] * C[:, 1, 1] - C[:, 0, 1] * C[:, 1, 0]
    with np.errstate(all="ignore"):
        weighted = C[:, 1, 1] * P[..., 0, 0] - 2.0 * C[:, 0, 1] * P[..., 0, 1] + C[:, 0, 0] * P[..., 1, 1]
        # trace(R^-1 P) is at least the greatest ratio; a C that is singular up to rounding has no inverse at all.
        ratio = float(np.where(det > 0.0, power * weighted / det, np.inf).max())
    if not ratio <= MOST_RATIO:
        nearest = reference_range * (MOST_RATIO / ratio) ** 0.25
        hint = f"(nearest: {nearest:.3g} m; or " if nearest > 0.0 else "("
        raise InputError(
            f"reference_range is {reference_range!r} m: the first predicted variance is up to {ratio:.3g} times a "
            f"pulse's, expected at most {MOST_RATIO:g}, the limit of double precision {hint}a smaller dt, q, "
            "prior_variance or carrier_hz, or less extreme durations and sweeps)"
        )


def trace_cost(covariance: Array, weights: Array) -> Array:
    """Sum over targets of trace(Lambda P), (...), for P (..., target, n, n).

    weights: Lambda (n, n), or its diagonal (n,).
    """
    lead = covariance.shape[:-3]
    P = for_kernel(covariance).reshape(-1, *covariance.shape[-3:])
    cost = np.empty(len(P))
    (summed_weighted if weights.ndim == 2 else summed_trace)(P, weights, cost)
    return cost.reshape(lead)
