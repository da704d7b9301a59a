"""The agile-clutter loop's one-step choice sensor after sensor, and what it takes (section 5.1)."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import System
from wavegym.systems.agile_clutter import prediction_kernels as prediction
from wavegym.systems.agile_clutter.state import Ahead, Belief
from wavegym.trackers.information_reduction import reduction_table

NN = (0, 0, 0, 0)  # the state [x y xdot ydot], as kernels take its size


class SensorAfterSensor(System):
    """What ``AgileClutter`` offers to schedulers that choose for one sensor at a time."""

    action_set: Any
    sensors: Any
    _targets: Any
    _model: Any
    _radar: Any
    _weights: Any

    def ahead(self, belief: Belief) -> Ahead:
        """The belief that the next pulse meets."""
        x, P = np.empty(belief.mean.shape), np.empty(belief.covariance.shape)
        present = np.empty(x.shape[:2], np.bool_)
        prediction.predict_present(*belief[:3], self._targets, *self._model, x, P, present, NN)
        return Ahead(x, P, present)

    def sensor_costs(self, ahead: Ahead, sensor: int, C: Array) -> Array:
        """trace(Lambda P) after one sensor's pulse, (env, candidate), for C (env or 1, candidate, 2, 2) at unit SNR."""
        cost = np.empty((len(ahead.mean), C.shape[1]))
        prediction.sensor_costs(sensor, *ahead, C, self._weights, self._radar, reduction_table(), cost, NN)
        return cost

    def after_sensor(self, ahead: Ahead, sensor: int, C: Array) -> Ahead:
        """The belief that the next sensor's pulse meets, after this sensor's with C (env, 2, 2) at unit SNR."""
        P = np.empty(ahead.covariance.shape)
        prediction.after_sensor(sensor, *ahead, C, self._radar, reduction_table(), P, NN)
        return ahead._replace(covariance=P)

    def best_action(self, belief: Belief) -> Array:
        """The one-step scheduler's choice among the candidates, sensor after sensor (section 5.1).

        Nearly the best joint one: a later sensor's pulse may favour another choice of an earlier one's.
        """
        ahead, C, choices = self.ahead(belief), self.action_set.sensor_covariances, []
        for i in range(len(self.sensors)):
            choices.append(self.sensor_costs(ahead, i, C[None]).argmin(axis=1))
            if i + 1 < len(self.sensors):
                ahead = self.after_sensor(ahead, i, C[choices[-1]])
        return self.action_set.encode(np.stack(choices, axis=1))
