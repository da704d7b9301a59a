"""What a tracker of your own has to offer, for every system that takes one (``tracker=``).

A ``Tracker`` works on all targets of all environments at once. A ``TargetFilter`` works on one target, as the filters
of other packages do; ``OneByOne`` makes a tracker of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.loading import load_object
from wavegym.targets.motion import MotionModel
from wavegym.trackers.kalman import predict, update

UNKNOWN = -1  # ``Scan.target`` of a return of unknown origin


class Estimate(NamedTuple):
    """Means and covariances of the states of all targets."""

    mean: Array  # (env, target, n)
    covariance: Array  # (env, target, n, n)


class MeasurementModel(NamedTuple):
    """How a sensor sees a state: pure functions of arrays with any leading axes."""

    measure: Callable[[Array], Array]  # states (..., n) to measurements without error (..., m)
    jacobian: Callable[[Array], Array]  # states (..., n) to the derivatives of the measurements, (..., m, n)


class Scan(NamedTuple):
    """What one sensor reports in one step, and what a tracker may assume of it.

    Where origins are unknown, some returns are clutter, a target is detected with the probability ``detection``, and
    the tracker associates returns with targets. Its gates are its own business. ``detection`` is 0 for a target that
    the sensor does not illuminate: its estimate stays as predicted.
    """

    z: Array  # (env, return, m)
    present: Array  # (env, return) bool: False where a target was not detected
    target: Array  # (env, return) int: the target that a return comes from; UNKNOWN (-1) where nobody knows
    R: Array  # (env, return, m, m) covariance of the error as the tracker assumes it
    model: MeasurementModel
    detection: Array | None = None  # (env, target) probability of detection at the predicted range; None: origins known
    noise: Array | None = None  # (env, target, m, m) covariance of the error at the predicted range, likewise
    clutter_density: float = 0.0  # expected false returns per unit volume of the measurements


@runtime_checkable
class Tracker(Protocol):
    """All targets of all environments."""

    def predict(self, estimate: Estimate, motion: MotionModel) -> Estimate:
        """The estimate one step later, before any measurement."""

    def update(self, estimate: Estimate, scan: Scan) -> Estimate:
        """The estimate with the returns of one sensor."""


class TargetFilter(Protocol):
    """One target: mean x (n,), covariance P (n, n)."""

    def predict(self, x: Array, P: Array, motion: MotionModel) -> tuple[Array, Array]:
        """Mean and covariance one step later."""

    def update(self, x: Array, P: Array, z: Array, R: Array, model: MeasurementModel) -> tuple[Array, Array]:
        """Mean and covariance with a measurement z (m,) of covariance R (m, m)."""


@dataclass(frozen=True)
class OneByOne:
    """A tracker that runs a filter for each target of each environment."""

    filter: TargetFilter

    def predict(self, estimate: Estimate, motion: MotionModel) -> Estimate:
        """See ``Tracker``."""
        after = _copied(estimate)
        for at in np.ndindex(*estimate.mean.shape[:2]):
            after.mean[at], after.covariance[at] = self.filter.predict(
                estimate.mean[at].copy(), estimate.covariance[at].copy(), motion
            )
        return after

    def update(self, estimate: Estimate, scan: Scan) -> Estimate:
        """See ``Tracker``; the returns of a target one after another."""
        _check_origins(scan)
        after = _copied(estimate)
        for e, i in np.argwhere(scan.present).tolist():
            at = e, scan.target[e, i]
            after.mean[at], after.covariance[at] = self.filter.update(
                after.mean[at].copy(), after.covariance[at].copy(), scan.z[e, i], scan.R[e, i], scan.model
            )
        return after


class ExtendedKalman:
    """The extended Kalman filter of all targets at once; for a linear sensor, the Kalman filter."""

    def predict(self, estimate: Estimate, motion: MotionModel) -> Estimate:
        """See ``Tracker``."""
        return Estimate(*predict(*estimate, motion.F, motion.Q))

    def update(self, estimate: Estimate, scan: Scan) -> Estimate:
        """See ``Tracker``; the returns of a target one after another."""
        _check_origins(scan)
        after, rows = _copied(estimate), np.arange(len(scan.z))
        for i in range(scan.z.shape[1]):
            target, present = scan.target[:, i], scan.present[:, i]
            x, P = after.mean[rows, target], after.covariance[rows, target]
            mean, covariance = update(x, P, scan.z[:, i] - scan.model.measure(x), scan.model.jacobian(x), scan.R[:, i])
            after.mean[rows, target] = np.where(present[:, None], mean, x)
            after.covariance[rows, target] = np.where(present[:, None, None], covariance, P)
        return after


def _check_origins(scan: Scan) -> None:
    """InputError for returns of unknown origin."""
    if (scan.target == UNKNOWN).any():
        wanted = "known origins, or a tracker that associates returns with targets (as jpda_update does)"
        raise InputError(f"target of a return is {UNKNOWN}, its origin is unknown, expected {wanted}")


def _copied(estimate: Estimate) -> Estimate:
    return Estimate(np.array(estimate.mean, np.float64), np.array(estimate.covariance, np.float64))


def make_tracker(tracker: object) -> Tracker:
    """``tracker`` itself, or what a function or class at ``"package.module:name"`` makes.

    Raises:
        InputError: nothing that predicts and updates, or nothing at that place.
    """
    made = load_object("tracker", tracker)() if isinstance(tracker, str) else tracker
    if isinstance(made, type) or not isinstance(made, Tracker):
        wanted = "an object with predict(estimate, motion) and update(estimate, scan)"
        raise InputError(f"tracker is {tracker!r}, expected {wanted} (nearest: OneByOne(filter))")
    return made
