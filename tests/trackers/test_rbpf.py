"""The particle filter against the exact mixture over all histories of associations.

A history assigns the returns of all scans so far to targets. ``exact`` computes all histories in plain NumPy, each with
its unscented Kalman filters and its weight. The particle filter samples from this mixture.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
import pytest
import scipy.stats
from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter

from tests.oracles import motion
from wavegym.trackers import joint_association, predict, rbpf_update
from wavegym.trackers import rbpf_kernels as kernels

SENSORS = np.array([[3000.0, -16000.0], [3000.0, 20400.0]])
NOISE = np.array([[100.0, 12.0], [12.0, 9.0]])
F, Q = (np.kron(block, np.eye(2)) for block in motion(2, 0.25, 1.0))
DENSITY, PG = 1e-3, 0.97


def measure(x, sensor):
    d = x[..., :2] - sensor
    r = np.linalg.norm(d, axis=-1)
    return np.stack([r, (d * x[..., 2:]).sum(-1) / r], axis=-1)


def predict_ahead(x, P, noise, sensor):
    """Unscented transform of one target, written out: predicted measurement, its covariance, cross-covariance."""
    spread = np.sqrt(len(x)) * np.linalg.cholesky(P).T
    images = measure(x + np.concatenate([spread, -spread]), sensor)
    z = images.mean(0)
    return z, (images - z).T @ (images - z) / len(images) + noise, spread.T @ (images[:4] - images[4:]) / len(images)


def correct(x, P, z, predicted):
    """The unscented Kalman filter's update with the measurement z."""
    centre, S, G = predicted
    K = G @ np.linalg.inv(S)
    return x + K @ (z - centre), P - K @ S @ K.T


def feasible(targets, count):
    """Every association of ``count`` returns: each target's return, counted from 1, or 0."""
    for owner in itertools.product(range(count + 1), repeat=targets):
        taken = [m for m in owner if m]
        if len(taken) == len(set(taken)):
            yield owner


class Scene(NamedTuple):
    """One prior and the scans of several steps: scans[step][sensor] (return, 2)."""

    mean: np.ndarray  # (target, 4)
    covariance: np.ndarray  # (target, 4, 4)
    scans: list
    pd: np.ndarray  # (sensor, target)
    noise: np.ndarray  # (sensor, target, 2, 2)


def scene(steps, targets=2, apart=30.0, seed=1):
    """``steps`` lists for each step and sensor what is returned: a target's number or "clutter"."""
    rng = np.random.default_rng(seed)
    truth = np.array([2000.0, -1000.0, -100.0, 800.0]) + np.arange(targets)[:, None] * [apart, -apart, 3.0, -3.0]
    P0 = np.tile(np.diag([900.0, 900.0, 25.0, 25.0]), (targets, 1, 1))
    mean, scans = truth + rng.standard_normal((targets, 4)) * [20.0, 20.0, 3.0, 3.0], []
    for k, step in enumerate(steps):
        truth = truth @ F.T if k else truth
        scans.append([])
        for sensor, sources in zip(SENSORS, step, strict=True):
            z = [measure(truth[0 if s == "clutter" else s], sensor) for s in sources]
            spread = [2.0 if s == "clutter" else 1.0 for s in sources]
            error = rng.multivariate_normal([0.0, 0.0], NOISE, len(z)) * np.reshape(spread, (-1, 1))
            scans[-1].append(np.reshape(z, (-1, 2)) + error)
    pd = np.full((2, targets), 0.8) + 0.05 * np.arange(targets)
    return Scene(mean, P0, scans, pd, np.tile(NOISE, (2, targets, 1, 1)))


def branch(histories, z, pd, noise, sensor):
    """One scan: every history (log weight, means, covariances) times every feasible association."""
    for log_weight, x, P in histories:
        predicted = [predict_ahead(*each, sensor) for each in zip(x, P, noise, strict=True)]
        for owner in feasible(len(x), len(z)):
            weight, means, covariances = log_weight, x.copy(), P.copy()
            for t, m in enumerate(owner):
                if m:
                    centre, S, _ = predicted[t]
                    y = z[m - 1] - centre
                    norm = DENSITY * 2.0 * np.pi * np.sqrt(np.linalg.det(S))
                    weight += np.log(pd[t] / norm) - 0.5 * y @ np.linalg.solve(S, y)
                    means[t], covariances[t] = correct(x[t], P[t], z[m - 1], predicted[t])
                else:
                    weight += np.log(1.0 - pd[t] * PG)
            yield weight, means, covariances


