"""Checks of covariance matrices: one line that names the matrix in a batch, its value and the nearest valid value."""

from __future__ import annotations

from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_finite
from wavegym.core.arrays import FloatArray
from wavegym.core.covariance_kernels import ROUNDING, first_invalid
from wavegym.core.errors import InputError


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
