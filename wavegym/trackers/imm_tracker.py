"""A tracker that adapts to how hard a target manoeuvres: interacting multiple models (IMM) of Kalman filters.

Reference: Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section
11.6.6.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_within
from wavegym.targets.motion import MotionModel
from wavegym.trackers import imm_kernels as kernels
from wavegym.trackers.kalman import predict
from wavegym.trackers.protocol import Estimate, Scan


class ImmMemory(NamedTuple):
    """One Gaussian and one probability for each model of each target."""

    mean: Array  # (env, target, model, n)
    covariance: Array  # (env, target, model, n, n)
    probability: Array  # (env, target, model)


@dataclass(frozen=True)
class ImmKalman:
    """An IMM of extended Kalman filters, one for each motion model; for a linear sensor, of Kalman filters.

    All models are equally likely at first. The estimate is the mixture of the models: its covariance includes the
    spread of their means. ``process_noise`` is the mean of the models' Q, weighted with their probabilities in the next
    step; with it a prediction of the mixture is exact if all models have one F, that of the system.

    Args:
        models: motion models of equal states, such as constant velocity with several process noise densities.
        stay: probability that a target keeps its model from one step to the next; other models are equally likely.

    Raises:
        InputError: no models, models of different states, or a probability outside [0, 1].
    """

    models: tuple[MotionModel, ...]
    stay: float = 0.95

    def __post_init__(self) -> None:
        check_within("stay", self.stay, 0.0, 1.0)
        names = {model.names for model in self.models}
        if len(names) != 1:
            raise InputError(f"models have the states {sorted(names)}, expected one or more models of equal states")

    @cached_property
    def transition(self) -> Array:
        """Probability that the model of row i changes to that of column j, (models, models)."""
        count = len(self.models)
        if count == 1:
            return np.ones((1, 1))
        return np.where(np.eye(count, dtype=np.bool_), self.stay, (1.0 - self.stay) / (count - 1))

    @cached_property
    def _motion(self) -> tuple[Array, Array]:
        """F and Q of each model, (models, n, n)."""
        return np.stack([model.F for model in self.models]), np.stack([model.Q for model in self.models])

    def begin(self, estimate: Estimate, motion: MotionModel) -> Estimate:
        """See ``TrackerWithMemory``. The models stand for ``motion``."""
        if motion.names != self.models[0].names:
            raise InputError(f"models have the states {self.models[0].names}, expected those of motion: {motion.names}")
        mean, covariance = (
            np.repeat(array[:, :, None], len(self.models), axis=2) for array in (estimate.mean, estimate.covariance)
        )
        probability = np.full(mean.shape[:3], 1.0 / len(self.models))
        return self._combined(ImmMemory(mean, covariance, probability))

    def predict(self, estimate: Estimate, motion: MotionModel) -> Estimate:
        """See ``Tracker``: the models mix, then each predicts with its own motion."""
        mean, covariance, probability = kernels.mix(*estimate.memory, self.transition)
        return self._combined(ImmMemory(*predict(mean, covariance, *self._motion), probability))

    def update(self, estimate: Estimate, scan: Scan) -> Estimate:
        """See ``Tracker``; the returns of a target one after another."""
        after = ImmMemory(*(array.copy() for array in estimate.memory))
        rows = np.arange(len(scan.z))
        for i in range(scan.z.shape[1]):
            at = rows[scan.present[:, i]], scan.target[scan.present[:, i], i]
            x, P, mu = (array[at] for array in after)
            z, R = scan.z[at[0], i, None], scan.R[at[0], i, None]
            innovation = z - scan.model.measure(x)
            after.mean[at], after.covariance[at], log_likelihood = kernels.kalman_update(
                x, P, innovation, scan.model.jacobian(x), R
            )
            after.probability[at] = kernels.reweigh(mu, log_likelihood)
        return self._combined(after)

    def _combined(self, memory: ImmMemory) -> Estimate:
        """The mixture of the models, and the process noise of the next step."""
        mean, covariance = kernels.combine(*memory)
        ahead = (memory.probability[..., None] * self.transition).sum(axis=-2)
        noise = (ahead[..., None, None] * self._motion[1]).sum(axis=-3)
        return Estimate(mean, covariance, memory, noise)
