"""Interacting multiple models: a filter for each way a target may move, and how likely each is.

Every function takes arrays with any leading axes; the state begins with x, y, xdot, ydot and may go on with components,
such as accelerations, that a measurement says nothing of.

References: Blom and Bar-Shalom, *The interacting multiple model algorithm* (1988); Kirubarajan, Bar-Shalom, Pattipati,
Kadar, *Ground target tracking with variable structure IMM estimator* (2000); Julier and Uhlmann (1997), the unscented
transform with kappa = 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_each, check_last_axes, checked_copy, flatten_lead
from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError
from wavegym.trackers import imm_kernels as kernels
from wavegym.trackers.checks import check_distribution
from wavegym.trackers.kalman import check_positive_definite


def ukf_update(
    mean: ArrayLike,
    covariance: ArrayLike,
    measurement: ArrayLike,
    R: ArrayLike,
    transmitter: ArrayLike,
    receiver: ArrayLike,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Unscented Kalman update by range and range-rate from a transmitter by the target to a receiver.

    Args:
        mean: predicted x, (..., n).
        covariance: predicted P, (..., n, n).
        measurement: z = (r in m, rdot in m/s), half the way and its rate, (..., 2).
        R: its error covariance, (..., 2, 2).
        transmitter, receiver: (x, y) in m, (..., 2); the same twice is an ordinary radar.

    Returns:
        The updated mean (..., n) and covariance (..., n, n), and the log likelihood of z (...).

    Raises:
        InputError: shapes that do not fit, a P or R that is not positive definite.
    """
    _moves("mean", np.shape(mean)[-1:])
    check_positive_definite("covariance", covariance)
    check_positive_definite("R", R)
    transmitter, receiver = check_last_axes("transmitter", transmitter, 2), check_last_axes("receiver", receiver, 2)
    x, P, log_likelihood = kernels.ukf_update(mean, covariance, measurement, R, transmitter, receiver)
    return x, P, log_likelihood


