"""The IMM of Kalman filters against filterpy's, and against the Kalman filter."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter

from tests.oracles import random_covariance
from wavegym.core.errors import InputError
from wavegym.targets import constant_acceleration, constant_velocity
from wavegym.trackers.imm_tracker import ImmKalman
from wavegym.trackers.protocol import Estimate, ExtendedKalman, MeasurementModel, Scan

H = np.eye(2)
LINE = MeasurementModel(lambda x: x[..., :2].copy(), lambda x: np.broadcast_to(H, (*x.shape[:-1], 2, 2)))
MODELS = tuple(constant_velocity(1.0, q) for q in (0.01, 1.0, 100.0))
ENVS, TARGETS, STEPS = 3, 2, 12


def scans(seed=0):
    """Returns of both targets that grow from step to step."""
    rng = np.random.default_rng(seed)
    R = random_covariance(rng, 2, (STEPS, ENVS, TARGETS))
    z = np.arange(STEPS)[:, None, None, None] ** 2 + 5.0 * rng.standard_normal((STEPS, ENVS, TARGETS, 2))
    target = np.broadcast_to(np.arange(TARGETS), (ENVS, TARGETS))
    return [Scan(z[k], np.ones((ENVS, TARGETS), np.bool_), target, R[k], LINE) for k in range(STEPS)]


def first(seed=1):
    rng = np.random.default_rng(seed)
    return Estimate(10.0 * rng.standard_normal((ENVS, TARGETS, 2)), random_covariance(rng, 2, (ENVS, TARGETS)))


def theirs(tracker, mean, covariance):
    """filterpy's estimator of one target."""
    made = []
    for model in tracker.models:
        kf = KalmanFilter(dim_x=2, dim_z=2)
        kf.x, kf.P, kf.F, kf.Q, kf.H = mean.copy(), covariance.copy(), model.F, model.Q, H
        made.append(kf)
    count = len(made)
    return IMMEstimator(made, np.full(count, 1.0 / count), tracker.transition)


def test_every_step_equals_filterpy():
    tracker, motion = ImmKalman(MODELS, stay=0.9), MODELS[0]
    ours = tracker.begin(first(), motion)
    peers = {at: theirs(tracker, first().mean[at], first().covariance[at]) for at in np.ndindex(ENVS, TARGETS)}
    for scan in scans():
        ours = tracker.predict(ours, motion)
        for at, peer in peers.items():
            peer.predict()
            np.testing.assert_allclose(ours.memory.mean[at], [kf.x for kf in peer.filters], rtol=1e-9, atol=1e-9)
        ours = tracker.update(ours, scan)
        for at, peer in peers.items():
            for kf in peer.filters:
                kf.R = scan.R[at]
            peer.update(scan.z[at])
            np.testing.assert_allclose(ours.memory.probability[at], peer.mu, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(ours.mean[at], peer.x, rtol=1e-9)
            np.testing.assert_allclose(ours.covariance[at], peer.P, rtol=1e-9, atol=1e-9 * np.trace(peer.P))
    assert np.ptp(ours.memory.probability, axis=-1).min() > 0.5  # the models have told themselves apart


def test_one_model_is_the_kalman_filter():
    """Also where a target is missed, or seen twice."""
    tracker, motion = ImmKalman(MODELS[1:2]), MODELS[1]
    ours, plain = tracker.begin(first(), motion), first()
    for k, scan in enumerate(scans()):
        scan = scan._replace(present=np.array([[True, k % 3 > 0]] * ENVS), target=scan.target * (k % 4 > 0))
        ours = tracker.update(tracker.predict(ours, motion), scan)
        plain = ExtendedKalman().update(ExtendedKalman().predict(plain, motion), scan)
        np.testing.assert_allclose(ours.mean, plain.mean, rtol=1e-12)
        np.testing.assert_allclose(ours.covariance, plain.covariance, rtol=1e-12)


def test_the_process_noise_predicts_the_mixture():
    """The covariance of the mixture one step later is F P F' + Q, with Q the mean over the models."""
    tracker, motion = ImmKalman(MODELS), MODELS[0]
    estimate = tracker.begin(first(), motion)
    for scan in scans():
        ahead = tracker.predict(estimate, motion)
        want = motion.F @ estimate.covariance @ motion.F.T + estimate.process_noise
        np.testing.assert_allclose(ahead.covariance, want, rtol=1e-9, atol=1e-9 * want.max())
        estimate = tracker.update(ahead, scan)


def test_a_batch_is_its_targets():
    tracker = ImmKalman(MODELS)
    whole = tracker.begin(first(), MODELS[0])
    parts = [tracker.begin(Estimate(*(a[e : e + 1] for a in first()[:2])), MODELS[0]) for e in range(ENVS)]
    for scan in scans():
        whole = tracker.update(tracker.predict(whole, MODELS[0]), scan)
        for e in range(ENVS):
            own = scan._replace(**{name: getattr(scan, name)[e : e + 1] for name in ("z", "present", "target", "R")})
            parts[e] = tracker.update(tracker.predict(parts[e], MODELS[0]), own)
            for many, one in zip(
                (*whole.memory, whole.mean, whole.process_noise),
                (*parts[e].memory, parts[e].mean, parts[e].process_noise),
                strict=True,
            ):
                np.testing.assert_array_equal(many[e], one[0])


@pytest.mark.parametrize(
    ("models", "stay", "message"),
    [
        ((), 0.9, r"models have the states \[\], expected one or more"),
        ((MODELS[0], constant_acceleration(1.0, 1.0)), 0.9, "expected one or more models of equal states"),
        (MODELS, 1.1, r"stay is 1.1, expected a number in \[0, 1\] \(nearest: 1\)"),
    ],
)
def test_models_that_do_not_go_together_are_refused(models, stay, message):
    with pytest.raises(InputError, match=message):
        ImmKalman(models, stay)


def test_models_of_another_state_than_the_motion_are_refused():
    with pytest.raises(InputError, match=r"expected those of motion: \('r', 'rdot', 'rddot'\)"):
        ImmKalman(MODELS).begin(first(), constant_acceleration(1.0, 1.0))
