"""Predictors, updaters and data associators of Stone Soup as a tracker of wavegym."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.dataassociator.probability import JPDA
from stonesoup.functions import gm_reduce_single
from stonesoup.hypothesiser.base import Hypothesiser
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor import Predictor
from stonesoup.predictor.kalman import KalmanPredictor, UnscentedKalmanPredictor
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.multihypothesis import MultipleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.sensors import gate_probability
from wavegym.targets.motion import MotionModel
from wavegym.trackers.protocol import UNKNOWN, Estimate, MeasurementModel, OneByOne, Scan

BEFORE = datetime(2000, 1, 1)
NOW = BEFORE + timedelta(seconds=1)  # models of wavegym are for one step of any length
GATED = partial(PDAHypothesiser, prob_gate=float(gate_probability(4.0)))  # four standard deviations, as in AgileClutter


@dataclass(frozen=True)
class StoneSoupTracker:
    """A tracker of wavegym from parts of Stone Soup, for every system that takes ``tracker=``.

    The system supplies the models, the probability of detection and the density of clutter. So the arguments are
    classes or functions that make objects: ``functools.partial(UnscentedKalmanUpdater, alpha=0.5)``.

    Args:
        predictor: makes a predictor of a transition model; for Gaussian states.
        updater: makes an updater of a measurement model, which is None: each detection has its own.
        data_associator: makes a data associator of a hypothesiser, such as ``JPDA``, ``PDA`` or
            ``GNNWith2DAssignment``; needed if the origin of a return is unknown. None: origins are known.
        hypothesiser: makes a hypothesiser of a predictor and an updater. It receives ``prob_detect`` and
            ``clutter_spatial_density`` if it accepts them.

    Raises:
        InputError: an argument that makes no object; in play, returns of unknown origin without a data associator.
    """

    predictor: Callable[..., Any] = KalmanPredictor
    updater: Callable[..., Any] = ExtendedKalmanUpdater
    data_associator: Callable[..., Any] | None = None
    hypothesiser: Callable[..., Any] = GATED

    def __post_init__(self) -> None:
        for name in ("predictor", "updater", "data_associator", "hypothesiser"):
            made = getattr(self, name)
            if not callable(made) and not (made is None and name == "data_associator"):
                given, kind = " ".join(repr(made).split()), type(made).__name__
                wanted = f"a class, or a function that makes one (nearest: {kind})"
                raise InputError(f"{name} is {given:.60}, expected {wanted}")

    def predict(self, estimate: Estimate, motion: MotionModel) -> Estimate:
        """See ``wavegym.trackers.protocol.Tracker``."""
        return OneByOne(_Filter(self.predictor, self.updater)).predict(estimate, motion)

    def update(self, estimate: Estimate, scan: Scan) -> Estimate:
        """See ``wavegym.trackers.protocol.Tracker``; the covariance of an error is that of its return."""
        if not (scan.target == UNKNOWN).any():
            return OneByOne(_Filter(self.predictor, self.updater)).update(estimate, scan)
        associate, detection = self.data_associator, scan.detection
        if associate is None or detection is None:
            wanted = "a data associator (nearest: StoneSoupTracker(data_associator=JPDA))"
            raise InputError(f"target of a return is {UNKNOWN}, its origin is unknown, expected {wanted}")
        mean, covariance = estimate.mean.copy(), estimate.covariance.copy()
        for e in range(len(mean)):
            pd = {int(t): float(detection[e, t]) for t in np.flatnonzero(detection[e] > 0.0)}
            if pd:
                self._associate(associate, e, pd, mean, covariance, scan)
        return estimate._replace(mean=mean, covariance=covariance)

    def _associate(
        self, associate: Callable[..., Any], e: int, pd: dict[int, float], mean: Array, covariance: Array, scan: Scan
    ) -> None:
        """Update targets of environment e, by their probability of detection, with all its returns, in place."""
        updater = self.updater(None)
        tracks = {Track([_predicted(mean[e, t], covariance[e, t])]): t for t in pd}
        density = float(np.broadcast_to(scan.clutter_density, len(mean))[e])
        each = _EachTarget({track: self._hypothesiser(updater, pd[t], density) for track, t in tracks.items()})
        detections = [
            _detection(scan.z[e, i], _model(mean.shape[-1], scan.R[e, i], scan.model))
            for i in np.flatnonzero(scan.present[e])
        ]
        for track, found in associate(each).associate(list(tracks), detections, NOW).items():
            mean[e, tracks[track]], covariance[e, tracks[track]] = _moments(found, updater)

    def _hypothesiser(self, updater: Any, detection: float, density: float) -> Any:
        """A hypothesiser for one target."""
        told = {"prob_detect": detection, "clutter_spatial_density": density}
        takes = inspect.signature(self.hypothesiser).parameters
        return self.hypothesiser(_AsPredicted(None), updater, **{name: told[name] for name in told if name in takes})


@dataclass(frozen=True)
class _Filter:
    """A predictor and an updater as a ``TargetFilter`` of ``wavegym.trackers.protocol``."""

    predictor: Callable[..., Any]
    updater: Callable[..., Any]

    def predict(self, x: Array, P: Array, motion: MotionModel) -> tuple[Array, Array]:
        """See ``TargetFilter``."""
        model = LinearGaussianTimeInvariantTransitionModel(transition_matrix=motion.F, covariance_matrix=motion.Q)
        before = GaussianState(StateVector(x), P, timestamp=BEFORE)
        return _arrays(self.predictor(model).predict(before, timestamp=NOW))

    def update(self, x: Array, P: Array, z: Array, R: Array, model: MeasurementModel) -> tuple[Array, Array]:
        """See ``TargetFilter``."""
        detection = _detection(z, _model(len(x), R, model))
        return _arrays(self.updater(None).update(SingleHypothesis(_predicted(x, P), detection)))


class _Model(NonLinearGaussianMeasurement):
    """A ``MeasurementModel`` of wavegym."""

    functions: Any = Property(doc="The MeasurementModel")

    @property
    def ndim_meas(self) -> int:
        return len(self.noise_covar)

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        vectors = state.state_vector
        kind = StateVectors if isinstance(vectors, StateVectors) else StateVector
        return kind(self.functions.measure(np.asarray(vectors, np.float64).T).T)

    def jacobian(self, state: Any, **kwargs: Any) -> Array:
        H: Array = self.functions.jacobian(np.asarray(state.state_vector, np.float64).ravel())
        return H


class _AsPredicted(Predictor):
    """The tracks are predicted already."""

    def predict(self, prior: Any, timestamp: Any = None, **kwargs: Any) -> Any:
        return prior.state


class _EachTarget(Hypothesiser):
    """A hypothesiser for each track: their probabilities of detection differ."""

    each: Any = Property(doc="From tracks to hypothesisers")

    def hypothesise(self, track: Any, detections: Any, timestamp: Any, **kwargs: Any) -> Any:
        return self.each[track].hypothesise(track, detections, timestamp, **kwargs)


def _predicted(x: Array, P: Array) -> GaussianStatePrediction:
    return GaussianStatePrediction(StateVector(x), P, timestamp=NOW)


def _detection(z: Array, model: _Model) -> Detection:
    return Detection(StateVector(z), timestamp=NOW, measurement_model=model)


def _model(n: int, R: Array, functions: MeasurementModel) -> _Model:
    return _Model(ndim_state=n, mapping=tuple(range(n)), noise_covar=R, functions=functions)


def _arrays(state: Any) -> tuple[Array, Array]:
    """Mean and covariance as plain arrays."""
    return np.array(state.mean, np.float64).ravel(), np.array(state.covar, np.float64)


def _moments(found: Any, updater: Any) -> tuple[Array, Array]:
    """Mean and covariance with what the data associator found: one hypothesis, or several with probabilities."""
    if not isinstance(found, MultipleHypothesis):
        return _arrays(updater.update(found) if found else found.prediction)
    states = [updater.update(each) if each else each.prediction for each in found]
    mean, covariance = gm_reduce_single(
        StateVectors([state.state_vector for state in states]),
        np.stack([state.covar for state in states], axis=2),
        np.array([float(each.probability) for each in found]),
    )
    return np.array(mean, np.float64).ravel(), np.array(covariance, np.float64)


def kalman() -> StoneSoupTracker:
    """Stone Soup's Kalman predictor and extended Kalman updater."""
    return StoneSoupTracker()


def unscented() -> StoneSoupTracker:
    """Stone Soup's unscented Kalman predictor and updater."""
    return StoneSoupTracker(UnscentedKalmanPredictor, UnscentedKalmanUpdater)


def jpda() -> StoneSoupTracker:
    """Stone Soup's joint probabilistic data association with its extended Kalman updater, for systems with clutter."""
    return StoneSoupTracker(data_associator=JPDA)