def imm_mix(
    mean: ArrayLike, covariance: ArrayLike, probability: ArrayLike, transition: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What each model's filter begins the next step with: the mixture of all, weighted by how a target gets there.

    Args:
        mean: x of each model, (..., models, n).
        covariance: P of each model, (..., models, n, n).
        probability: mu of each model, (..., models).
        transition: of a target's model from one step to the next, row = from, (..., models, models).

    Returns:
        Mixed means and covariances, shaped as given, and predicted model probabilities; a model that cannot be entered
        has probability 0 and keeps its own mean and covariance.

    Raises:
        InputError: shapes that do not fit, a ``probability`` or rows of ``transition`` that are no probabilities.
    """
    mu = np.asarray(probability, np.float64)
    check_each("probability", mu, (mu >= 0.0) & (mu <= 1.0), "probabilities")
    return kernels.mix(mean, covariance, probability, _stochastic("transition", transition))


def imm_combine(mean: ArrayLike, covariance: ArrayLike, probability: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Mean (..., n) and covariance (..., n, n) of the mixture of models; arguments as for ``imm_mix``."""
    return kernels.combine(mean, covariance, probability)


def imm_reweigh(predicted: ArrayLike, log_likelihood: ArrayLike) -> FloatArray:
    """Model probabilities after a measurement, (..., models), from predicted ones and log likelihoods.

    Likelihoods are compared before they are exponentiated: of a measurement that no model explains, such as one a
    million metres off, the one that explains it least badly becomes certain, and none is lost. Of one that is
    impossible to all, log likelihood -inf, nothing is learned.
    """
    log = np.asarray(log_likelihood, np.float64)
    return kernels.reweigh(predicted, np.where((log == -np.inf).all(axis=-1, keepdims=True), 0.0, log))


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
    """One step of an IMM of unscented Kalman filters with linear motion: mix, predict, update, reweigh; fused.

    Args:
        mean, covariance, probability: as for ``imm_mix``, with any leading axes, of which there is one for tracks.
        measurement, R: one for each track, (..., 2) and (..., 2, 2).
        transmitter, receiver: (x, y) in m, (2,).
        F, Q: transition matrix and process noise of each model, (models, n, n).
        transition: (models, models), row = from.

    Returns:
        Updated means, covariances and model probabilities, shaped as given.

    Raises:
        InputError: shapes that do not fit, fewer than four components, rows of ``transition_matrix`` that are no
            probabilities.
    """
    F = np.array(check_last_axes("F", F), np.float64, order="C")
    if F.ndim != 3 or F.shape[1] != F.shape[2]:
        raise InputError(f"F has shape {F.shape}, expected (models, n, n)")
    M, n = F.shape[:2]
    _moves("F", (n,))
    outcome_shape = np.array(
        check_last_axes("transition", _stochastic("transition", transition), M, M), order="C"
    ).reshape(1, M, M)
    x = check_last_axes("mean", mean, M, n)
    lead = x.shape[:-2]
    P, mu = check_last_axes("covariance", covariance, M, n, n), check_last_axes("probability", probability, M)
    z, errors, noise = (
        check_last_axes("measurement", measurement, 2),
        check_last_axes("R", R, 2, 2),
        checked_copy("Q", Q, M, n, n),
    )
    try:
        x, P, mu = flatten_lead(x, lead, M, n), flatten_lead(P, lead, M, n, n), flatten_lead(mu, lead, M)
        z, errors = flatten_lead(z, lead, 2), flatten_lead(errors, lead, 2, 2)
    except ValueError:
        raise InputError(
            f"covariance, probability, measurement and R have shapes {np.shape(covariance)}, {np.shape(probability)}, "
            f"{np.shape(measurement)} and {np.shape(R)}, expected leading axes that broadcast to the mean's, {lead}"
        ) from None
    places = checked_copy("transmitter", transmitter, 2), checked_copy("receiver", receiver, 2)
    kernels.scan(x, P, mu, z, errors, *places, F, noise, outcome_shape, (0,) * n, (0,) * M)
    return x.reshape(*lead, M, n), P.reshape(*lead, M, n, n), mu.reshape(*lead, M)


def variable_structure(transition: ArrayLike, active: ArrayLike) -> FloatArray:
    """Transition probabilities where only some models are possible: the others' columns are 0, rows sum to 1.

    Args:
        transition: between all models, row = from, (models, models).
        active: whether each model is possible now, (..., models).

    Returns:
        (..., models, models). What a target did before may be impossible now: its row leads into possible models.

    Raises:
        InputError: rows that are no probabilities, no active model, a model from which no active one can be reached.
    """
    outcome_shape, possible = _stochastic("transition", transition), np.asarray(active, np.bool_)
    if possible.shape[-1:] != outcome_shape.shape[-1:]:
        raise InputError(f"active has shape {possible.shape}, expected (..., {outcome_shape.shape[-1]})")
    left = np.where(possible[..., None, :], outcome_shape, 0.0)
    total = left.sum(axis=-1, keepdims=True)
    if not (total > 0.0).all():
        at = np.argwhere(~(total[..., 0] > 0.0))[0]
        raise InputError(
            f"from model {at[-1]} no active one of {possible[tuple(at[:-1])].tolist()} can be reached, expected a row"
            " of transition with a probability > 0 for one of them"
        )
    return np.asarray(left / total)


def _moves(name: str, size: tuple[int, ...]) -> None:
    """InputError for a state that does not begin with x, y, xdot, ydot."""
    if size and size[0] < 4:
        raise InputError(f"{name} has {size[0]} components, expected at least 4: x, y, xdot, ydot")


def _stochastic(name: str, transition: ArrayLike) -> FloatArray:
    """``transition_matrix`` as an array whose rows are probabilities; otherwise InputError."""
    outcome_shape = np.asarray(transition, np.float64)
    if outcome_shape.ndim < 2 or outcome_shape.shape[-1] != outcome_shape.shape[-2]:
        raise InputError(f"{name} has shape {outcome_shape.shape}, expected (..., models, models)")
    check_distribution(name, outcome_shape, "a row of ")
    return outcome_shape
