"""The tracker of the turning camera: long coasting, looks that find nothing, consistency, the price of a lost track.

Oracles: the linear recursion of Cartesian moments, a grid over the azimuth, and the chi-square distribution.
"""

from __future__ import annotations

import numpy as np
import oracles
import pytest
from camera_episodes import index_rule, play, wrap
from scipy.stats import chi2, norm

from wavegym.schedulers.registry import make_policy
from wavegym.systems.camera_slew.system import CameraSlew

BLIND = {"nearest_range": 1e9}  # a platform nearer than this measures nothing


def at_random(system, seed=0):
    """Looks that last five steps on average."""
    rng, action = np.random.default_rng(seed), 0

    def choose(belief):
        nonlocal action
        shape = len(belief.step)
        action = np.where(rng.random(shape) < 0.2, rng.integers(system.targets, size=shape), action)
        return action

    return choose


def myopic(system):
    """The least cost one step ahead."""
    return lambda belief: system.cost(system.predict(belief, np.arange(system.targets)[None])).argmin(axis=1)


def test_without_measurements_the_moments_are_those_of_the_linear_motion():
    """Sixty steps, at the end 500 m of spread at 3 km: errors below 2 % of a correlation and of a deviation."""
    system = CameraSlew(**BLIND)
    worlds = oracles.worlds(system, 20)
    state = system.initial(worlds)
    mean, P, (F, Q) = state.belief.mean, state.belief.covariance, (system.motion.F, system.motion.Q)
    for _ in range(60):
        state = system.transition(state, np.zeros(20, int), worlds)
        mean, P = mean @ F.T, F @ P @ F.T + state.belief.q[:, :, None, None] * Q
        deviation = np.sqrt(np.einsum("etii->eti", P))
        assert (np.abs(state.belief.mean - mean) < 0.02 * deviation).all()
        off = np.abs(state.belief.covariance - P)
        assert (off < 0.02 * deviation[..., :, None] * deviation[..., None, :]).all()
    assert np.einsum("etii->et", P).max() > 400**2
    assert (state.truth.received == 0).all()


@pytest.mark.parametrize("detection", [0.7, 1.0])
@pytest.mark.parametrize("off", [0.0, 0.1, -0.25])
def test_a_look_that_finds_nothing_is_evidence(detection, off):
    """Mean and variance of the azimuth against a grid: the prior times the probability of not being found."""
    system = CameraSlew(horizon=3, detection=detection, targets=2, shown=(9, 9), hidden=(0, 0), q=(1e-9, 1e-9))
    state = system.initial(oracles.worlds(system, 1))
    belief = state.belief
    belief.polar_covariance[:, 0, 2, 2], belief.polar_covariance[:, 0, 0, 2] = 0.12**2, 0.4
    belief.polar_covariance[:, 0, 2, 0], belief.mean[:, 1] = 0.4, belief.mean[:, 0]
    belief.polar_mean[:, 0, 2] += off  # the camera points to target 2, where target 1 was before
    belief = belief._replace(pointing=np.arctan2(belief.mean[:, 1, 0], belief.mean[:, 1, 2]))
    nothing = system.measure(state.truth, belief, np.array([1]), oracles.worlds(system, 1))
    nothing = type(nothing)(nothing.z, np.full(nothing.z.shape, np.inf))
    missed = system.track(belief, np.array([1]), nothing)
    hidden = system.track(belief._replace(visible=np.zeros_like(belief.visible)), np.array([1]), nothing)
    at, sigma = hidden.polar_mean[0, 0, 2], np.sqrt(hidden.polar_covariance[0, 0, 2, 2])
    grid = at + sigma * np.linspace(-9, 9, 400_001)
    weight = norm.pdf(grid, at, sigma) * (
        1 - detection * (np.abs(wrap(grid - missed.pointing[0])) <= system.half_field)
    )
    mean = np.average(grid, weights=weight)
    variance = np.average((grid - mean) ** 2, weights=weight)
    assert missed.polar_mean[0, 0, 2] == pytest.approx(mean, abs=1e-5)
    assert missed.polar_covariance[0, 0, 2, 2] == pytest.approx(variance, rel=1e-4)
    slope = hidden.polar_covariance[0, 0, 0, 2] / sigma**2  # the range follows by its regression on the azimuth
    assert missed.polar_mean[0, 0, 0] - hidden.polar_mean[0, 0, 0] == pytest.approx(slope * (mean - at), abs=1e-3)
    assert missed.polar_covariance[0, 0, 0, 2] == pytest.approx(slope * variance, rel=1e-4)


CONSISTENT = [
    ({}, at_random),
    ({}, index_rule),
    ({}, myopic),
    ({"platforms": ((0.0, 0.0), (3e3, 0.0))}, at_random),
    ({"turn_rate": 0.05}, at_random),
]


