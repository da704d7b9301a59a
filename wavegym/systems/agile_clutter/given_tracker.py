"""A step of a user's tracker."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from wavegym.core.arrays import Array, for_kernel
from wavegym.sensors import range_and_rate, range_and_rate_jacobian
from wavegym.systems.agile_clutter import kernels
from wavegym.systems.agile_clutter.state import NN
from wavegym.targets import MotionModel
from wavegym.trackers.protocol import UNKNOWN, Estimate, MeasurementModel, Scan, Tracker


@dataclass(frozen=True)
class GivenTracker:
    """Passes each sensor's scan and the present targets to a user's tracker.

    Args:
        tracker: of the user.
        motion: the motion model that the tracker assumes.
        targets: step of birth of each target, (target,) int, and the steps for which each is tracked.
        radar: the sensors, their laws and the clutter as the kernels take them.
    """

    tracker: Tracker
    motion: MotionModel
    targets: tuple[Array, int]
    radar: tuple[Any, ...]

    def follow(self, belief: Any, pulse: tuple[Array, ...], measurements: Any) -> Any:
        """The belief one step later: one update for each sensor; targets that it cannot detect keep their estimate."""
        step, (births, lifetime) = belief.step, self.targets
        is_here = (births < step[:, None] + 1) & (step[:, None] + 1 <= births + lifetime)
        before = Estimate(belief.mean, belief.covariance)
        now = _chosen(is_here, self.tracker.predict(before, self.motion), before)
        for i in range(len(self.radar[0])):
            is_lit, scan = self._scan(i, now, step, pulse, measurements)
            now = _chosen(is_lit, self.tracker.update(now, scan), now)
        mean = np.where((births == step[:, None] + 1)[..., None], measurements.first, now.mean)
        return belief._replace(step=step + 1, mean=mean, covariance=now.covariance)

    def _scan(
        self, i: int, now: Estimate, step: Array, pulse: tuple[Array, ...], measurements: Any
    ) -> tuple[Array, Scan]:
        """Which targets sensor i may detect, (env, target) bool, and its scan, for a tracker that believes ``now``."""
        sensors, density = self.radar[0], self.radar[4]
        lit, pd = np.empty(now.mean.shape[:2], np.bool_), np.empty(now.mean.shape[:2])
        noise = np.empty((*pd.shape, 2, 2))
        kernels.assume(i, step, now.mean, now.covariance, pulse, self.targets, self.radar, lit, noise, pd, NN)
        z, present = measurements.z[:, i], measurements.present[:, i]
        R = np.empty((*z.shape, 2))
        kernels.noise_of_returns(i, for_kernel(z), pulse, self.radar, R)
        place = sensors[i]
        model = MeasurementModel(lambda x: range_and_rate(x, place), lambda x: range_and_rate_jacobian(x, place))
        origin = np.full(present.shape, UNKNOWN)
        return lit, Scan(z, present, origin, R, model, pd, noise, max(density, kernels.LEAST_DENSITY))


def _chosen(chosen: Array, one: Estimate, other: Estimate) -> Estimate:
    """The estimates ``one`` of the targets that are ``chosen`` (env, target), the others' of ``other``."""
    return Estimate(
        np.where(chosen[..., None], one.mean, other.mean),
        np.where(chosen[..., None, None], one.covariance, other.covariance),
    )
