"""The methods that your own tracker needs, in every system that takes one (``tracker=``).

A ``Tracker`` works on all targets of all environments at once. A ``TargetFilter`` works on one target, as the filters
of other packages do; ``OneByOne`` makes a tracker of it. A ``TrackerWithMemory`` keeps more than a mean and a
covariance, such as the models of an IMM, the hypotheses of an MHT or particles.

``motion.Q`` is (n, n) if all targets have the same process noise, otherwise (env, target, n, n). ``OneByOne`` gives
each filter the model of its target, with a Q of (n, n).
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from wavegym.core.arrays import Array, check_finite, check_shape
from wavegym.core.errors import InputError, check_choice
from wavegym.core.registry import load_object
from wavegym.targets.motion import MotionModel
from wavegym.trackers.kalman import predict, update

UNKNOWN = -1  # ``Scan.target`` of a return of unknown origin


class Estimate(NamedTuple):
    """Means and covariances of the states of all targets, and an adaptive tracker's memory and process noise."""

    mean: Array  # (env, target, n)
    covariance: Array  # (env, target, n, n)
    memory: Any = None  # a NamedTuple of arrays with axis 0 = environment, of the tracker's own; a system carries it
    # (env, target, n, n) of the next step as the tracker believes it, for schedulers; None: the motion model's Q
    process_noise: Array | None = None


class MeasurementModel(NamedTuple):
    """How a sensor sees a state: pure functions of arrays with any leading axes."""

    measure: Callable[[Array], Array]  # states (..., n) to measurements without error (..., m)
    jacobian: Callable[[Array], Array]  # states (..., n) to the derivatives of the measurements, (..., m, n)


class Scan(NamedTuple):
    """What one sensor reports in one step, and what a tracker may assume about it.

    If origins are unknown, some returns are clutter, a target is detected with the probability ``detection``, and
    the tracker associates returns with targets. It chooses its own gates. ``detection`` is 0 for a target that
    the sensor does not illuminate: its estimate stays as predicted.
    """

    z: Array  # (env, return, m)
    present: Array  # (env, return) bool: False where a target was not detected
    target: Array  # (env, return) int: the target that a return comes from; UNKNOWN (-1) if the origin is unknown
    R: Array  # (env, return, m, m) covariance of the error as the tracker assumes it
    model: MeasurementModel
    detection: Array | None = None  # (env, target) probability of detection at the predicted range; None: origins known
    noise: Array | None = None  # (env, target, m, m) covariance of the error at the predicted range, likewise
    clutter_density: Array | float = 0.0  # (env,) expected false returns per unit volume of the measurements


@runtime_checkable
class Tracker(Protocol):
    """All targets of all environments."""

    def predict(self, estimate: Estimate, motion: MotionModel) -> Estimate:
        """The estimate one step later, before any measurement."""

    def update(self, estimate: Estimate, scan: Scan) -> Estimate:
        """The estimate with the returns of one sensor."""


@runtime_checkable
class TrackerWithMemory(Tracker, Protocol):
    """A tracker whose estimates have a memory, a process noise, or both.

    A random number of such a tracker comes by counter (``wavegym.core.counter_rng_kernels``) from a key in the memory,
    which ``begin`` makes of the bits of the first mean: no other number is drawn for one world alone.
    """

    def begin(self, estimate: Estimate, motion: MotionModel) -> Estimate:
        """The first estimate, with its memory and process noise."""


class TargetFilter(Protocol):
    """One target: mean x (n,), covariance P (n, n)."""

    def predict(self, x: Array, P: Array, motion: MotionModel) -> tuple[Array, Array]:
        """Mean and covariance one step later."""

    def update(self, x: Array, P: Array, z: Array, R: Array, model: MeasurementModel) -> tuple[Array, Array]:
        """Mean and covariance with a measurement z (m,) of covariance R (m, m)."""


