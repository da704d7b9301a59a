"""The JPDA update against plain matrices with brute-force associations, and against the Kalman filter."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from research.information_reduction import integrated_reduction, write_table
from research.information_reduction_kernels import simulated_reduction
from tests.oracles import random_covariance, update
from wavegym.core.errors import InputError
from wavegym.trackers import fitted_information_reduction, information_reduction, jpda_update
from wavegym.trackers.jpda import TABLE, reduction_table
from wavegym.trackers.jpda_kernels import reduction_one

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


PROBABILITIES = st.floats(0.001, 1.0)
CLUTTERS = st.floats(-3.0, 5.0).map(lambda x: 10.0**x)
PD = np.concatenate([np.geomspace(0.001, 0.1, 40), np.linspace(0.1, 1.0, 61)])[:, None]
CLUTTER = np.geomspace(1e-3, 1e5, 211)


def simulated_pda(pd, clutter, scenes, rng, gate=4.0):
    """E[1 - beta_0], E[tr sum beta nu nu'] / 2 and E[tr nu nu'] / 2 samples (scenes, 3), from the PDA's definition."""
    area = np.pi * gate**2
    volume_density, gate_probability = clutter / area, 1 - np.exp(-(gate**2) / 2)
    samples = np.empty((scenes, 3))
    for k in range(scenes):
        returns = rng.uniform(-gate, gate, (rng.poisson(volume_density * 4 * gate**2), 2))
        if rng.random() < pd:
            returns = np.vstack([returns, rng.standard_normal(2)])
        returns = returns[(returns**2).sum(1) < gate**2]
        detected = pd * np.exp(-(returns**2).sum(1) / 2) / (2 * np.pi) / volume_density
        beta = detected / (1 - pd * gate_probability + detected.sum())
        nu = beta @ returns
        samples[k] = beta.sum(), beta @ (returns**2).sum(1) / 2, nu @ nu / 2
    return samples


@pytest.mark.parametrize(("pd", "clutter"), [(0.3, 0.5), (0.6, 20.0), (0.9, 5.0), (0.95, 100.0), (1.0, 1.0)])
@pytest.mark.slow
def test_same_as_a_plain_simulation_of_the_pda(pd, clutter):
    samples = simulated_pda(pd, clutter, 15_000, np.random.default_rng(0))
    q2 = information_reduction(pd, clutter)
    power = samples[:, 2]
    assert q2 == pytest.approx(power.mean(), abs=4 * power.std() / np.sqrt(len(power)) + 1e-3 * q2)
    # as the PDA's covariance update has it: the same and the gate's term
    terms = samples @ [1.0, -1.0, 1.0]
    expected = q2 + pd * 8 * np.exp(-8.0)
    assert expected == pytest.approx(terms.mean(), abs=4 * terms.std() / np.sqrt(len(terms)) + 1e-3 * q2)


@pytest.mark.parametrize(("clutter", "gate"), [(0.01, 4.0), (1.0, 3.0), (30.0, 4.0), (300.0, 5.0)])
def test_integral_is_the_compiled_simulations_mean(clutter, gate):
    pd = np.array([0.05, 0.4, 0.8, 0.99, 1.0])
    mean, error = simulated_reduction(np.uint64(3), 20_000, clutter, gate, pd)
    assert (np.abs(mean - integrated_reduction(pd, clutter, gate)) < 4 * error).all()
    assert (error < 0.05 * mean).all()


def test_shipped_table_is_what_the_script_makes(tmp_path):
    write_table(tmp_path / "again.csv")
    again, shipped = (np.loadtxt(file, delimiter=",", skiprows=1) for file in (tmp_path / "again.csv", TABLE))
    np.testing.assert_allclose(again, shipped, rtol=1e-8)


@pytest.mark.slow
def test_interpolation_error():
    exact = integrated_reduction(PD, CLUTTER)
    np.testing.assert_allclose(information_reduction(PD, CLUTTER), exact, rtol=1e-3)
    faint = np.geomspace(1e-6, 1e-3, 61)[:, None]
    np.testing.assert_allclose(information_reduction(faint, CLUTTER), integrated_reduction(faint, CLUTTER), rtol=1e-2)


