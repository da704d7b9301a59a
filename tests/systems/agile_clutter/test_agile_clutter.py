"""The agile-clutter system's worlds, episodes, figures and consistency."""

from __future__ import annotations

from itertools import pairwise, product

import agile_clutter_oracle as plain
import numpy as np
import oracles
import pytest
from scipy.stats import chi2

from wavegym.core import shortcuts, trees
from wavegym.systems.agile_clutter.system import AgileClutter

TRACKERS = ("jpda", "particle", "mixture")
THERE = np.array([[1 <= k <= 25, 8 <= k <= 32] for k in range(33)])  # the paper's targets at k = 0..32


def play(system, worlds, choose=None):
    """States at k = 0, 1, ...; ``choose`` maps a belief to actions, by default the myopic ones."""
    states = [system.initial(worlds)]
    for _ in range(system.horizon):
        actions = (choose or shortcuts.best_action.of(system))(states[-1].belief)
        states.append(system.transition(states[-1], actions, worlds))
    return states


def at_random(system, seed=0):
    rng = np.random.default_rng(seed)
    return lambda belief: rng.integers(len(system.actions), size=(len(belief.step), len(system.sensors)))


def figures(system, states, name):
    """One key figure, (k, env, ...)."""
    return np.array([system.state_info(state)[name] for state in states])


def same(a, b):
    """Equal bit for bit, particles and all."""
    unequal = []
    trees.tree_map(lambda x, y: unequal.append(not np.array_equal(x, y)), a, b)
    return not any(unequal)


def test_first_estimates_and_true_paths_have_their_distributions():
    system, count = AgileClutter(q=3.0), 1000
    state = system.initial(oracles.worlds(system, count))
    np.testing.assert_array_equal(state.truth.targets, np.broadcast_to(system.starts, (count, 2, 4)))
    error = (state.truth.first - state.truth.targets) / np.sqrt(system.prior_variance)
    F, Q = plain.transition(system)
    path = state.truth.path
    assert path.shape == (count, 2, 26, 4)
    moves = path[:, :, 1:] - path[:, :, :-1] @ F.T
    white = np.linalg.solve(np.linalg.cholesky(Q), moves.reshape(-1, 4).T)
    for draws in (error.reshape(-1, 4).T, white):
        n = draws.shape[1]
        assert np.abs(draws.mean(axis=1)).max() < 5 / np.sqrt(n)
        assert np.abs(np.cov(draws) - np.eye(4)).max() < 5 * np.sqrt(2 / n)
    np.testing.assert_array_equal(
        state.belief.covariance, np.broadcast_to(np.diag(system.prior_variance), (count, 2, 4, 4))
    )


@pytest.mark.parametrize("tracker", TRACKERS)
def test_targets_come_and_go_at_their_steps(tracker):
    """Target 1 is measured at k = 1..25, target 2 at k = 8..32; an absent target costs nothing and is not updated."""
    system = AgileClutter(tracker=tracker, particles=50)
    states = play(system, oracles.worlds(system, 3), at_random(system))
    np.testing.assert_array_equal(figures(system, states, "present"), np.repeat(THERE[:, None], 3, axis=1))
    for name in ("position_error", "squared_error", "nees"):
        np.testing.assert_array_equal(figures(system, states, name) > 0, np.repeat(THERE[:, None], 3, axis=1))
    for k, (before, after) in enumerate(pairwise(states), start=1):
        P = np.diagonal(after.belief.covariance, axis1=2, axis2=3).sum(axis=2)
        np.testing.assert_allclose(system.cost(after.belief), (P * THERE[k]).sum(axis=1), rtol=1e-14)
        moved = (before.belief.mean != after.belief.mean).any(axis=(0, 2))
        np.testing.assert_array_equal(moved, THERE[k] | (np.array(system.births) == k))
        for t in np.flatnonzero(THERE[k]):
            want = after.truth.path[:, t, k - system.births[t]]
            np.testing.assert_array_equal(after.truth.targets[:, t], want)
        assert system.terminal(after.belief).all() == (k == 32)
    assert system.terminates


def test_figures_are_errors_and_mahalanobis_distances():
    system = AgileClutter(weights=(1.0, 2.0, 0.5, 0.25))
    state = play(system, oracles.worlds(system, 4))[10]
    d, P, got = state.belief.mean - state.truth.targets, state.belief.covariance, system.state_info(state)
    np.testing.assert_allclose(got["position_error"], np.hypot(d[..., 0], d[..., 1]), rtol=1e-12)
    np.testing.assert_allclose(got["squared_error"], (d * d) @ system.weights, rtol=1e-12)
    nees = np.einsum("eta,eta->et", d, np.linalg.solve(P, d[..., None])[..., 0])
    np.testing.assert_allclose(got["nees"], nees, rtol=1e-9)
    cost = (np.diagonal(P, axis1=2, axis2=3) @ system.weights).sum(axis=1)
    np.testing.assert_allclose(system.cost(state.belief), cost, rtol=1e-12)