@pytest.mark.parametrize(("settings", "policy"), CONSISTENT)
def test_the_tracker_is_consistent_in_every_step(settings, policy):
    """Mean NEES of 300 worlds, four targets: 4 within 5 standard errors in each of 60 steps, within 4 over all steps.

    The errors of one step have the chi-square distribution; over the steps they may be wholly correlated.
    """
    system = CameraSlew(**settings)
    states, _ = play(system, oracles.worlds(system, 300, 1), policy(system))
    nees = np.array([system.state_info(state)["nees"] for state in states[1:]])
    count = nees[0].size
    low, high = chi2.ppf(norm.cdf([-5, 5]), 4 * count) / count
    means = nees.mean(axis=(1, 2))
    assert ((means > low) & (means < high)).all(), means
    low, high = chi2.ppf(norm.cdf([-4, 4]), 4 * count) / count
    assert low < means.mean() < high


@pytest.mark.slow
def test_the_believed_error_is_the_true_one():
    """Best heuristic, 10,000 worlds: squared error over believed variance and NEES within 4 standard errors of a world.

    In 300 worlds the ratio has a standard deviation of 0.05, because single wide tracks make up a large part of its
    sums: of one track in two thousand the standard deviation of the azimuth exceeds 0.1 rad.
    """
    system, count = CameraSlew(), 10_000
    worlds, rule = oracles.worlds(system, count), make_policy("best-simple", system, None)
    rule.begin(system, count, np.random.default_rng(0))
    state, sums = system.initial(worlds), np.zeros((3, count))
    for _ in range(system.horizon):
        state = system.transition(state, rule.act(state.belief, None, None), worlds)
        figures = system.state_info(state)
        of_step = figures["position_error"] ** 2, figures["position_variance"], figures["nees"]
        sums += np.sum(of_step, axis=2)
    error, believed, nees = sums / (system.horizon * system.targets)
    ratio = error.sum() / believed.sum()
    assert abs(ratio - 1.0) < 4 * np.std(error - ratio * believed) / believed.mean() / np.sqrt(count)
    assert abs(nees.mean() - 4.0) < 4 * nees.std() / np.sqrt(count)


def test_misses_count_in_the_consistency():
    """A camera that searches for one target with a spread of its image's size, over 400 worlds and 6 steps.

    Where the misses are left out (a camera out of sight changes nothing), the NEES of targets not found is too large.
    """
    system = CameraSlew(
        horizon=6, targets=1, detection=0.9, settle=0, shown=(9, 9), hidden=(0, 0), sector=(-0.1, 0.1),
        ranges=(1e3, 1.1e3), prior_variance=(2.5e4, 1.0, 2.5e4, 1.0)
    )  # fmt: skip
    worlds = oracles.worlds(system, 1000)
    state = deaf = system.initial(worlds)
    for _ in range(3):
        action = np.zeros(1000, int)
        truth = system.move(state.truth, state.belief.step, worlds)
        report = system.measure(truth, state.belief, action, worlds)
        hidden = deaf.belief._replace(visible=np.zeros_like(deaf.belief.visible))
        deaf = deaf._replace(truth=truth, belief=system.track(hidden, action, report))
        state = system.transition(state, action, worlds)
    lost = state.truth.unseen[:, 0] == 3
    counted, left_out = (system.state_info(s)["nees"][lost, 0].mean() for s in (state, deaf))
    assert lost.sum() > 100
    assert counted < 4 + 5 * np.sqrt(8 / lost.sum())
    assert left_out > 4 + 5 * np.sqrt(8 / lost.sum())


def test_a_camera_that_finds_nothing_costs_more():
    costs = []
    for truth in (None, {"detection": 0.0}):
        system = CameraSlew(truth=truth)
        states, _ = play(system, oracles.worlds(system, 40), index_rule(system))
        costs.append(np.mean([system.cost(state.belief) for state in states]))
        assert any(state.truth.seen.any() for state in states) == (truth is None)
    assert costs[1] > 2 * costs[0]


@pytest.mark.parametrize("policy", [index_rule, myopic])
@pytest.mark.parametrize("since", [0, 20, 40])
def test_losing_a_track_never_pays(policy, since):
    """Paired worlds in which the camera never finds target 1 from a step on: the cost rises."""
    system = CameraSlew()
    worlds = oracles.worlds(system, 100, 4)
    found = worlds.found.copy()
    found[:, since:, 0] = 1.0
    costs = []
    for tape in (worlds, worlds._replace(found=found)):
        states, _ = play(system, tape, policy(system))
        costs.append(np.array([system.cost(state.belief) for state in states[1:]]))
    np.testing.assert_array_equal(costs[0][:since], costs[1][:since])
    gain = (costs[0] - costs[1])[since:].mean(axis=0)
    assert gain.mean() + 3 * gain.std() / np.sqrt(len(gain)) < 0
