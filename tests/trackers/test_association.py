"""Joint association against brute-force enumeration in exact rational arithmetic, and the laws it must obey.

LMIPDA against the paper's equations in plain loops, IPDA for one track, and the laws of probabilities.
"""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.trackers import association_kernels as kernels
from wavegym.trackers import joint_association, lmipda


def enumerate_associations(W):
    """Marginals and log evidence of the weights W (T, M+1), from every feasible association."""
    T, columns = W.shape
    exact = [[Fraction(float(w)) for w in row] for row in W]
    marginal, Z = [[Fraction(0)] * columns for _ in range(T)], Fraction(0)
    for choice in itertools.product(range(columns), repeat=T):
        taken = [m for m in choice if m > 0]
        if len(set(taken)) == len(taken):
            weight = math.prod((exact[t][m] for t, m in enumerate(choice)), start=Fraction(1))
            Z += weight
            for t, m in enumerate(choice):
                marginal[t][m] += weight
    shift = Z.numerator.bit_length() - Z.denominator.bit_length()
    log_evidence = math.log(float(Z / Fraction(2) ** shift)) + shift * math.log(2.0)
    return np.array([[float(p / Z) for p in row] for row in marginal]).reshape(W.shape), log_evidence


def solve(W):
    """The kernels' marginals, log evidence, and the log evidence of the forward pass alone."""
    W = np.ascontiguousarray(W)
    T, M = W.shape[0], W.shape[1] - 1
    beta = np.empty_like(W)
    return beta, kernels.associate_one(W, T, M, beta), kernels.log_evidence_one(W, T, M, np.empty(2**T))


def assert_exact(W):
    beta, log_evidence, forward = solve(W)
    wanted, log_wanted = enumerate_associations(W)
    np.testing.assert_allclose(beta, wanted, rtol=0.0, atol=1e-12)
    # the logarithm of a number as large as e^1000 resolves it to 1e-13 only
    np.testing.assert_allclose([log_evidence, forward], log_wanted, rtol=1e-12, atol=1e-12)


def scene(seed, T, M, lead=()):
    """likelihood, pd, clutter density of a random scene, half of the likelihoods gated out."""
    rng = np.random.default_rng([seed, T, M])
    N = np.where(rng.random((*lead, T, M)) < 0.5, rng.lognormal(size=(*lead, T, M)), 0.0)
    return N, rng.uniform(0.05, 0.95, (*lead, T)), rng.uniform(0.1, 2.0, lead)


