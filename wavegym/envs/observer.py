"""What agents are shown of a belief: the system's scaled observation and, if asked for, forecasts of each candidate."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.system import Element, System
from wavegym.envs.forecasts import Forecasts
from wavegym.envs.observations import LIMIT, ObservationScaler


class Observer:
    """Observations of a batch of beliefs.

    Args:
        system: the closed loop.
        forecasts: whether ``Forecasts`` follow the system's own elements.

    Raises:
        InputError: ``forecasts`` is no bool, or the system cannot have them.
    """

    def __init__(self, system: System, forecasts: bool = False) -> None:
        if not isinstance(forecasts, bool):
            raise InputError(f"forecasts is {forecasts!r}, expected True or False (nearest: {bool(forecasts)})")
        self._system, self._scaler = system, ObservationScaler(system.elements)
        self._forecasts = Forecasts(system) if forecasts else None
        self.elements: tuple[Element, ...] = system.elements
        if self._forecasts:
            self.elements = (*self.elements, *self._forecasts.elements)
        self.space = spaces.Box(-LIMIT, LIMIT, (len(self.elements),), np.float32)

    def __call__(self, public: Any) -> tuple[Array, Array]:
        """Observations (env, elements) float32; how many of the system's own elements are saturated, (env,)."""
        observation, saturated = self._scaler(self._system.observe(public))
        if self._forecasts:
            observation = np.concatenate([observation, self._forecasts(public)], axis=1)
        return observation, saturated
