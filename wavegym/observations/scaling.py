"""From a system's observation in physical units to what an agent sees."""

from __future__ import annotations

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import ObservationField
from wavegym.observations import scaling_kernels as observation_kernels

LIMIT = 10.0  # scaled elements end here; by their scales, an ordinary value lies within 3


class ObservationScaler:
    """(value - centre) / scale for every element, float32, held within +-LIMIT.

    The constants belong to the scenario, so there are no running statistics, and an agent's policy file needs none.
    """

    def __init__(self, elements: tuple[ObservationField, ...]) -> None:
        self._centre = np.array([e.centre for e in elements])
        self._scale = np.array([e.scale for e in elements])

    def __call__(self, values: Array) -> tuple[Array, Array]:
        """Scaled observations (env, elements) float32 and the number of saturated elements (env,)."""
        count = len(values)
        observation, saturated = np.empty((count, len(self._centre)), np.float32), np.empty(count, np.int64)
        observation_kernels.scale(
            np.ascontiguousarray(values, np.float64), self._centre, self._scale, LIMIT, observation, saturated
        )
        return observation, saturated