def every_history(s):
    """Log weight (history,), means (history, target, 4) and covariances of all histories after all steps."""
    histories = [(0.0, s.mean, s.covariance)]
    for k, scan in enumerate(s.scans):
        if k:
            histories = [(w, x @ F.T, F @ P @ F.T + Q) for w, x, P in histories]
        for i, z in enumerate(scan):
            histories = list(branch(histories, z, s.pd[i], s.noise[i], SENSORS[i]))
    return tuple(np.array(column) for column in zip(*histories, strict=True))


def exact(s):
    """Mean, covariance and log evidence after all steps, from every history."""
    log_weight, x, P = every_history(s)
    w = np.exp(log_weight - log_weight.max())
    mean = np.einsum("h,hti->ti", w, x) / w.sum()
    d = x - mean
    covariance = np.einsum("h,htij->tij", w, P + d[..., None] * d[..., None, :]) / w.sum()
    return mean, covariance, np.log(w.sum()) + log_weight.max()


def particles(s, count):
    return np.repeat(s.mean[None], count, axis=0), np.repeat(s.covariance[None], count, axis=0)


def step(s, k, X, V, key, **more):
    return rbpf_update(key, X, V, s.scans[k], s.pd, s.noise, SENSORS, DENSITY, PG, **more)


def filtered(s, count, key=0):
    """Each step's ``RbpfUpdate``."""
    X, V = particles(s, count)
    for k in range(len(s.scans)):
        if k:
            X, V = predict(X, V, F, Q)
        yield (done := step(s, k, X, V, key + k))
        X, V = done.particles


SCENES = {
    "one target, three steps": scene([[(0, "clutter"), ("clutter",)], [(), (0, "clutter")], [(0,), (0,)]], targets=1),
    "two targets, two steps": scene([[(0, "clutter"), (0, 1, "clutter")], [(1, 0), (1,)]]),
    "two targets that stay apart": scene([[(0, 1), (0, 1)], [(0, "clutter"), (1,)]], apart=500.0),
    "three targets": scene([[(0, 1, 2), (2, 0)]], targets=3),
}


@pytest.mark.parametrize("name", SCENES)
def test_equals_the_mixture_over_every_history(name):
    s, count = SCENES[name], 20_000
    mean, covariance, log_evidence = exact(s)
    done = list(filtered(s, count))
    # Each step adds the Monte Carlo variance of its weights and its resampling.
    error = np.sqrt(sum(1.0 / count + 1.0 / d.effective_sample_size for d in done))
    assert error < 0.04
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert np.abs((done[-1].mean - mean) / sigma).max() < 4.0 * error
    spread = sigma[:, :, None] * sigma[:, None, :]
    assert np.abs((done[-1].covariance - covariance) / spread).max() < 4.0 * np.sqrt(3.0) * error  # 3: heavier tails
    assert abs(sum(d.log_evidence for d in done) - log_evidence) < 4.0 * error


@pytest.mark.parametrize("name", ["two targets, two steps", "three targets"])
def test_scenes_are_of_several_modes(name):
    """Likely histories lie far from the best: one Gaussian per target would not be enough."""
    log_weight, x, P = every_history(SCENES[name])
    best = log_weight.argmax()
    d = x - x[best]
    far = (np.einsum("hti,tij,htj->ht", d, np.linalg.inv(P[best]), d) > 2.0**2).any(axis=1)
    share = np.exp(log_weight - log_weight.max())
    assert share[far].sum() / share.sum() > 0.2


