"""The Kalman filter and the extended Kalman filter (EKF) for any number of tracks at once.

All functions take arrays with any leading axes (environments, targets, candidates), which broadcast as in NumPy. All
tracks share a model matrix without leading axes. The EKF has the same update, with the innovation z - h(x) and the
Jacobian H of h at the predicted mean. Its covariance prediction is the same with the Jacobian of the motion. See
``ekf_predict`` and ``ekf_update``.

References: Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), sections 5.2
and 10.3.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import FloatArray, check_finite
from wavegym.core.covariances import check_covariance, check_positive_definite
from wavegym.core.errors import InputError
from wavegym.trackers import kernels
from wavegym.trackers.kernels import rank_one_update

Function = Callable[[FloatArray], FloatArray]


def predict(mean: ArrayLike, covariance: ArrayLike, F: ArrayLike, Q: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Time update of a linear model: F x and F P F' + Q.

    Args:
        mean: x, (..., n).
        covariance: P, (..., n, n).
        F: transition matrix, (..., n, n).
        Q: process noise covariance, (..., n, n).

    Returns:
        The predicted mean (..., n) and covariance (..., n, n).

    Raises:
        InputError: shapes that do not fit, numbers that are not finite, or a P or Q that is not symmetric positive
            semidefinite.
    """
    check_covariance("P", covariance)
    check_covariance("Q", Q)
    x, P = kernels.predict(mean, covariance, F, Q)
    _check_result(x, mean=mean, F=F)
    return x, P


def predict_covariance(covariance: ArrayLike, F: ArrayLike, Q: ArrayLike) -> FloatArray:
    """F P F' + Q, (..., n, n): the covariance recursion alone, for planners. Raises as ``predict`` does."""
    check_covariance("P", covariance)
    check_covariance("Q", Q)
    P = kernels.predict_covariance(covariance, F, Q)
    _check_result(P, F=F)
    return P


def update(
    mean: ArrayLike, covariance: ArrayLike, innovation: ArrayLike, H: ArrayLike, R: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Measurement update: x + K y and P - K S K' with S = H P H' + R, K = P H' S^-1.

    Args:
        mean: predicted x, (..., n).
        covariance: predicted P, (..., n, n).
        innovation: y = z - H x (EKF: z - h(x), angles wrapped by the caller), (..., m).
        H: measurement matrix or Jacobian, (..., m, n).
        R: measurement noise covariance, (..., m, m).

    Returns:
        The updated mean (..., n) and the exactly symmetric covariance (..., n, n).

    Raises:
        InputError: an invalid shape or value, or a singular innovation covariance S.
    """
    check_covariance("P", covariance)
    check_covariance("R", R)
    x, P = kernels.update(mean, covariance, innovation, H, R)
    _check_updated(P, covariance, H, R)
    _check_result(x, mean=mean, innovation=innovation)
    return x, P


def update_covariance(covariance: ArrayLike, H: ArrayLike, R: ArrayLike) -> FloatArray:
    """P - K S K', (..., n, n): the covariance recursion alone. Raises as ``update`` does."""
    check_covariance("P", covariance)
    check_covariance("R", R)
    P = kernels.update_covariance(covariance, H, R)
    _check_updated(P, covariance, H, R)
    return P


def scalar_updates(
    mean: ArrayLike, covariance: ArrayLike, innovation: ArrayLike, H: ArrayLike, variance: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """``update`` for a diagonal R, one scalar at a time: P' = [P^-1 + H' R^-1 H]^-1, x' = x + P' H' R^-1 y.

    One rank-one update for each row of H. The result does not depend on the order of the rows, and no matrix is
    inverted. The EKF of O'Rourke and Swindlehurst, eqs. (10) and (11), has the same information form.

    Args:
        mean: predicted x, (..., n).
        covariance: predicted P, (..., n, n).
        innovation: y = z - h(x), (..., m).
        H: measurement matrix or Jacobian, (..., m, n).
        variance: diagonal of R, (..., m); inf for a missing measurement, whose innovation and row are not used.

    Returns:
        The updated mean (..., n) and the exactly symmetric covariance (..., n, n).

    Raises:
        InputError: an invalid shape or value.
    """
    errors = np.atleast_1d(np.asarray(variance, dtype=np.float64))
    if not (errors > 0.0).all():
        raise InputError(f"variance is {errors[~(errors > 0.0)][0]}, expected numbers > 0, or inf where missing")
    check_covariance("P", covariance)
    x, P = rank_one_update(mean, covariance, innovation, H, errors)
    used = np.isfinite(errors)
    _check_updated(P, covariance, H, np.where(used, errors, 0.0)[..., None] * np.eye(errors.shape[-1]))
    if not np.isfinite(x).all():
        _check_result(x, mean=mean, innovation=np.where(used, innovation, 0.0))
    return x, P


def ekf_predict(
    mean: FloatArray, covariance: ArrayLike, f: Function, jacobian: Function, Q: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Time update of a nonlinear model: f(x) and F P F' + Q with F = jacobian(x), (..., n, n).

    Raises:
        InputError: as ``predict``, with the results of ``f`` and ``jacobian`` in place of F x and F.
    """
    P = predict_covariance(covariance, jacobian(mean), Q)
    return check_finite("f(mean)", f(mean), P.shape[-1]), P


def ekf_update(
    mean: FloatArray, covariance: ArrayLike, measurement: FloatArray, h: Function, jacobian: Function, R: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Measurement update linearised at the predicted mean: innovation z - h(x), H = jacobian(x), (..., m, n).

    Raises:
        InputError: as ``update``.
    """
    return update(mean, covariance, measurement - h(mean), jacobian(mean), R)


def nees(error: ArrayLike, covariance: ArrayLike) -> FloatArray:
    """Normalised estimation error squared e' P^-1 e, (...): chi-square with n degrees of freedom when consistent.

    Raises:
        InputError: shapes that do not fit, numbers that are not finite, or a P that is not symmetric positive definite.
    """
    check_positive_definite("covariance", covariance)
    values = kernels.squared_mahalanobis(error, covariance)
    _check_result(values, error=error)
    return values


def _check_result(result: FloatArray, **given: ArrayLike) -> None:
    """Raise an InputError for the first of the arguments ``given`` that is not finite, if it shows in the result."""
    if not np.isfinite(result).all():
        for name, values in given.items():
            check_finite(name, values)
        raise InputError("the result overflows, expected smaller numbers: the greatest is below 1e308")


def _check_updated(updated: FloatArray, covariance: ArrayLike, H: ArrayLike, R: ArrayLike) -> None:
    """Raise an InputError for the first track whose updated variance is negative or NaN.

    With valid P and R, such a variance reveals an H that is not finite, a singular S, or a loss of all digits.
    """
    n = updated.shape[-1]
    variances = updated.reshape(-1, n * n)[:, :: n + 1]
    if not variances.size or variances.min() >= 0.0:
        return
    check_finite("H", H)
    lead = updated.shape[:-2]
    index = tuple(int(i) for i in np.argwhere(~(np.diagonal(updated, 0, -2, -1) >= 0.0).all(-1))[0])
    p, h, r = (np.broadcast_to(np.asarray(a), lead + np.shape(a)[-2:])[index] for a in (covariance, H, R))
    where = f" of track {index}" if index else ""
    check_positive_definite(f"the innovation covariance H P H' + R{where}", h @ p @ h.T + r)
    raise InputError(f"the update{where} left a negative variance, expected a better conditioned P and R")
