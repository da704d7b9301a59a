"""Checks of array arguments: whole arrays through the one-value checks of ``wavegym.core.errors``, and shapes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError


def every(check: Callable[[str, float], object], name: str, values: ArrayLike) -> FloatArray:
    """``values`` as an array whose elements all pass ``check(name, value)``, where ``check`` tests an interval.

    Testing the extremes is enough: if both lie in an interval, all elements do; one NaN makes both NaN.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.size:
        check(name, float(array.min()))
        check(name, float(array.max()))
    return array


def shaped(name: str, values: ArrayLike, *core: int) -> FloatArray:
    """``values`` as an array (..., *core); otherwise InputError."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim < len(core) or array.shape[array.ndim - len(core) :] != core:
        raise InputError(f"{name} has shape {array.shape}, expected (..., {', '.join(map(str, core))})")
    return array


def exactly(name: str, values: ArrayLike, *shape: int) -> FloatArray:
    """``values`` as a new array of exactly this shape; otherwise InputError."""
    array = np.array(values, dtype=np.float64)
    require_shape(name, array, shape)
    return array


def require_shape(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
    """InputError for any other shape."""
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}, expected {shape}")


def alike(**arrays: ArrayLike) -> tuple[FloatArray, ...]:
    """The arrays broadcast to one shape; otherwise InputError."""
    try:
        return tuple(np.broadcast_arrays(*arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {np.shape(array)}" for name, array in arrays.items())
        raise InputError(f"shapes are {shapes}, expected shapes that broadcast") from None
