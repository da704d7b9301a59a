"""LMIPDA against the paper's equations in plain loops, IPDA for one track, and the laws of probabilities."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.trackers import joint_association, lmipda


def scan(T=3, r=2, M=4, seed=0):
    """Likelihoods with some measurements gated out, model probabilities, existence, Pd and clutter density."""
    rng = np.random.default_rng(seed)
    p = rng.exponential(2.0, (T, r, M)) * (rng.random((T, 1, M)) < 0.7)
    return p, rng.dirichlet(np.ones(r), T), rng.random(T), rng.uniform(0.1, 0.95, T), rng.uniform(0.05, 1.0, (T, M))


def plain(p, mu, psi, pd, rho, Pg):
    """Barbosa et al., section 4.2.4, without its misprints."""
    T, r, M = p.shape
    both = [[sum(mu[t][k] * p[t][k][i] for k in range(r)) for i in range(M)] for t in range(T)]
    prior = np.zeros((T, M))
    for t in range(T):
        total = sum(both[t][i] / rho[t][i] for i in range(M))
        for i in range(M):
            prior[t, i] = pd[t] * Pg * psi[t] * both[t][i] / rho[t][i] / total if total else 0.0
    beta, models, existence = np.zeros((T, r, 1 + M)), np.zeros((T, r)), np.zeros(T)
    for t in range(T):
        omega = [
            rho[t][i] + sum(both[s][i] * prior[s, i] / (1 - prior[s, i]) for s in range(T) if s != t) for i in range(M)
        ]
        delta = pd[t] * Pg * (1 - sum(both[t][i] / omega[i] for i in range(M)))
        existence[t] = (1 - delta) * psi[t] / (1 - delta * psi[t])
        for k in range(r):
            own = pd[t] * Pg * (1 - sum(p[t][k][i] / omega[i] for i in range(M)))
            beta[t, k, 0] = (1 - pd[t] * Pg) / (1 - own)
            beta[t, k, 1:] = [pd[t] * Pg * p[t][k][i] / ((1 - own) * omega[i]) for i in range(M)]
            models[t, k] = mu[t][k] * (1 - own) / (1 - delta)
    return beta, models, existence


@given(st.integers(1, 5), st.integers(1, 4), st.integers(0, 6), st.integers(0, 9999))
def test_equals_the_equations_in_plain_loops(T, r, M, seed):
    given_scan = scan(T, r, M, seed)
    ours = lmipda(*given_scan, 0.99)
    for a, b in zip(ours, plain(*given_scan, 0.99), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(ours.association.sum(axis=-1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(ours.models.sum(axis=-1), 1.0, rtol=1e-12)
    assert ((ours.existence >= 0.0) & (ours.existence <= 1.0)).all()


@given(st.integers(0, 9999))
def test_one_track_is_ipda(seed):
    """Musicki, Evans and Stankovic: with psi = 1 it is probabilistic data association, which is JPDA of one target."""
    p, mu, psi, pd, rho = scan(1, 1, 4, seed)
    ours, rho = lmipda(p, mu, psi, pd, rho[0, 0]), rho[0, 0]
    delta = pd * (1 - (p / rho).sum())
    np.testing.assert_allclose(ours.existence, (1 - delta) * psi / (1 - delta * psi))
    pda = joint_association(p[:, 0], pd, rho).probabilities
    np.testing.assert_allclose(ours.association[:, 0], pda)


def test_tracks_with_disjoint_gates_are_independent():
    p, mu, psi, pd, rho = scan(2, 2, 4, 5)
    p = np.ones_like(p)
    p[0, :, 2:] = p[1, :, :2] = 0.0
    both = lmipda(p, mu, psi, pd, rho)
    for t in range(2):
        alone = lmipda(p[t : t + 1], mu[t : t + 1], psi[t : t + 1], pd[t : t + 1], rho[t : t + 1])
        for a, b in zip(both, alone, strict=True):
            np.testing.assert_array_equal(a[t], b[0])


def test_a_sure_track_takes_its_measurement_from_a_doubtful_one():
    p = np.ones((2, 1, 1))
    mu, pd = np.ones((2, 1)), [0.9, 0.9]
    alone = lmipda(p[:1], mu[:1], [0.1], pd[:1], 0.1).existence[0]
    beside = lmipda(p, mu, [0.1, 0.99], pd, 0.1).existence[0]
    assert beside < alone


def test_a_batch_is_its_scans_and_missed_scans_lower_existence():
    scans = [scan(seed=seed) for seed in range(6)]
    whole = lmipda(*(np.stack(parts).reshape(2, 3, *parts[0].shape) for parts in zip(*scans, strict=True)))
    for k, one in enumerate(scans):
        for a, b in zip(whole, lmipda(*one), strict=True):
            np.testing.assert_array_equal(a[divmod(k, 3)], b)
    nothing = lmipda(np.zeros((1, 1, 0)), [[1.0]], [0.5], [0.8], 0.1)
    assert nothing.existence == pytest.approx([0.5 * 0.2 / (1 - 0.5 * 0.8)])
    assert nothing.association.tolist() == [[[1.0]]]
    assert lmipda(np.zeros((0, 2, 3)), np.zeros((0, 2)), [], [], 0.1).existence.shape == (0,)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"existence": [1.5, 0.5, 0.5]}, r"existence\[0\] is 1\.5, expected probabilities"),
        ({"likelihood": -np.ones((3, 2, 4))}, r"likelihood\[0, 0, 0\] is -1\.0, expected finite numbers >= 0"),
        ({"pd": [0.5, 1.0, 0.5]}, r"pd\[1\] is 1\.0, expected probabilities in \(0, 1\)"),
        ({"clutter_density": 0.0}, "clutter_density.* is 0.0, expected finite numbers > 0"),
        ({"models": np.ones((3, 3))}, r"have the shapes \(3, 2, 4\), \(3, 3\), \(3,\), \(3,\) and \(3, 4\), expected"),
        ({"existence": [0.5]}, "have the shapes"),
        ({"models": np.ones((3, 2))}, r"the sum of models\[0\] is 2\.0, expected 1"),
        ({"likelihood": np.full((3, 2, 4), 1e308), "clutter_density": 1e-9}, r"likelihood goes up to 1e\+308"),
        ({"gate_probability": 0.0}, "gate_probability is 0.0"),
    ],
)
def test_mistakes(change, message):
    names = ("likelihood", "models", "existence", "pd", "clutter_density")
    with pytest.raises(InputError, match=message):
        lmipda(**{**dict(zip(names, scan(), strict=True)), **change})
