"""Interacting multiple models (IMM): one filter and one probability for each motion model of a target.

All functions take arrays with any leading axes. Their state begins with x, y, xdot, ydot. Further components, such as
accelerations, are not measured directly. ``ImmKalman`` is a tracker of systems, of states of any kind.

References: Blom and Bar-Shalom, *The interacting multiple model algorithm* (1988); Kirubarajan, Bar-Shalom, Pattipati,
Kadar, *Ground target tracking with variable structure IMM estimator* (2000); Julier and Uhlmann (1997), the unscented
transform with kappa = 0; Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001),
section 11.6.6.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import Array, FloatArray, check_each, check_finite, check_last_axes, checked_copy, flatten_lead
from wavegym.core.covariances import check_covariance, check_positive_definite
from wavegym.core.errors import InputError, check_within
from wavegym.targets.motion import MotionModel
from wavegym.trackers import imm_kernels as kernels
from wavegym.trackers.association import check_distribution
from wavegym.trackers.kalman import predict
from wavegym.trackers.protocol import Estimate, Scan


def ukf_update(
    mean: ArrayLike,
    covariance: ArrayLike,
    measurement: ArrayLike,
    R: ArrayLike,
    transmitter: ArrayLike,
    receiver: ArrayLike,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Unscented Kalman update by the bistatic range and range-rate of a target.

    Args:
        mean: predicted x, (..., n).
        covariance: predicted P, (..., n, n).
        measurement: z = (r in m, rdot in m/s): half the path transmitter, target, receiver, and its rate, (..., 2).
        R: its error covariance, (..., 2, 2).
        transmitter, receiver: (x, y) in m, (..., 2); equal positions are a monostatic radar.

    Returns:
        The updated mean (..., n) and covariance (..., n, n), and the log likelihood of z (...).

    Raises:
        InputError: shapes that do not fit, numbers that are not finite, or a P or R that is not symmetric positive
            definite.
    """
    _check_state_size("mean", np.shape(mean)[-1:])
    x, z = check_finite("mean", mean), check_finite("measurement", measurement, 2)
    P, errors = check_positive_definite("covariance", covariance), check_positive_definite("R", R)
    places = check_finite("transmitter", transmitter, 2), check_finite("receiver", receiver, 2)
    x, P, log_likelihood = kernels.ukf_update(x, P, z, errors, *places)
    return x, P, log_likelihood


