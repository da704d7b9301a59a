"""Type aliases of arrays, and the layout that kernels take."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

Array = NDArray[Any]
FloatArray = NDArray[np.float64]


def for_kernel(array: ArrayLike, dtype: DTypeLike | None = None) -> Array:
    """``array``, or a copy of it that is C-contiguous and writeable: each other layout compiles another version."""
    given = np.asarray(array, dtype)
    return given if given.flags.carray else np.array(given, order="C")
