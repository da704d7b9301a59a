"""Signal-to-noise ratio from range."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.array_checks import check_elements
from wavegym.core.errors import check_non_negative, check_positive
from wavegym.sensors import kernels


def range_law_snr(
    range_m: ArrayLike, reference_range: float = 50e3, nearest_range: float = 100.0
) -> NDArray[np.float64]:
    """eta = (r0 / r)^4, mean 2E/N0: two-way spreading, 1 at the reference range (Kershaw & Evans 1994).

    Args:
        range_m: r in metres, >= 0, any shape.
        reference_range: r0 in metres, where eta = 1.
        nearest_range: least r in metres; a target overhead has a finite SNR.

    Raises:
        InputError: a range that is negative or not finite, or a reference or nearest range that is not > 0.
    """
    r = check_elements(check_non_negative, "range_m", range_m)
    check_positive("reference_range", reference_range, "m")
    check_positive("nearest_range", nearest_range, "m")
    return kernels.snr(r, reference_range, nearest_range)