@dataclass(frozen=True)
class OneByOne:
    """A tracker that runs a filter for each target of each environment.

    Raises:
        InputError: a filter without the two methods of ``TargetFilter``, or one that returns other shapes.
    """

    filter: TargetFilter

    def __post_init__(self) -> None:
        if not _has_methods(self.filter, predict=3, update=5):
            wanted = "an object with predict(x, P, motion) and update(x, P, z, R, model)"
            raise InputError(f"filter is {self.filter!r}, expected {wanted}")

    def predict(self, estimate: Estimate, motion: MotionModel) -> Estimate:
        """See ``Tracker``."""
        after = _copied(estimate)
        for at in np.ndindex(*estimate.mean.shape[:2]):
            own = motion if motion.Q.ndim == 2 else replace(motion, Q=motion.Q[at])
            found = self.filter.predict(estimate.mean[at].copy(), estimate.covariance[at].copy(), own)
            self._put(after, at, found)
        return after

    def update(self, estimate: Estimate, scan: Scan) -> Estimate:
        """See ``Tracker``; the returns of a target one after another."""
        _check_origins(scan)
        after = _copied(estimate)
        for e, i in np.argwhere(scan.present).tolist():
            at = e, scan.target[e, i]
            x, P = after.mean[at].copy(), after.covariance[at].copy()
            self._put(after, at, self.filter.update(x, P, scan.z[e, i], scan.R[e, i], scan.model))
        return after

    def _put(self, after: Estimate, at: tuple[int, ...], found: Any) -> None:
        """Enter what the filter has ``found`` for a target: NumPy alone would broadcast other shapes."""
        shapes = tuple(map(np.shape, found)) if isinstance(found, tuple) else np.shape(found)
        wanted = after.mean.shape[2:], after.covariance.shape[2:]
        if shapes != wanted:
            raise InputError(f"{type(self.filter).__name__} returned shapes {shapes}, expected x, P of {wanted}")
        after.mean[at], after.covariance[at] = found


class ExtendedKalman:
    """The extended Kalman filter of all targets at once; for a linear sensor, the Kalman filter."""

    def predict(self, estimate: Estimate, motion: MotionModel) -> Estimate:
        """See ``Tracker``."""
        mean, covariance = predict(estimate.mean, estimate.covariance, motion.F, motion.Q)
        return estimate._replace(mean=mean, covariance=covariance)

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
    mean, covariance = (np.array(array, np.float64) for array in estimate[:2])
    return estimate._replace(mean=mean, covariance=covariance)


def begin_track(tracker: Tracker, estimate: Estimate, motion: MotionModel) -> Estimate:
    """The first estimate, with the memory and process noise of a ``TrackerWithMemory``.

    Raises:
        InputError: no estimate of these targets, or a memory that is no NamedTuple of arrays with axis 0 = environment.
    """
    if not isinstance(tracker, TrackerWithMemory):
        return estimate
    first = tracker.begin(estimate, motion)
    _check_estimate(tracker, estimate, first)
    return first


def track(tracker: Tracker, estimate: Estimate, motion: MotionModel, *scans: Scan) -> Estimate:
    """The estimate one step later, with one scan after another.

    Raises:
        InputError: see ``check_kept``.
    """
    after = check_kept(tracker, estimate, tracker.predict(estimate, motion))
    for scan in scans:
        after = check_kept(tracker, after, tracker.update(after, scan))
    return after


def check_kept(tracker: Tracker, before: Estimate, after: Estimate) -> Estimate:
    """``after``, which a method of the tracker returned for the estimate ``before``.

    Raises:
        InputError: no estimate of the same targets in finite numbers, or one that has lost its memory or its process
            noise, or has made one in play.
    """
    _check_estimate(tracker, before, after)
    for field in ("memory", "process_noise"):
        if (getattr(after, field) is None) != (getattr(before, field) is None):
            wanted = f"an estimate with {field} as begin() returns it (nearest: estimate._replace(...))"
            raise InputError(
                f"{field} of {type(tracker).__name__} is {_brief(getattr(after, field))}, expected {wanted}"
            )
    return after


