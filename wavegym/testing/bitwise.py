"""Bitwise comparison of environments' return values: arrays, scalars, dictionaries, tuples and object arrays."""

from __future__ import annotations

from reprlib import repr as short
from typing import Any

import numpy as np

from wavegym.core.arrays import Array


def difference(got: Any, want: Any) -> str | None:
    """The first difference of ``got`` from ``want``, as ``"['key'][3] is 1.0, expected 2.0"``; None where equal.

    Types, dtypes and shapes count, and so does the sign of a zero; a NaN equals a NaN.
    """
    if isinstance(want, dict):
        return _mappings(got, want)
    if isinstance(want, (tuple, list)):
        return _sequences(got, want)
    if isinstance(want, (np.ndarray, np.generic, int, float)):
        return _arrays(got, want)
    return None if type(got) is type(want) and got == want else f" is {short(got)}, expected {short(want)}"


def _mappings(got: Any, want: dict[Any, Any]) -> str | None:
    if not isinstance(got, dict):
        return f" is {short(got)}, expected a dictionary"
    for key in want:
        if key not in got:
            return f" lacks the key {key!r}"
    for key in got:
        if key not in want:
            return f" has the key {key!r}, which is not expected"
        inner = difference(got[key], want[key])
        if inner:
            return f"[{key!r}]{inner}"
    return None


def _sequences(got: Any, want: tuple[Any, ...] | list[Any]) -> str | None:
    if type(got) is not type(want) or len(got) != len(want):
        return f" is {short(got)}, expected a {type(want).__name__} of {len(want)}"
    for i, (one, other) in enumerate(zip(got, want, strict=True)):
        inner = difference(one, other)
        if inner:
            return f"[{i}]{inner}"
    return None


def _arrays(got: Any, want: Any) -> str | None:
    if isinstance(got, np.ndarray) is not isinstance(want, np.ndarray):
        return f" is {short(got)}, expected {short(want)}"
    one, other = np.asarray(got), np.asarray(want)
    if one.dtype != other.dtype or one.shape != other.shape:
        return f" is {one.dtype} with shape {one.shape}, expected {other.dtype} with shape {other.shape}"
    if other.dtype == object:
        for index in np.ndindex(other.shape):
            inner = difference(one[index], other[index])
            if inner:
                return f"{list(index)}{inner}"
        return None
    if one.tobytes() == other.tobytes():
        return None
    wrong = ~_same(one, other)
    if not wrong.any():
        return None
    first = tuple(int(i) for i in np.argwhere(wrong)[0])
    return f"{list(first) if first else ''} is {one[first]!r}, expected {other[first]!r}"


def _same(one: Array, other: Array) -> Array:
    """Whether elements are equal, bool array."""
    if one.dtype.kind not in "fc":
        return one == other
    equal = one == other
    if one.dtype.kind == "f":
        equal &= np.signbit(one) == np.signbit(other)
    return equal | (np.isnan(one) & np.isnan(other))