def test_the_evidence_of_identical_particles_is_the_joint_association_s():
    s = SCENES["two targets, two steps"]
    X, V = particles(s, 50)
    z, pd, noise = s.scans[0][1], s.pd[1], s.noise[1]
    ours = rbpf_update(3, X, V, [z], pd[None], noise[None], SENSORS[1:], DENSITY, PG)
    predicted = [predict_ahead(*each, SENSORS[1]) for each in zip(s.mean, s.covariance, noise, strict=True)]
    N = [scipy.stats.multivariate_normal.pdf(z, centre, S) for centre, S, _ in predicted]
    wanted = joint_association(N, pd, DENSITY, PG).log_evidence
    np.testing.assert_allclose(ours.log_evidence, wanted, rtol=1e-9)
    np.testing.assert_allclose(ours.effective_sample_size, 50.0, rtol=1e-12)
    assert ours.ancestors == 50


def test_without_clutter_every_particle_is_filterpys_unscented_kalman_filter():
    s = scene([[(0,), (0,)]], targets=1)
    X, V = particles(s, 100)
    ours = rbpf_update(0, X, V, s.scans[0], np.full((2, 1), 1.0 - 1e-9), s.noise, SENSORS, 1e-12)
    points = JulierSigmaPoints(4, kappa=0.0)
    filter = UnscentedKalmanFilter(4, 2, 0.25, None, lambda x, dt: x, points)
    filter.x, filter.P, filter.Q, filter.R = s.mean[0].copy(), s.covariance[0].copy(), np.zeros((4, 4)), NOISE
    for z, sensor in zip(s.scans[0], SENSORS, strict=True):
        filter.predict()  # makes the sigma points; nothing moves
        filter.update(z[0], hx=lambda x, sensor=sensor: measure(x, sensor))
    sigma = np.sqrt(np.diag(filter.P))
    assert np.abs((ours.particles.mean - filter.x) / sigma).max() < 1e-6  # of a range of 2e4 m, filterpy loses digits
    assert np.abs((ours.particles.covariance - filter.P) / np.outer(sigma, sigma)).max() < 1e-6
    assert np.abs((ours.mean - filter.x) / sigma).max() < 1e-6
    assert ours.effective_sample_size == pytest.approx(100.0)


@pytest.mark.parametrize(
    "W",
    [
        [[0.3, 1.0, 0.2, 0.0]],
        [[0.2, 1.0, 0.6], [0.5, 1.5, 0.4]],
        [[0.2, 1.0, 0.0, 0.3], [0.5, 0.0, 0.8, 0.0]],  # disjoint gates
        [[0.2, 1.0, 0.6, 0.1], [0.5, 1.5, 0.4, 0.0], [0.1, 0.9, 0.0, 0.7]],
        [[1e-110, 3e-110, 2e-110], [2e-110, 1e-110, 5e-110]],  # which need scaling
        [[0.1, 2.0, 0.0], [0.1, 3.0, 0.0], [0.4, 0.0, 0.5]],  # a pair that wants one return, and one apart
    ],
)
def test_associations_are_drawn_from_their_exact_joint_posterior(W):
    W, draws = np.array(W), 20_000
    T, M = W.shape[0], W.shape[1] - 1
    weight = {a: np.prod([W[t, m] for t, m in enumerate(a)]) for a in feasible(T, M)}
    weight = {a: w for a, w in weight.items() if w > 0.0}
    seen, beta, owner = dict.fromkeys(weight, 0), np.empty(W.shape), np.empty(T, np.int64)
    for key in range(draws):
        log_evidence = kernels.draw_association(np.uint64(key), W.copy(), T, M, beta, owner)
        seen[tuple(owner.tolist())] += 1  # KeyError for an infeasible one
    total = sum(weight.values())
    np.testing.assert_allclose(log_evidence, np.log(total), rtol=1e-12)
    expected = np.array(list(weight.values())) * draws / total
    assert scipy.stats.chisquare(list(seen.values()), expected).pvalue > 1e-3