def of_targets(chosen: Array, one: Estimate, other: Estimate) -> Estimate:
    """``one`` with the means and covariances of ``other`` for all targets but those ``chosen`` (env, target)."""
    return one._replace(
        mean=np.where(chosen[..., None], one.mean, other.mean),
        covariance=np.where(chosen[..., None, None], one.covariance, other.covariance),
    )


def _check_estimate(tracker: Tracker, before: Estimate, after: Any) -> None:
    """InputError unless ``after`` is an estimate of the targets of ``before``, in finite numbers."""
    name = type(tracker).__name__
    if not isinstance(after, Estimate):
        wanted = "an Estimate (nearest: estimate._replace(...))"
        raise InputError(f"estimate of {name} is {_brief(after)}, expected {wanted}")
    shapes = {"mean": before.mean.shape, "covariance": before.covariance.shape}
    if after.process_noise is not None:
        shapes["process_noise"] = before.covariance.shape
    for field, shape in shapes.items():
        found = np.asarray(getattr(after, field))
        check_shape(f"{name}: {field}", found, shape)
        check_finite(f"{name}: {field}", found)
    for leaf in _leaves("memory", after.memory):
        if np.shape(leaf)[:1] != shapes["mean"][:1]:
            wanted = f"axis 0 = environment: ({len(before.mean)}, ...)"
            raise InputError(f"memory of {name} has shape {np.shape(leaf)}, expected {wanted}")


def _leaves(name: str, tree: Any) -> Iterator[Array]:
    """The arrays of nested NamedTuples."""
    if isinstance(tree, tuple) and hasattr(tree, "_fields"):
        for field, branch in zip(tree._fields, tree, strict=True):
            yield from _leaves(f"{name}.{field}", branch)
    elif isinstance(tree, np.ndarray):
        yield tree
    elif tree is not None:
        raise InputError(f"{name} is {_brief(tree)}, expected a NamedTuple of arrays, or None")


def _brief(value: object) -> str:
    """The start of a value's text, in one line."""
    return " ".join(repr(value).split())[:40]


def given_tracker(tracker: object, names: Iterable[str]) -> Tracker | None:
    """The tracker that a user puts into a system; None for the name of one of the system's own.

    Args:
        tracker: the parameter ``tracker`` of the system.
        names: of the system's own trackers.

    Raises:
        InputError: no such name (nearest named), or as ``make_tracker``.
    """
    if not isinstance(tracker, str) or ":" in tracker:
        return make_tracker(tracker)
    check_choice("tracker", tracker, (*names, "package.module:name"))
    return None


def make_tracker(tracker: object) -> Tracker:
    """``tracker`` itself, or what a function or class at ``"package.module:name"`` makes.

    Raises:
        InputError: nothing that predicts and updates, or no function or class at that place that needs no argument.
    """
    made = tracker
    if isinstance(tracker, str):
        factory = load_object("tracker", tracker)
        if not _takes(factory, 0):
            wanted = "the place of a function or class that makes a tracker, without arguments"
            raise InputError(f"tracker is {tracker!r}, expected {wanted}")
        made = factory()
    if not isinstance(made, Tracker) or not _has_methods(made, predict=2, update=2):
        wanted = "an object with predict(estimate, motion) and update(estimate, scan)"
        raise InputError(f"tracker is {tracker!r}, expected {wanted} (nearest: OneByOne(filter))")
    return made


def _has_methods(part: object, **counts: int) -> bool:
    """Whether ``part`` is an object, not a class, whose methods take these numbers of arguments."""
    return not isinstance(part, type) and all(_takes(getattr(part, name, None), n) for name, n in counts.items())


def _takes(function: Any, count: int) -> bool:
    """Whether ``function`` can be called with ``count`` arguments, as far as its signature tells."""
    if not callable(function):
        return False
    try:
        inspect.signature(function).bind(*[None] * count)
    except TypeError:
        return False
    except ValueError:  # compiled: it has no signature
        return True
    return True