def test_beyond_the_grid_are_the_limits():
    pd = np.array([0.02, 0.3, 0.7, 0.99, 1.0])
    limit = 1 - 9 * np.exp(-8.0)
    np.testing.assert_allclose(information_reduction(pd, 0.0), limit * pd, rtol=1e-14)
    np.testing.assert_allclose(information_reduction(pd, 1e-5), integrated_reduction(pd, 1e-5), rtol=1e-3)
    np.testing.assert_allclose(information_reduction(pd, 1e8), 2 * pd**2 / 1e8, rtol=1e-3)
    np.testing.assert_allclose(information_reduction(1e-9, 3.0), 2e-18 / 3.0, rtol=1e-3)
    assert (information_reduction(0.0, [0.0, 1.0, 1e6]) == 0.0).all()


@given(st.tuples(PROBABILITIES, PROBABILITIES), st.tuples(CLUTTERS, CLUTTERS))
def test_rises_with_detection_and_falls_with_clutter(pd, clutter):
    low, high = information_reduction(sorted(pd), clutter[0])
    assert low <= high * (1 + 1e-12)
    few, many = information_reduction(pd[0], sorted(clutter))
    assert few >= many * (1 - 1e-12)
    assert 0.0 < many <= few <= 0.997 * pd[0]


def test_continuous_across_cells():
    pd_grid, log_clutter, _ = reduction_table()
    for edge in (pd_grid[1:-1], None):
        p, n = (edge[:, None], CLUTTER) if edge is not None else (PD, np.exp(log_clutter))
        nudge = (1e-9, 0.0) if edge is not None else (0.0, 1e-9)
        below = information_reduction(p * (1 - nudge[0]), n * (1 - nudge[1]))
        above = information_reduction(p * (1 + nudge[0]), n * (1 + nudge[1]))
        np.testing.assert_allclose(below, above, rtol=1e-7)


@pytest.mark.parametrize(("gate", "bound"), [(3.0, 0.059), (3.5, 0.013), (4.5, 0.0031), (6.0, 0.0031)])
def test_depends_on_the_clutters_density_more_than_on_the_gate(gate, bound):
    same_density = CLUTTER[::10] * gate**2 / 16
    ratio = integrated_reduction(PD, same_density, gate) / integrated_reduction(PD, CLUTTER[::10])
    assert 0.5 * bound < np.abs(ratio - 1).max() < bound


def test_the_published_fit():
    assert fitted_information_reduction(0.8, 3.0) == pytest.approx(0.997 * 0.8 / (1 + 0.37 * 0.8**-1.57 * 3.0))
    assert (fitted_information_reduction(0.0, [0.0, 2.0]) == 0.0).all()
    pd, few = np.linspace(0.5, 1.0, 26)[:, None], np.geomspace(1e-3, 1.0, 31)
    np.testing.assert_allclose(fitted_information_reduction(pd, few), information_reduction(pd, few), rtol=0.09)
    pd, many = np.array([0.1, 0.5, 0.9, 1.0]), 1e4
    ratio = fitted_information_reduction(pd, many) / information_reduction(pd, many)
    np.testing.assert_allclose(ratio - 1, [-0.64, -0.09, 0.27, 0.35], atol=0.01)


def test_shapes_broadcast_and_the_kernel_takes_the_table():
    assert information_reduction(0.5, 2.0).shape == ()
    assert information_reduction(np.full((3, 1), 0.5), np.ones(4)).shape == (3, 4)
    assert information_reduction(np.empty((0, 2)), 1.0).shape == (0, 2)
    tables = reduction_table()
    assert all(t.flags.writeable and t.flags.c_contiguous for t in tables)
    assert reduction_one(0.5, np.log(2.0), *tables) == information_reduction(0.5, 2.0)
    assert np.isnan([reduction_one(np.nan, 0.0, *tables), reduction_one(-0.1, 0.0, *tables)]).all()


@pytest.mark.parametrize("function", [information_reduction, fitted_information_reduction])
def test_bad_detection_or_clutter_is_named(function):
    with pytest.raises(InputError, match=r"pd is 1\.5, expected a number in \[0, 1\] \(nearest: 1\)"):
        function([0.5, 1.5], 1.0)
    with pytest.raises(InputError, match="pd is nan"):
        function(np.nan, 1.0)
    with pytest.raises(InputError, match=r"clutter is -2\.0, expected a finite number >= 0"):
        function(0.5, [[1.0, -2.0]])
    with pytest.raises(InputError, match="clutter is inf"):
        function(0.5, np.inf)
