"""The RF/EO benchmark's peers against a textbook filter in plain NumPy, and against one step of ours."""

from __future__ import annotations

import numpy as np
import pytest

from research.benchmarks import rf_eo as bench
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.systems.rf_eo.system import RfEo

C = 299792458.0
# PRF 10 kHz, bandwidth sqrt(20) MHz, pixel angle 2 pi / 1000 at carrier 10 GHz and 128 pulses
VARIANCES = np.array([C / (2 * np.sqrt(20) * 1e6), C / 10e9 * 10e3 / 256, 2 * np.pi / 1000]) ** 2 / 12
MOVE = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0]])
DRIVE = 0.01 * np.kron(np.eye(2), [[1 / 3, 1 / 2], [1 / 2, 1.0]])
PRIOR = np.diag([100.0, 1.0, 100.0, 1.0])  # of a wider one P - K S K', Stone Soup's form, leaves fewer digits
SITES = ((-1000.0, -1000.0), (1000.0, -1000.0))
PEERS = [bench.Filterpy, bench.StoneSoup]
STARTS = {
    "published": ((-1000.0, 0.0, 1000.0, 0.0), (1000.0, 0.0, 1000.0, 0.0)),
    # Straight behind the platforms, where noise throws measured azimuths from pi to -pi.
    "behind": ((-1000.0, 0.0, -2200.0, 0.5), (1000.0, 0.0, -1900.0, -0.4)),
}


def sensed(x):
    """Ranges, range-rates and tangents of azimuths; analytic, so that complex steps derive it exactly."""
    rows = []
    for px, py in SITES:
        dx, dy = x[0] - px, x[2] - py
        r = np.sqrt(dx * dx + dy * dy)
        rows += [r, (dx * x[1] + dy * x[3]) / r, np.arctan(dx / dy)]
    return np.array(rows)


def azimuths(x):
    return np.array([np.angle(complex(x[2] - py, x[0] - px)) for px, py in SITES])


def textbook(x, P, z):
    """Predict and update in information form: P+ = (P^-1 + H' R^-1 H)^-1."""
    x, P, weight = MOVE @ x, MOVE @ P @ MOVE.T + DRIVE, np.diag(1 / np.tile(VARIANCES, 2))
    H = np.array([sensed(x + 1e-30j * e).imag / 1e-30 for e in np.eye(4)]).T
    predicted = sensed(x)
    predicted[2::3] = azimuths(x)
    y = z - predicted
    y[2::3] = np.angle(np.exp(1j * y[2::3]))
    P = np.linalg.inv(np.linalg.inv(P) + H.T @ weight @ H)
    return x + P @ H.T @ weight @ y, P


def same(mean, covariance, x, P):
    """To 1e-9, of covariances relative to the standard deviations."""
    scale = np.sqrt(np.diag(P))
    np.testing.assert_allclose(mean, x, rtol=1e-9, atol=1e-9 * scale.max())
    np.testing.assert_allclose(covariance / np.outer(scale, scale), P / np.outer(scale, scale), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("peer", PEERS)
@pytest.mark.parametrize("starts", STARTS.values(), ids=STARTS)
def test_the_peers_are_the_textbook_filter(peer, starts):
    rng, truth = np.random.default_rng(1), np.array(starts)
    tracker, beliefs = peer(starts, PRIOR), [(np.array(x), PRIOR) for x in starts]
    seen = []
    for _ in range(40):
        truth = truth @ MOVE.T
        z = np.array([sensed(x) for x in truth])
        z[:, 2::3] = [azimuths(x) for x in truth]
        z += np.sqrt(np.tile(VARIANCES, 2)) * rng.standard_normal(z.shape)
        z[:, 2::3] = np.angle(np.exp(1j * z[:, 2::3]))
        seen.append(z[:, 2::3])
        total = tracker.step(list(z))
        beliefs = [textbook(x, P, zi) for (x, P), zi in zip(beliefs, z, strict=True)]
        for (x, P), (mean, covariance) in zip(beliefs, tracker.beliefs, strict=True):
            same(mean, covariance, x, P)
        assert total == pytest.approx(sum(np.trace(P) for _, P in beliefs), rel=1e-9)
    jumps = np.count_nonzero(np.abs(np.diff(seen, axis=0)) > np.pi)
    assert jumps > 20 if starts is STARTS["behind"] else jumps == 0


@pytest.mark.parametrize("peer", PEERS)
def test_ours_does_the_same_step(peer):
    """With everything in view and no iterations the environment's tracker has the peers' posterior."""
    system = RfEo(horizon=3, iterations=1, first_estimate="drawn", prior_variance=tuple(np.diag(PRIOR)))
    world = draw_worlds(system, world_seeds(0, "test", 1))
    state = system.initial(world)
    tracker = peer(state.belief.mean[0], PRIOR)
    deviation, _ = bench.decode(bench.WIDE)
    for k in range(system.horizon):
        state = system.transition(state, bench.WIDE[None], world)
        np.testing.assert_array_equal(state.truth.received, 6)
        errors = np.swapaxes(world.error[0, k], 0, 1).reshape(2, 6)
        tracker.step([bench.measure(x) + deviation * e for x, e in zip(state.truth.targets[0], errors, strict=True)])
        for t, (mean, covariance) in enumerate(tracker.beliefs):
            same(state.belief.mean[0, t], state.belief.covariance[0, t], mean, covariance)


def test_peers_decode_and_observe_what_the_environment_does():
    system = RfEo()
    deviation, edge = bench.decode(bench.WIDE)
    view = system.action_set.view(system.action_set.settings(bench.WIDE))
    np.testing.assert_allclose(deviation, np.sqrt(view.variance).ravel(), rtol=1e-12)
    np.testing.assert_allclose(edge, np.minimum(view.high, [np.inf, np.inf, np.pi]).ravel(), rtol=1e-12)
    world = draw_worlds(system, world_seeds(0, "test", 1))
    state = system.initial(world)
    for _ in range(5):
        belief = state.belief
        looks = [bench.look(x, P, deviation) for x, P in zip(belief.mean[0], belief.covariance[0], strict=True)]
        ours = system.observe(belief).reshape(2, 14)
        state = system.transition(state, bench.WIDE[None], world)
        for (elements, _), own in zip(looks, ours, strict=True):
            raw = np.concatenate([elements[:2] * 0.5, np.stack([elements[2:8], elements[8:] * 0.5], 1).ravel()])
            np.testing.assert_allclose(own, raw, atol=1e-9)
        least = min(information for _, information in looks)
        np.testing.assert_allclose(system.state_info(state)["information"], least, rtol=1e-9)


@pytest.mark.parametrize("peer", PEERS)
def test_the_simulated_targets_stay_tracked(peer):
    tracker = peer()
    assert bench.simulate(tracker, 200) == 200
    assert all(np.trace(covariance) < 20.0 for _, covariance in tracker.beliefs)