def imm_mix(
    mean: ArrayLike, covariance: ArrayLike, probability: ArrayLike, transition: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mix the models: each model's filter starts the next step from the mixture of all models that lead to it.

    Args:
        mean: x of each model, (..., models, n).
        covariance: P of each model, (..., models, n, n).
        probability: mu of each model, (..., models).
        transition: probability that the model of row i changes to that of column j, (..., models, models).

    Returns:
        Mixed means and covariances in the given shapes, and predicted model probabilities. A model with predicted
        probability 0 keeps its own mean and covariance.

    Raises:
        InputError: an invalid shape or value.
    """
    return kernels.mix(*_check_models(mean, covariance, probability), _check_transition("transition", transition))


def imm_combine(mean: ArrayLike, covariance: ArrayLike, probability: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Mean (..., n) and covariance (..., n, n) of the mixture of models; arguments and errors as for ``imm_mix``."""
    return kernels.combine(*_check_models(mean, covariance, probability))


def imm_reweigh(predicted: ArrayLike, log_likelihood: ArrayLike) -> FloatArray:
    """Model probabilities after a measurement, (..., models), from predicted probabilities and log likelihoods.

    The greatest log likelihood is subtracted before the exponential. An outlier a million metres away therefore leaves
    valid probabilities: the best model becomes certain. A measurement with log likelihood -inf under all models leaves
    the predicted probabilities as they are.

    Raises:
        InputError: shapes that do not fit, ``predicted`` that is no distribution, or a log likelihood that is NaN or
            +inf.
    """
    log = np.asarray(log_likelihood, np.float64)
    check_each("log_likelihood", log, log < np.inf, "numbers below inf")  # NaN is not below
    mu = np.asarray(predicted, np.float64)
    check_distribution("predicted", mu)
    return kernels.reweigh(mu, np.where((log == -np.inf).all(axis=-1, keepdims=True), 0.0, log))


def imm_ukf_scan(
    mean: ArrayLike,
    covariance: ArrayLike,
    probability: ArrayLike,
    measurement: ArrayLike,
    R: ArrayLike,
    transmitter: ArrayLike,
    receiver: ArrayLike,
    F: ArrayLike,
    Q: ArrayLike,
    transition: ArrayLike,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One step of an IMM of unscented Kalman filters with linear motion: mix, predict, update and reweigh in one pass.

    Args:
        mean, covariance, probability: as for ``imm_mix``, with any leading axes, such as one for tracks.
        measurement, R: one measurement for each track, (..., 2) and (..., 2, 2).
        transmitter, receiver: (x, y) in m, (2,).
        F, Q: transition matrix and process noise of each model, (models, n, n).
        transition: as for ``imm_mix``, (models, models).

    Returns:
        Updated means, covariances and model probabilities in the given shapes.

    Raises:
        InputError: an invalid shape or value.
    """
    F = np.array(check_finite("F", F), np.float64, order="C")
    if F.ndim != 3 or F.shape[1] != F.shape[2]:
        raise InputError(f"F has shape {F.shape}, expected (models, n, n)")
    M, n = F.shape[:2]
    _check_state_size("F", (n,))
    changes = check_last_axes("transition", _check_transition("transition", transition), M, M)
    changes = np.array(changes, order="C").reshape(1, M, M)
    x = check_finite("mean", mean, M, n)
    lead = x.shape[:-2]
    P, mu = check_last_axes("covariance", covariance, M, n, n), check_last_axes("probability", probability, M)
    check_covariance("covariance", P)
    check_distribution("probability", mu)
    z, errors = check_finite("measurement", measurement, 2), check_last_axes("R", R, 2, 2)
    check_positive_definite("R", errors)
    noise = checked_copy("Q", Q, M, n, n)
    check_covariance("Q", noise)
    try:
        x, P, mu = flatten_lead(x, lead, M, n), flatten_lead(P, lead, M, n, n), flatten_lead(mu, lead, M)
        z, errors = flatten_lead(z, lead, 2), flatten_lead(errors, lead, 2, 2)
    except ValueError:
        raise InputError(
            f"covariance, probability, measurement and R have shapes {np.shape(covariance)}, {np.shape(probability)}, "
            f"{np.shape(measurement)} and {np.shape(R)}, expected leading axes that broadcast to the mean's, {lead}"
        ) from None
    places = checked_copy("transmitter", transmitter, 2), checked_copy("receiver", receiver, 2)
    check_finite("transmitter and receiver", places)
    kernels.scan(x, P, mu, z, errors, *places, F, noise, changes, (0,) * n, (0,) * M)
    if not (np.isfinite(mu).all() and np.isfinite(P).all()):
        raise InputError("F P F' + Q of a model has no Cholesky factor, expected a Q with variance in every component")
    return x.reshape(*lead, M, n), P.reshape(*lead, M, n, n), mu.reshape(*lead, M)


def variable_structure(transition: ArrayLike, active: ArrayLike) -> FloatArray:
    """Transition probabilities restricted to the active models: other columns are 0, rows sum to 1.

    Args:
        transition: probabilities between all models, from row to column, (models, models).
        active: whether each model is possible now, (..., models).

    Returns:
        (..., models, models). The row of an inactive model also leads to active models only.

    Raises:
        InputError: a row without probabilities, no active model, or a model that leads to no active model.
    """
    changes, possible = _check_transition("transition", transition), np.asarray(active, np.bool_)
    if possible.shape[-1:] != changes.shape[-1:]:
        raise InputError(f"active has shape {possible.shape}, expected (..., {changes.shape[-1]})")
    left = np.where(possible[..., None, :], changes, 0.0)
    total = left.sum(axis=-1, keepdims=True)
    if not (total > 0.0).all():
        at = np.argwhere(~(total[..., 0] > 0.0))[0]
        raise InputError(
            f"row {at[-1]} of transition leads to no active model of {possible[tuple(at[:-1])].tolist()}, expected a"
            " probability > 0 for at least one"
        )
    return np.asarray(left / total)


def _check_models(
    mean: ArrayLike, covariance: ArrayLike, probability: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean, covariance and probability of the models as arrays of valid values; otherwise raise."""
    x, P, mu = check_finite("mean", mean), check_covariance("covariance", covariance), np.asarray(probability, float)
    check_distribution("probability", mu)
    return x, P, mu


def _check_state_size(name: str, size: tuple[int, ...]) -> None:
    """Raise an InputError for a state of fewer than four components."""
    if size and size[0] < 4:
        raise InputError(f"{name} has {size[0]} components, expected at least 4: x, y, xdot, ydot")


def _check_transition(name: str, transition: ArrayLike) -> FloatArray:
    """Return ``transition`` as an array whose rows are probabilities; otherwise raise an InputError."""
    changes = np.asarray(transition, np.float64)
    if changes.ndim < 2 or changes.shape[-1] != changes.shape[-2]:
        raise InputError(f"{name} has shape {changes.shape}, expected (..., models, models)")
    check_distribution(name, changes, "a row of ")
    return changes


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
