"""Signal-to-noise ratio from range."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.sensors import kernels


def range_law_snr(
    range_m: ArrayLike, reference_range: float = 50e3, nearest_range: float = 100.0
) -> NDArray[np.float64]:
    """eta = (r0 / r)^4, mean 2E/N0: two-way spreading, 1 at the reference range (Kershaw & Evans 1994).

    Args:
        range_m: r in metres, any shape.
        reference_range: r0 in metres, where eta = 1.
        nearest_range: least r in metres; a target overhead has a finite SNR.
    """
    return kernels.snr(range_m, reference_range, nearest_range)