@pytest.mark.parametrize("targets", [1, 2, 3])
def test_a_particle_has_the_same_bits_with_any_number_of_others(targets):
    """Eight particles are computed at once, and the last of them several times where fewer are left."""
    s, most = scene([[tuple(range(targets)), ("clutter", 0)]], targets), 17
    X, V = particles(s, most)
    X += np.random.default_rng(0).standard_normal(X.shape) * [15.0, 15.0, 3.0, 3.0]

    def stepped(count):
        x, P, log_weight, present = X[:count].copy(), V[:count].copy(), np.zeros(count), np.arange(targets) != 1
        Y, U, gates = np.empty(x.shape), np.empty(P.shape), (np.zeros((targets, 2)), s.noise[0], np.inf, PG)
        for i, z in enumerate(s.scans[0]):
            kernels.update_particles(
                np.uint64(i), present, x, P, log_weight, z, len(z), s.pd[i], s.noise[i], *SENSORS[i], gates, DENSITY,
                (0,) * 4
            )  # fmt: skip
        kernels.predict_particles(x, P, present, F[None], Q[None], Y, U, (0,) * 4)
        return x, P, log_weight, Y, U

    whole = stepped(most)
    corrected = (whole[0][:, 0] != X[:, 0]).any(axis=-1)
    assert corrected.any()
    assert not corrected.all()
    for count in range(1, most):
        for some, every in zip(stepped(count), whole, strict=True):
            assert (some == every[:count]).all()


def test_the_key_decides():
    s = SCENES["two targets, two steps"]
    first, again, other = (list(filtered(s, 200, key))[-1] for key in (2**63 + 1, 2**63 + 1, 7))
    assert (first.particles.mean == again.particles.mean).all()
    assert (first.particles.covariance == again.particles.covariance).all()
    assert first[2:4] == again[2:4]
    assert (first.particles.mean != other.particles.mean).any()


def test_absent_targets_are_neither_updated_nor_used():
    s = SCENES["two targets, two steps"]
    X, V = particles(s, 200)
    ours = step(s, 0, X, V, 6, present=[True, False])
    assert (ours.particles.mean[:, 1] == s.mean[1]).all()
    assert (ours.particles.covariance[:, 1] == s.covariance[1]).all()
    alone = Scene(s.mean[:1], s.covariance[:1], s.scans, s.pd[:, :1], s.noise[:, :1])
    single = step(alone, 0, X[:, :1], V[:, :1], 6)
    assert (single.particles.mean[:, 0] == ours.particles.mean[:, 0]).all()
    assert single[2:4] == ours[2:4]
    nobody = step(s, 0, X, V, 6, present=[False, False])
    assert (nobody.particles.mean == X).all()
    assert nobody[2:4] == (pytest.approx(200.0), 200)
    Y, U = np.empty(X.shape), np.empty(V.shape)
    kernels.predict_particles(X, V, np.array([True, False]), F[None], Q[None], Y, U, (0,) * 4)
    wanted = predict(X[:, 0], V[:, 0], F, Q)
    assert (Y[:, 0] == wanted[0]).all()
    assert (U[:, 0] == wanted[1]).all()
    assert (Y[:, 1] == X[:, 1]).all()
    assert (U[:, 1] == V[:, 1]).all()


def test_a_return_far_from_all_targets_is_clutter_even_at_a_tiny_density():
    s = scene([[(0,), ()]], targets=1)
    s.scans[0][0][:] += 2000.0
    ours = rbpf_update(0, *particles(s, 10), s.scans[0], s.pd, s.noise, SENSORS, 1e-20)
    assert (ours.particles.mean == s.mean).all()
    assert ours.log_evidence == pytest.approx(np.log(1.0 - s.pd).sum())


def test_a_target_expected_outside_every_gate_is_not_missed():
    s, count = SCENES["two targets that stay apart"], 4
    X, V = particles(s, count)
    X[1:, 0, 0] += 4000.0  # target 0 of all particles but the first lies nowhere near a gate,
    X[3, 0] = s.mean[1]  # that of the last one in the gate of target 1
    z, noise = measure(s.mean, SENSORS[0]), np.tile(NOISE, (2, 1, 1))
    gates = z, np.tile(30.0 * np.eye(2), (2, 1, 1)), 4.0, PG
    log_weight, present = np.zeros(count), np.ones(2, bool)
    scan = np.empty((5, 2)), 0  # no returns
    kernels.update_particles(
        np.uint64(0), present, X, V, log_weight, *scan, s.pd[0], noise, *SENSORS[0], gates, DENSITY, (0,) * 4
    )
    missed = np.log(1.0 - s.pd[0] * PG)
    np.testing.assert_allclose(log_weight, [missed.sum(), missed[1], missed[1], missed.sum()], rtol=1e-12)