@pytest.mark.parametrize("T", [1, 2, 3, 4])
@pytest.mark.parametrize("M", [0, 1, 3, 6])
def test_equals_enumeration(T, M):
    for seed in range(3):
        N, pd, rho = scene(seed, T, M)
        W = np.concatenate([1.0 - 0.9 * pd[:, None], pd[:, None] * N / rho], axis=1)
        beta, log_evidence = joint_association(N, pd, rho, 0.9)
        wanted, log_wanted = enumerate_associations(W)
        np.testing.assert_allclose(beta, wanted, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(log_evidence, log_wanted, rtol=1e-12, atol=1e-12)
        assert_exact(W)


@st.composite
def weights(draw):
    """Problems whose weights span 1e-200 to 1e200; any may be 0 but "missed", so that one association is feasible."""
    T, M = draw(st.integers(1, 4)), draw(st.integers(0, 4))
    power = st.one_of(st.floats(-200.0, 200.0), st.sampled_from([-200.0, 0.0, 200.0]))
    entry = st.one_of(st.just(0.0), power.map(lambda x: 10.0**x))
    rows = [[10.0 ** draw(power)] + [draw(entry) for _ in range(M)] for _ in range(T)]
    return np.array(rows)


@settings(max_examples=100)
@given(weights())
def test_equals_enumeration_at_any_scale(W):
    assert_exact(W)


@pytest.mark.parametrize("T", [1, 2, 3, 4])
def test_targets_that_all_need_one_measurement(T):
    """Z is then 1e-600 of the product of the best weights: beyond the range of a double."""
    W = np.full((T, 3), 1e-200)
    W[:, 1] = 1e200
    assert_exact(W)
    W[:, 2] = 0.0
    W[:, 0] *= np.arange(1, T + 1)
    assert_exact(W)


@pytest.mark.parametrize("T", [1, 2, 3])
def test_certain_detection_and_no_feasible_association(T):
    W = np.zeros((T, T + 1))
    W[:, 1:] = np.random.default_rng(T).random((T, T))
    assert_exact(W)  # no target is missed
    beta, *evidences = solve(np.ascontiguousarray(W[:, :T]))  # one measurement too few
    assert np.isnan(beta).all()
    assert np.isnan(evidences).all()


@pytest.mark.parametrize("sizes", [(1, 1), (2, 1), (1, 3, 2), (4, 2), (2, 2, 1, 3)])
def test_disjoint_gates_factorise_exactly(sizes):
    """Interleaved clusters of one to four targets: solved together they equal each cluster alone, bit for bit."""
    rng, M = np.random.default_rng(sum(sizes)), 5
    labels, gates = rng.permutation(np.repeat(np.arange(len(sizes)), sizes)), rng.permutation(len(sizes) * M)
    N, pd, rho = np.zeros((sum(sizes), gates.size)), np.empty(sum(sizes)), 0.7
    parts = []
    for i in dict.fromkeys(labels):  # in the order of their first targets, as the sum of the log evidences goes
        targets, gate = np.flatnonzero(labels == i), np.sort(gates[M * i : M * (i + 1)])
        likelihood, pd[targets], _ = scene(i, targets.size, M)
        likelihood[:, 2] += 1.0  # all of a cluster share this one
        N[np.ix_(targets, gate)] = likelihood
        parts.append((targets, gate, joint_association(likelihood, pd[targets], rho)))
    beta, log_evidence = joint_association(N, pd, rho)
    total = 0.0
    for targets, gate, alone in parts:
        assert (beta[np.ix_(targets, [0, *(gate + 1)])] == alone.probabilities).all()
        total += alone.log_evidence
    assert log_evidence == total


@settings(max_examples=50)
@given(st.integers(0, 1000), st.integers(1, 5), st.integers(1, 6), st.randoms(use_true_random=False))
def test_order_does_not_matter_and_rows_are_probabilities(seed, T, M, random):
    N, pd, rho = scene(seed, T, M)
    rows, columns = random.sample(range(T), T), random.sample(range(M), M)
    beta, log_evidence = joint_association(N, pd, rho)
    other, log_other = joint_association(N[np.ix_(rows, columns)], pd[rows], rho)
    np.testing.assert_allclose(other, beta[np.ix_(rows, [0, *(m + 1 for m in columns)])], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(log_other, log_evidence, rtol=1e-12, atol=1e-12)
    assert (beta >= 0.0).all()
    np.testing.assert_allclose(beta.sum(-1), 1.0, rtol=0.0, atol=1e-13)
    assert (beta[:, 1:].sum(0) <= 1.0 + 1e-13).all()  # no measurement belongs to two targets
    assert (beta[:, 1:][N == 0.0] == 0.0).all()


@pytest.mark.parametrize(("T", "M"), [(10, 50), (2, 1500), (1, 5000)])
def test_large_problems(T, M):
    N, pd, rho = scene(0, T, M)
    beta, log_evidence = joint_association(N, pd, rho)
    np.testing.assert_allclose(beta.sum(-1), 1.0, rtol=0.0, atol=1e-12)
    other = joint_association(N[::-1, ::-1], pd[::-1], rho)
    np.testing.assert_allclose(other.probabilities[::-1, 1:][:, ::-1], beta[:, 1:], rtol=1e-10)
    np.testing.assert_allclose(other.log_evidence, log_evidence, rtol=1e-10)


def test_a_batch_equals_its_elements_bit_for_bit():
    N, pd, rho = scene(0, 3, 4, lead=(5, 2))
    beta, log_evidence = joint_association(N, pd, rho)
    assert beta.shape == (5, 2, 3, 5)
    assert log_evidence.shape == (5, 2)
    for i in np.ndindex(5, 2):
        alone = joint_association(N[i], pd[i], rho[i])
        assert (alone.probabilities == beta[i]).all()
        assert alone.log_evidence == log_evidence[i]
    shared = joint_association(N, pd[0, 0], rho[:, :1])  # leading axes broadcast
    assert (shared.probabilities[3, 1] == joint_association(N[3, 1], pd[0, 0], rho[3, 0]).probabilities).all()


def test_no_measurements_and_no_targets():
    beta, log_evidence = joint_association(np.zeros((4, 2, 0)), [0.9, 0.5], 1e-4)
    assert (beta == np.ones((4, 2, 1))).all()
    np.testing.assert_allclose(log_evidence, math.log(0.1 * 0.5), rtol=1e-14)
    beta, log_evidence = joint_association(np.zeros((4, 0, 3)), np.zeros((4, 0)), 1e-4)
    assert beta.shape == (4, 0, 4)
    assert (log_evidence == 0.0).all()


def test_kernels_use_the_leading_block_of_larger_arrays():
    W = np.random.default_rng(0).random((2, 4))
    large, beta = np.full((5, 9), np.nan), np.full((5, 9), 7.0)
    large[:2, :4] = W
    expected, log_evidence, forward = solve(W)
    assert kernels.associate_one(large, 2, 3, beta) == log_evidence
    assert kernels.log_evidence_one(large, 2, 3, np.empty(8)) == forward
    assert (beta[:2, :4] == expected).all()
    assert (beta[2:] == 7.0).all()
    assert (beta[:, 4:] == 7.0).all()


def test_too_many_targets_in_one_cluster():
    N = np.zeros((3, 12, 12))
    N[2, :, :] = np.eye(12) + np.eye(12, k=1)  # a chain: neighbours share a measurement
    with pytest.raises(InputError, match="12 targets share measurements in environment 2, expected at most 10"):
        joint_association(N, np.full(12, 0.9), 1.0)
    N[2, 5, 6] = 0.0  # broken into two chains of six
    beta, _ = joint_association(N, np.full(12, 0.9), 1.0)
    np.testing.assert_allclose(beta.sum(-1), 1.0, rtol=0.0, atol=1e-13)
    assert np.isnan(kernels.log_evidence_one(np.ones((11, 2)), 11, 1, np.empty(2**11)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pd": [0.9, 1.0]}, r"pd\[1\] is 1.0, expected probabilities in \(0, 1\)"),
        ({"pd": [0.0, 0.5]}, r"pd\[0\] is 0.0"),
        ({"pd": [np.nan, 0.5]}, r"pd\[0\] is nan"),
        ({"pd": [0.5, 0.5, 0.5]}, r"shapes \(2, 3\), \(3,\) and \(\)"),
        ({"pd": 0.5}, r"expected \(..., T, M\), \(..., T\)"),
        ({"likelihood": np.ones(2)}, r"expected \(..., T, M\)"),
        ({"likelihood": np.ones((4, 2, 3)), "clutter_density": np.ones(3)}, "leading axes that broadcast"),
        ({"likelihood": np.full((2, 3), -1.0)}, r"likelihood\[0, 0\] is -1.0, expected finite numbers >= 0"),
        ({"likelihood": np.full((2, 3), np.inf)}, r"likelihood\[0, 0\] is inf"),
        ({"likelihood": np.full((2, 3), 1e300), "clutter_density": 1e-20}, "is inf, expected numbers below 1e308"),
        ({"clutter_density": 0.0}, "clutter_density is 0.0, expected finite numbers > 0"),
        ({"clutter_density": -1.0}, "clutter_density is -1.0"),
        ({"clutter_density": np.inf}, "clutter_density is inf"),
        ({"gate_probability": 0.0}, r"gate_probability is 0.0, expected a probability in \(0, 1\]"),
        ({"gate_probability": 1.1}, "gate_probability is 1.1"),
        ({"gate_probability": np.nan}, "gate_probability is nan"),
    ],
)
def test_bad_input(change, message):
    good = {"likelihood": np.ones((2, 3)), "pd": [0.5, 0.5], "clutter_density": 1.0}
    with pytest.raises(InputError, match=message) as caught:
        joint_association(**(good | change))
    assert "\n" not in str(caught.value)


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
