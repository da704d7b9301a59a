"""Scaling of observations from physical units to the numbers that agents see."""

from __future__ import annotations

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import ObservationField
from wavegym.observations.kernels import scale

LIMIT = 10.0  # bound of scaled fields; ordinary values lie within 3


class ObservationScaler:
    """(value - centre) / scale of every field, float32, clipped to +-LIMIT.

    The constants belong to the system: there are no running statistics, and a policy file needs none.
    """

    def __init__(self, fields: tuple[ObservationField, ...]) -> None:
        self._centre = np.array([field.centre for field in fields])
        self._scale = np.array([field.scale for field in fields])

    def __call__(self, values: Array) -> tuple[Array, Array]:
        """Scaled observations (env, fields) float32 and the number of saturated fields (env,)."""
        count = len(values)
        observation, saturated = np.empty((count, len(self._centre)), np.float32), np.empty(count, np.int64)
        scale(np.ascontiguousarray(values, np.float64), self._centre, self._scale, LIMIT, observation, saturated)
        return observation, saturated