def test_every_element_of_the_observation_is_as_documented():
    system = AgileClutter()
    states = play(system, oracles.worlds(system, 2), at_random(system))
    for k in (0, 7, 12, 25, 32):
        belief = states[k].belief
        want = {"time_left": 1 - k / 32}
        here = plain.present(system, k + 1)
        x, P = plain.predicted(system, k + 1, belief.mean[1], belief.covariance[1])
        for t in (1, 2):
            here_t, p = here[t - 1], P[t - 1]
            want[f"present_{t}"] = float(here_t)
            want[f"log10_sigma_position_{t}"] = here_t and np.log10(np.sqrt(p[0, 0] + p[1, 1]))
            want[f"log10_sigma_velocity_{t}"] = here_t and np.log10(np.sqrt(p[2, 2] + p[3, 3]))
            for i, site in enumerate(np.array(system.sensors), start=1):
                z, S, _ = plain.unscented(x[t - 1], p, site)
                sigma = np.sqrt(np.diag(S))
                want[f"snr_{t}_{i}"] = here_t and 10 * np.log10(plain.snr(system, z[0]))
                want[f"log10_sigma_r_{t}_{i}"] = here_t and np.log10(sigma[0])
                want[f"log10_sigma_rdot_{t}_{i}"] = here_t and np.log10(sigma[1])
                want[f"correlation_{t}_{i}"] = here_t and S[0, 1] / sigma.prod()
        assert [element.name for element in system.observation_fields] == list(want)
        np.testing.assert_allclose(system.observe(belief)[1], list(want.values()), rtol=1e-7, atol=1e-7)


def inside_bounds(nees, level):
    """Share of the means over worlds, (k, env, target) with 0 where absent, inside their chi-square bounds."""
    there, count = nees[:, 0] > 0, nees.shape[1]
    low, high = chi2.ppf([(1 - level) / 2, (1 + level) / 2], 4 * count) / count
    means = nees.mean(axis=1)[there]
    return ((means > low) & (means < high)).mean()


@pytest.mark.parametrize(
    ("tracker", "reference"),
    list(product(TRACKERS, (50e3, 200e3))),
)
@pytest.mark.slow
def test_trackers_are_consistent_without_clutter(tracker, reference):
    """Mean NEES of 200 worlds inside its 95 % bounds; steps of one target are correlated, hence 0.85 of them."""
    known = {"snr_law": "printed", "clutter_density": 0.0}  # errors are Gaussian and every return is a target's
    system = AgileClutter(tracker=tracker, particles=50, reference_range=reference, **known)
    nees = figures(system, play(system, oracles.worlds(system, 200)), "nees")
    nees[8:11, :, 1] = 0.0  # target 2's first steps: the transform is cautious where P is still wide
    assert inside_bounds(nees[4:], 0.95) > 0.85
    assert inside_bounds(nees[4:], 0.999) == 1.0


@pytest.mark.parametrize("tracker", TRACKERS)
def test_the_belief_holds_no_estimate_before_birth(tracker):
    """Another first estimate of target 2 changes no belief before k = 7, and the slot of target 2 at k = 7."""
    system = AgileClutter(tracker=tracker, particles=20)
    worlds = oracles.worlds(system, 4)
    other = worlds._replace(start=worlds.start + np.array([[0.0], [1.0]]))
    for k, (one, two) in enumerate(zip(play(system, worlds), play(system, other), strict=True)):
        assert same(one.belief, two.belief) == (k < 7), k
        if k == 7:
            shift = two.belief.mean - one.belief.mean
            np.testing.assert_allclose(shift[:, 1], np.tile(np.sqrt(system.prior_variance), (4, 1)), rtol=1e-9)
            assert not shift[:, 0].any()


@pytest.mark.parametrize("tracker", TRACKERS[1:])
def test_trackers_agree_with_jpda_without_clutter(tracker):
    """Every return has one explanation, so every hypothesis is the same unscented filter: equal but for rounding."""
    known = {"particles": 50, "clutter_density": 0.0, "snr_law": "printed"}
    systems = [AgileClutter(tracker=each, **known) for each in ("jpda", tracker)]
    plays = [play(s, oracles.worlds(s, 50), at_random(s)) for s in systems]
    for k, (one, other) in enumerate(zip(*plays, strict=True)):
        d, P = one.belief.mean - other.belief.mean, one.belief.covariance
        distance = np.sqrt(np.einsum("eta,eta->et", d, np.linalg.solve(P, d[..., None])[..., 0]))[:, THERE[k]]
        assert distance.size == 0 or distance.max() < 1e-7, k


@pytest.mark.slow
@pytest.mark.parametrize("chooses", ["myopic", "random"])
def test_particles_do_not_degenerate_in_clutter(chooses):
    """Per step, after the first three: median effective sample size >= 10 %, distinct ancestors >= 5 %."""
    system = AgileClutter(tracker="particle")
    states = play(system, oracles.worlds(system, 40), at_random(system) if chooses == "random" else None)
    assert np.median(figures(system, states, "ess"), axis=1)[4:].min() >= 0.10
    assert np.median(figures(system, states, "ancestors"), axis=1)[4:].min() >= 0.05
    assert figures(system, states, "ess").max() <= 1.0 + 1e-12
    assert figures(system, states, "clutter").sum() > 0
