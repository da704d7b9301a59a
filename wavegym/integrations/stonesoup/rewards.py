"""The objective of wavegym as a reward function of Stone Soup."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.predictor import Predictor
from stonesoup.sensormanager.reward import RewardFunction, UncertaintyRewardFunction
from stonesoup.updater import Updater


class WeightedTraceReward(RewardFunction):
    """Minus trace(Lambda P) of all tracks after the measurement: what ``myopic`` minimises.

    Stone Soup's ``UncertaintyRewardFunction`` sums norms of whole covariances, which add m^2 and m^2/s^2.
    """

    predictor: Predictor = Property(doc="Predicts the tracks to the time of the measurement")
    updater: Updater = Property(doc="Updates them")
    weights: Sequence[float] = Property(doc="The diagonal of Lambda in the order of the state vector, (n,)")

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._uncertainty = UncertaintyRewardFunction(self.predictor, self.updater, return_tracks=True)

    def __call__(self, config: Any, tracks: Any, metric_time: Any, *args: Any, **kwargs: Any) -> float:
        """The reward of a choice of actions for each sensor."""
        _, after = self._uncertainty(config, tracks, metric_time)
        return -float(sum(np.dot(self.weights, np.diagonal(track.covar)) for track in after))
