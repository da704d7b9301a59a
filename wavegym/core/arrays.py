"""Arrays: type aliases, the layout that kernels take, and checks of elements, shapes, leading axes and keys."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from wavegym.core.errors import InputError

Array = NDArray[Any]
FloatArray = NDArray[np.float64]


def for_kernel(array: ArrayLike, dtype: DTypeLike | None = None) -> Array:
    """``array``, or a copy of it that is C-contiguous and writeable: each other layout compiles another version."""
    given = np.asarray(array, dtype)
    return given if given.flags.carray else np.array(given, order="C")


def check_elements(check: Callable[[str, float], object], name: str, values: ArrayLike) -> FloatArray:
    """Return ``values`` as an array, each element checked by ``check(name, value)``.

    The values that ``check`` accepts must form an interval: only the least and the greatest element are checked. A NaN
    makes both of them NaN.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.size:
        check(name, float(array.min()))
        check(name, float(array.max()))
    return array


def check_each(name: str, values: FloatArray, valid: NDArray[np.bool_], expected: str) -> None:
    """Raise an InputError with the first of ``values`` that is not ``valid``; both have one shape."""
    if not valid.all():
        index = tuple(int(i) for i in np.argwhere(~valid)[0])
        where = f"[{', '.join(map(str, index))}]" if index else ""
        raise InputError(f"{name}{where} is {float(values[index])!r}, expected {expected}")


def check_finite(name: str, values: ArrayLike, *core: int) -> FloatArray:
    """Return ``values`` as an array of shape (..., *core) if all are finite; otherwise raise an InputError."""
    array = check_last_axes(name, values, *core)
    finite = np.isfinite(array)
    if not finite.all():
        check_each(name, array, finite, "finite numbers")
    return array


def check_last_axes(name: str, values: ArrayLike, *core: int) -> FloatArray:
    """Return ``values`` as an array of shape (..., *core); otherwise raise an InputError."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim < len(core) or array.shape[array.ndim - len(core) :] != core:
        raise InputError(f"{name} has shape {array.shape}, expected (..., {', '.join(map(str, core))})")
    return array


def check_shape(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
    """Raise an InputError unless ``array`` has this shape."""
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}, expected {shape}")


def checked_copy(name: str, values: ArrayLike, *shape: int) -> FloatArray:
    """Return a copy of ``values`` as an array of this shape; otherwise raise an InputError."""
    array = np.array(values, dtype=np.float64)
    check_shape(name, array, shape)
    return array


def check_broadcast(**arrays: ArrayLike) -> tuple[FloatArray, ...]:
    """Return the arrays broadcast to one shape; otherwise raise an InputError with all shapes."""
    given = [np.asarray(array) for array in arrays.values()]
    try:
        shape = np.broadcast_shapes(*(array.shape for array in given))
    except ValueError:
        shapes = ", ".join(f"{name} {np.shape(array)}" for name, array in arrays.items())
        raise InputError(f"shapes are {shapes}, expected shapes that broadcast") from None
    # Not np.broadcast_arrays: NumPy 2.4 warns if code asks whether its results are writeable.
    return tuple(array if array.shape == shape else np.broadcast_to(array, shape) for array in given)


def check_key(key: SupportsIndex) -> np.uint64:
    """Return the key of a stream of random numbers if it is an integer in [0, 2^64); otherwise raise an InputError."""
    if not hasattr(key, "__index__") or not 0 <= int(key) < 2**64:
        raise InputError(f"key is {key!r}, expected an integer in [0, 2^64)")
    return np.uint64(key)


def flatten_lead(array: ArrayLike, lead: tuple[int, ...], *core: int) -> NDArray[Any]:
    """Broadcast ``array`` to (*lead, *core) and copy it to one flat leading axis: (prod(lead), *core)."""
    return np.array(np.broadcast_to(np.asarray(array), (*lead, *core)), order="C").reshape(math.prod(lead), *core)
