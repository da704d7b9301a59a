"""The observation of agents: the system's scaled fields and, on request, forecasts of each candidate."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.system import ObservationField, System
from wavegym.observations.forecasts import Forecasts
from wavegym.observations.scaling import LIMIT, ObservationScaler


class Observer:
    """Observations of a batch of beliefs.

    Args:
        system: the closed loop.
        forecasts: whether ``Forecasts`` follow the system's own fields.

    Raises:
        InputError: ``forecasts`` is not a bool, or the system does not admit ``Forecasts``.
    """

    def __init__(self, system: System, forecasts: bool = False) -> None:
        if not isinstance(forecasts, bool):
            raise InputError(f"forecasts is {forecasts!r}, expected True or False (nearest: {bool(forecasts)})")
        self._system, self._scaler = system, ObservationScaler(system.observation_fields)
        self._forecasts = Forecasts(system) if forecasts else None
        self.observation_fields: tuple[ObservationField, ...] = system.observation_fields
        if self._forecasts:
            self.observation_fields = (*self.observation_fields, *self._forecasts.observation_fields)
        self.space = spaces.Box(-LIMIT, LIMIT, (len(self.observation_fields),), np.float32)

    def __call__(self, belief: Any) -> tuple[Array, Array]:
        """Observations (env, fields) float32, and the number of the system's own fields that are saturated, (env,)."""
        observation, saturated = self._scaler(self._system.observe(belief))
        if self._forecasts:
            observation = np.concatenate([observation, self._forecasts(belief)], axis=1)
        return observation, saturated
