"""The JPDA update against plain matrices with brute-force associations, and against the Kalman filter."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from tests.oracles import random_covariance, update
from wavegym.core.errors import InputError
from wavegym.trackers import jpda_update

H = np.array([[1.0, 0, 0.3, 0], [0, 0.5, 0, 1.0]])


def scene(rng, targets, returns, spread=2.0):
    mean = rng.standard_normal((targets, 4))
    P = random_covariance(rng, 4, (targets,))
    S = H @ P @ H.T + np.eye(2)
    predicted = mean @ H.T
    z = predicted[rng.integers(targets, size=returns)] + spread * rng.standard_normal((returns, 2))
    return mean, P, z, predicted, S, P @ H.T


def brute_force(mean, P, z, predicted, S, G, pd, density, gate, share):
    """Enumerates every association; each target's posterior is the mixture's mean and covariance."""
    targets, returns = len(mean), len(z)
    total, parts = 0.0, []
    for owners in product(range(returns + 1), repeat=targets):
        taken = [m for m in owners if m]
        if len(set(taken)) < len(taken):
            continue
        weight = 1.0
        for t, m in enumerate(owners):
            if not m:
                weight *= 1.0 - pd[t] * share
                continue
            v = z[m - 1] - predicted[t]
            squared = v @ np.linalg.solve(S[t], v)
            inside = squared <= gate * gate
            weight *= inside * pd[t] * np.exp(-squared / 2) / (2 * np.pi * np.sqrt(np.linalg.det(S[t]))) / density
        total += weight
        parts.append((weight, owners))
    means, covariances = np.empty(mean.shape), np.empty(P.shape)
    for t in range(targets):
        K = G[t] @ np.linalg.inv(S[t])
        moments = []
        for weight, owners in parts:
            m = owners[t]
            x = mean[t] + (K @ (z[m - 1] - predicted[t]) if m else 0.0)
            moments.append((weight / total, x, P[t] - K @ S[t] @ K.T if m else P[t]))
        means[t] = sum(w * x for w, x, _ in moments)
        covariances[t] = sum(w * (C + np.outer(x - means[t], x - means[t])) for w, x, C in moments)
    return means, covariances


@pytest.mark.parametrize("seed", range(8))
def test_is_the_moments_of_the_mixture_over_all_associations(seed):
    rng = np.random.default_rng(seed)
    targets, returns = rng.integers(1, 4), rng.integers(0, 5)
    case = scene(rng, targets, returns)
    pd, density = rng.uniform(0.2, 0.95, targets), 10.0 ** rng.uniform(-4, 0)
    x, P = jpda_update(*case, pd, density, gate=3.0)
    expected = brute_force(*case, pd, density, 3.0, 1 - np.exp(-4.5))
    np.testing.assert_allclose(x, expected[0], rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(P, expected[1], rtol=1e-9, atol=1e-9 * np.abs(P).max())


def test_one_sure_return_is_a_kalman_update():
    rng = np.random.default_rng(1)
    mean, P, _, predicted, S, G = scene(rng, 1, 0)
    z = predicted + 0.1
    x, covariance = jpda_update(mean, P, z, predicted, S, G, [1 - 1e-14], 1e-12)
    expected = update(mean[0], P[0], z[0] - predicted[0], H, np.eye(2))
    np.testing.assert_allclose(x[0], expected[0], rtol=1e-9)
    np.testing.assert_allclose(covariance[0], expected[1], rtol=1e-9, atol=1e-9 * np.abs(P).max())


def test_a_batch_is_its_elements_bit_for_bit():
    rng = np.random.default_rng(2)
    scenes = [scene(rng, 2, 4) for _ in range(5)]
    batch = [np.stack(arrays) for arrays in zip(*scenes, strict=True)]
    pd, density = rng.uniform(0.3, 0.9, (5, 2)), rng.uniform(0.01, 0.1, 5)
    x, P = jpda_update(*batch, pd, density)
    for e, case in enumerate(scenes):
        alone = jpda_update(*case, pd[e], density[e])
        assert np.array_equal(alone[0], x[e])
        assert np.array_equal(alone[1], P[e])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pd": [0.5, 1.0]}, r"pd\[1\] is 1.0, expected probabilities in \(0, 1\)"),
        ({"clutter_density": 0.0}, "clutter_density is 0.0, expected finite numbers > 0"),
        ({"gate": -1.0}, "gate is -1.0, expected a finite number > 0"),
        ({"gate_probability": 1.5}, "gate_probability is 1.5, expected a probability in"),
        ({"S": -np.ones((2, 2, 2))}, r"S\[0\] has the eigenvalue -2, expected a positive definite matrix"),
        ({"measurements": np.zeros((3, 3))}, "argument shapes are"),
    ],
)
def test_bad_input_is_named(change, message):
    mean, P, z, predicted, S, G = scene(np.random.default_rng(3), 2, 3)
    given = {
        "mean": mean, "covariance": P, "measurements": z, "predicted": predicted, "S": S, "cross_covariance": G,
        "pd": [0.9, 0.9], "clutter_density": 0.1,
    }  # fmt: skip
    with pytest.raises(InputError, match=message):
        jpda_update(**{**given, **change})


def test_too_many_targets_around_one_return_are_refused():
    case = scene(np.random.default_rng(4), 1, 0)
    mean, P, _, predicted, S, G = (np.repeat(a, 11, axis=0) for a in case)
    with pytest.raises(InputError, match="more than CLUSTER_LIMIT = 10 of 11 targets share"):
        jpda_update(mean, P, predicted[:1], predicted, S, G, [0.9] * 11, 0.1)
