"""Interacting multiple models of unscented filters and of Kalman filters, against filterpy's and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, JulierSigmaPoints, KalmanFilter, UnscentedKalmanFilter

from tests.oracles import random_covariance
from wavegym.core.errors import InputError
from wavegym.targets import constant_acceleration, constant_velocity
from wavegym.targets.motion import coordinated_turn, nearly_constant_acceleration, nearly_constant_velocity
from wavegym.trackers import (
    imm_combine,
    imm_mix,
    imm_reweigh,
    imm_ukf_scan,
    predict,
    ukf_update,
    variable_structure,
)
from wavegym.trackers.imm import ImmKalman
from wavegym.trackers.protocol import Estimate, ExtendedKalman, MeasurementModel, Scan

T, OMEGA = 0.25, np.pi / 20
MODELS = [
    nearly_constant_velocity(T, 0.25),
    nearly_constant_acceleration(T, 0.3),
    coordinated_turn(T, OMEGA, 0.25),
    coordinated_turn(T, -OMEGA, 0.25),
]
F, Q = (np.stack([getattr(model, name) for model in MODELS]) for name in "FQ")
TRANSITION = np.array([[0.99, 0.01, 0, 0], [0.1, 0.7, 0.1, 0.1], [0, 0.01, 0.99, 0], [0, 0.01, 0, 0.99]])
TX, RX = np.array([2085.0, 1470.5]), np.array([2078.0, 1467.0])
R = np.array([[0.3, 0.05], [0.05, 0.1]])


def measure(x):
    d0, d1 = x[..., :2] - TX, x[..., :2] - RX
    r0, r1 = np.linalg.norm(d0, axis=-1), np.linalg.norm(d1, axis=-1)
    rate = (d0 * x[..., 2:4]).sum(-1) / r0 + (d1 * x[..., 2:4]).sum(-1) / r1
    return np.stack([(r0 + r1) / 2, rate / 2], axis=-1)


def filters(x, P):
    """filterpy's unscented filters, one for each model."""
    made = []
    for j, model in enumerate(MODELS):
        points = JulierSigmaPoints(6, kappa=0.0)
        one = UnscentedKalmanFilter(6, 2, T, measure, lambda x, dt, F=model.F: F @ x, points)
        one.x, one.P, one.Q, one.R = x[j].copy(), P[j].copy(), model.Q, R
        made.append(one)
    return made


def tracks(count, seed=0):
    """Ordinary beliefs near the crossing: the models differ slightly, standard deviations are metres."""
    rng = np.random.default_rng(seed)
    centre = np.array([2030.0, 1500.0, 8.0, 1.0, -0.5, 0.2]) + rng.normal(size=(count, 1, 6))
    x = centre + 0.3 * rng.normal(size=(count, 4, 6))
    scale = np.diag([2.0, 2.0, 1.0, 1.0, 0.5, 0.5])
    P = np.array([[scale @ random_covariance(rng, 6) @ scale for _ in range(4)] for _ in range(count)])
    return x, P, rng.dirichlet(np.ones(4), count), measure(centre[:, 0]) + rng.normal(size=(count, 2))


def close(ours, theirs, scale):
    assert (np.abs(ours - theirs) <= 1e-10 * scale).all(), np.abs(ours - theirs).max()


def test_one_filter_equals_filterpy():
    x, P, _, z = tracks(5)
    for k in range(5):
        theirs = filters(x[k], P[k])
        mean, covariance = predict(x[k], P[k], F, Q)
        mean, covariance, log_likelihood = ukf_update(mean, covariance, z[k], R, TX, RX)
        for j, one in enumerate(theirs):
            one.predict()
            one.update(z[k])
            scale = np.sqrt(np.diag(one.P))
            close(mean[j], one.x, np.abs(one.x) + scale)
            close(covariance[j], one.P, np.outer(scale, scale))
            assert log_likelihood[j] == pytest.approx(one.log_likelihood, rel=1e-9)


def test_whole_scans_equal_filterpy():
    x, P, mu, z = tracks(4)
    for k in range(4):
        theirs = IMMEstimator(filters(x[k], P[k]), mu[k].copy(), TRANSITION)
        ours = x[k], P[k], mu[k]
        for step in range(3):
            theirs.predict()
            theirs.update(z[k] + step)
            ours = imm_ukf_scan(*ours, z[k] + step, R, TX, RX, F, Q, TRANSITION)
            close(ours[2], theirs.mu, 1.0)
            for j, one in enumerate(theirs.filters):
                scale = np.sqrt(np.diag(one.P))
                close(ours[0][j], one.x, np.abs(one.x))
                close(ours[1][j], one.P, np.outer(scale, scale))
            mean, covariance = imm_combine(*ours)
            close(mean, theirs.x, np.abs(theirs.x))
            close(covariance, theirs.P, np.outer(*[np.sqrt(np.diag(theirs.P))] * 2))


