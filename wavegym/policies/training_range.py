"""The range of what a trained policy observed in its training: outside it, nobody knows what the policy does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from wavegym.core.arrays import Array

MARGIN = 0.1  # of the range, on both sides: the extremes of a few episodes are not those of all
KEY = "observed"  # in run.json
DIGITS = 4  # of an observation, which is within +-10


class TrainingRange(NamedTuple):
    """Least and greatest values of the elements of a network's observation.

    The forecasts of all candidates have one range, because a policy scores candidates alike.

    Attributes:
        own: number of elements before the forecasts.
        low: of these elements and of the forecasts of one candidate, (element,).
        high: the same.
    """

    own: int
    low: Array
    high: Array

    @classmethod
    def of(cls, observation: Array, own: int, forecasts: int) -> TrainingRange:
        """The range of observations (env, element), with so many forecasts of each candidate."""
        low, high = _extremes(observation, own, own + forecasts)
        return cls(own, low.min(axis=0), high.max(axis=0))

    @classmethod
    def from_record(cls, found: Mapping[str, Any]) -> TrainingRange:
        """The range of ``record``. Raises KeyError, TypeError or ValueError for anything else."""
        return cls(int(found["own"]), np.array(found["low"], np.float64), np.array(found["high"], np.float64))

    def record(self) -> dict[str, Any]:
        """The range as JSON, rounded."""
        low, high = (np.round(values.astype(np.float64), DIGITS).tolist() for values in (self.low, self.high))
        return {"own": self.own, "low": low, "high": high}

    def joined(self, other: TrainingRange) -> TrainingRange:
        """The range of both."""
        return self._replace(low=np.minimum(self.low, other.low), high=np.maximum(self.high, other.high))

    def is_left(self, observation: Array) -> Array:
        """Whether an element is farther outside than ``MARGIN``, (env,) bool, of observations (env, element)."""
        low, high = _extremes(observation, self.own, len(self.low))
        margin = MARGIN * (self.high - self.low) + 10.0**-DIGITS
        return np.asarray(((low < self.low - margin) | (high > self.high + margin)).any(axis=1))


def _extremes(observation: Array, own: int, elements: int) -> tuple[Array, Array]:
    """Least and greatest values, (env, element) each: of the forecasts, over the candidates."""
    if elements == own:
        return observation, observation
    forecasts = observation[:, own:].reshape(len(observation), -1, elements - own)
    low, high = forecasts.min(axis=1), forecasts.max(axis=1)
    if not own:
        return low, high
    return np.concatenate([observation[:, :own], low], axis=1), np.concatenate([observation[:, :own], high], axis=1)