def test_a_scan_is_its_parts_and_a_batch_its_tracks():
    x, P, mu, z = tracks(3)
    mean, covariance, c = imm_mix(x, P, mu, TRANSITION)
    mean, covariance = predict(mean, covariance, F, Q)
    mean, covariance, log_likelihood = ukf_update(mean, covariance, z[:, None], R, TX, RX)
    whole = imm_ukf_scan(x, P, mu, z, R, TX, RX, F, Q, TRANSITION)
    for a, b in zip(whole, (mean, covariance, imm_reweigh(c, log_likelihood)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)
    for k in range(3):
        alone = imm_ukf_scan(x[k], P[k], mu[k], z[k], R, TX, RX, F, Q, TRANSITION)
        for a, b in zip(whole, alone, strict=True):
            np.testing.assert_array_equal(a[k], b)
    assert whole[0].base is not x  # the caller's arrays do not change
    np.testing.assert_array_equal(x, tracks(3)[0])


def test_mixing_and_combining_are_sums():
    x, P, mu, _ = (array[0] for array in tracks(1, seed=3))
    mean, covariance, c = imm_mix(x, P, mu, TRANSITION)
    np.testing.assert_allclose(c, mu @ TRANSITION)
    for j in range(4):
        w = TRANSITION[:, j] * mu / c[j]
        centre = sum(w[i] * x[i] for i in range(4))
        np.testing.assert_allclose(mean[j], centre)
        spread = sum(w[i] * (P[i] + np.outer(x[i] - centre, x[i] - centre)) for i in range(4))
        np.testing.assert_allclose(covariance[j], spread)
    total, whole = imm_combine(mean, covariance, c)
    np.testing.assert_allclose(total, mu @ x)  # mixing moves weight between models, not the target
    np.testing.assert_allclose(whole, imm_combine(x, P, mu)[1], rtol=1e-9)


def test_an_outlier_of_a_million_metres_leaves_probabilities():
    x, P, mu, z = tracks(2)
    for far in (1e6, 1e9):
        mean, covariance, after = imm_ukf_scan(x, P, mu, z + np.array([far, 0.0]), R, TX, RX, F, Q, TRANSITION)
        np.testing.assert_allclose(after.sum(axis=1), 1.0)
        assert np.isfinite(mean).all()
        assert (np.linalg.eigvalsh(covariance) > 0.0).all()
    np.testing.assert_allclose(
        imm_reweigh([0.5, 0.5, 0.0], [-1e9, -1e9 - 1.0, 0.0]), [1 / (1 + np.exp(-1)), 1 / (1 + np.e), 0]
    )


def test_the_paper_s_sets_of_models():
    """Near the crossing constant acceleration and both turns, elsewhere no turns: rows as PAPERS.md has them."""
    near, far = variable_structure(TRANSITION, [[False, True, True, True], [True, True, False, False]])
    np.testing.assert_allclose(near[1], [0, 7 / 9, 1 / 9, 1 / 9])
    np.testing.assert_allclose(far[1], [1 / 8, 7 / 8, 0, 0])
    np.testing.assert_allclose(near[0], [0, 1, 0, 0])  # a target that went straight may now turn
    np.testing.assert_allclose(far[2:], [[0, 1, 0, 0], [0, 1, 0, 0]])
    x, P, mu, z = tracks(1)
    mean, covariance, after = imm_ukf_scan(x, P, mu, z, R, TX, RX, F, Q, near)
    assert after[0, 0] == 0.0
    assert np.isfinite(mean).all()
    assert np.isfinite(covariance).all()


def test_mistakes():
    x, P, mu, z = (array[0] for array in tracks(1))
    with pytest.raises(InputError, match=r"the sum of a row of transition\[0\] is 1\.09, expected 1"):
        imm_mix(x, P, mu, TRANSITION + np.array([[0, 0.09, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]))
    with pytest.raises(InputError, match=r"transition\[0, 0\] is 1\.1, expected probabilities"):
        imm_mix(x, P, mu, [[1.1, -0.1], [0.0, 1.0]])
    with pytest.raises(InputError, match="row 2 of transition leads to no active model of"):
        variable_structure(TRANSITION, [True, False, False, False])
    with pytest.raises(InputError, match=r"active has shape \(2,\), expected \(\.\.\., 4\)"):
        variable_structure(TRANSITION, [True, False])
    with pytest.raises(InputError, match="R has the eigenvalue -1, expected a positive definite matrix"):
        ukf_update(x[0], 1e-6 * np.eye(6), z, -np.eye(2), TX, RX)
    with pytest.raises(InputError, match="covariance has the eigenvalue"):
        ukf_update(x[0], -P[0], z, R, TX, RX)
    with pytest.raises(InputError, match="covariance has the eigenvalue -1"):
        ukf_update(x[0], np.diag([1.0, 1.0, 1.0, 1.0, 1.0, -1.0]), z, R, TX, RX)
    with pytest.raises(InputError, match="mean has 3 components, expected at least 4"):
        ukf_update(np.ones(3), np.eye(3), z, R, TX, RX)
    with pytest.raises(InputError, match="F has 2 components, expected at least 4"):
        imm_ukf_scan(x[:, :2], P[:, :2, :2], mu, z, R, TX, RX, F[:, :2, :2], Q[:, :2, :2], TRANSITION)
    with pytest.raises(InputError, match=r"transmitter has shape \(2, 2\), expected \(2,\)"):
        imm_ukf_scan(x, P, mu, z, R, [TX, TX], RX, F, Q, TRANSITION)
    with pytest.raises(InputError, match="expected leading axes that broadcast to the mean's"):
        imm_ukf_scan(x, P, mu, np.ones((3, 2)), R, TX, RX, F, Q, TRANSITION)
    with pytest.raises(InputError, match=r"probability\[0\] is -0\.5, expected probabilities"):
        imm_mix(x, P, [-0.5, 1.5, 0.0, 0.0], TRANSITION)
    np.testing.assert_array_equal(imm_reweigh([0.3, 0.7], [-np.inf, -np.inf]), [0.3, 0.7])
    with pytest.raises(InputError, match=r"F has shape \(6, 6\), expected \(models, n, n\)"):
        imm_ukf_scan(x, P, mu, z, R, TX, RX, F[0], Q[0], TRANSITION)


H = np.eye(2)
LINE = MeasurementModel(lambda x: x[..., :2].copy(), lambda x: np.broadcast_to(H, (*x.shape[:-1], 2, 2)))
KALMAN_MODELS = tuple(constant_velocity(1.0, q) for q in (0.01, 1.0, 100.0))
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
    tracker, motion = ImmKalman(KALMAN_MODELS, stay=0.9), KALMAN_MODELS[0]
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
    tracker, motion = ImmKalman(KALMAN_MODELS[1:2]), KALMAN_MODELS[1]
    ours, plain = tracker.begin(first(), motion), first()
    for k, scan in enumerate(scans()):
        scan = scan._replace(present=np.array([[True, k % 3 > 0]] * ENVS), target=scan.target * (k % 4 > 0))
        ours = tracker.update(tracker.predict(ours, motion), scan)
        plain = ExtendedKalman().update(ExtendedKalman().predict(plain, motion), scan)
        np.testing.assert_allclose(ours.mean, plain.mean, rtol=1e-12)
        np.testing.assert_allclose(ours.covariance, plain.covariance, rtol=1e-12)


def test_the_process_noise_predicts_the_mixture():
    """The covariance of the mixture one step later is F P F' + Q, with Q the mean over the models."""
    tracker, motion = ImmKalman(KALMAN_MODELS), KALMAN_MODELS[0]
    estimate = tracker.begin(first(), motion)
    for scan in scans():
        ahead = tracker.predict(estimate, motion)
        want = motion.F @ estimate.covariance @ motion.F.T + estimate.process_noise
        np.testing.assert_allclose(ahead.covariance, want, rtol=1e-9, atol=1e-9 * want.max())
        estimate = tracker.update(ahead, scan)


def test_a_batch_is_its_targets():
    tracker = ImmKalman(KALMAN_MODELS)
    whole = tracker.begin(first(), KALMAN_MODELS[0])
    parts = [tracker.begin(Estimate(*(a[e : e + 1] for a in first()[:2])), KALMAN_MODELS[0]) for e in range(ENVS)]
    for scan in scans():
        whole = tracker.update(tracker.predict(whole, KALMAN_MODELS[0]), scan)
        for e in range(ENVS):
            own = scan._replace(**{name: getattr(scan, name)[e : e + 1] for name in ("z", "present", "target", "R")})
            parts[e] = tracker.update(tracker.predict(parts[e], KALMAN_MODELS[0]), own)
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
        ((KALMAN_MODELS[0], constant_acceleration(1.0, 1.0)), 0.9, "expected one or more models of equal states"),
        (KALMAN_MODELS, 1.1, r"stay is 1.1, expected a number in \[0, 1\] \(nearest: 1\)"),
    ],
)
def test_models_that_do_not_go_together_are_refused(models, stay, message):
    with pytest.raises(InputError, match=message):
        ImmKalman(models, stay)


def test_models_of_another_state_than_the_motion_are_refused():
    with pytest.raises(InputError, match=r"expected those of motion: \('r', 'rdot', 'rddot'\)"):
        ImmKalman(KALMAN_MODELS).begin(first(), constant_acceleration(1.0, 1.0))
