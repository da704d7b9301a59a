"""The Kershaw-Evans loop against a plain step-by-step version, filterpy, and chi-square."""

from __future__ import annotations

import filterpy.kalman
import numpy as np
import oracles
import pytest
from scipy.stats import chi2

from wavegym.core import shortcuts
from wavegym.evaluation import compare
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition

CA = {"model": "ca", "weights": (1.0, 2.0, 0.5), "prior_variance": (1e4, 1e3, 10.0), "q": 3.0}
# Wide sweeps tie the two errors together: 1 - rho^2 falls to 5e-9, and roundings agree to some eps / (1 - rho^2) only.
MODERATE, WIDE = (0.0, 0.1e6, -0.1e6), (0.0, 1e6, -15e6)


def play(system, worlds, actions):
    """States after each step; actions (env, H)."""
    state, states = system.initial(worlds), []
    for k in range(system.horizon):
        state = system.transition(state, actions[:, k], worlds)
        states.append(state)
    return states


@pytest.mark.parametrize(("sweeps", "tolerance"), [(MODERATE, 1e-10), (WIDE, 1e-6)])
@pytest.mark.parametrize("kwargs", [{"q": 2.0}, CA, {**CA, "start_covariance": "random", "dt": 0.5}])
def test_advance_equals_the_plain_loop_and_filterpy(kwargs, sweeps, tolerance):
    system = KershawEvans(sweeps=sweeps, **kwargs)
    n, dt = len(system.weights), system.dt
    F, Q = oracles.motion(n, dt, system.q)
    pulses = [(k, sweep) for k in system.durations for sweep in sweeps]
    worlds = oracles.worlds(system, 4)
    actions = np.random.default_rng(2).integers(len(pulses), size=(4, system.horizon))
    start, states = system.initial(worlds), play(system, worlds, actions)
    for e in range(4):
        truth, x, P = start.truth.targets[e], start.belief.mean[e], start.belief.covariance[e]
        peer = filterpy.kalman.KalmanFilter(dim_x=n, dim_z=2)
        peer.x, peer.P, peer.F, peer.Q, peer.H = x, P, F, Q, np.eye(2, n)
        for k, state in enumerate(states):
            draws = worlds.normal[e, k + 1]
            truth = F @ truth + np.linalg.cholesky(Q) @ draws[:n]
            R = oracles.received_covariance(*pulses[actions[e, k]], truth[0], system.reference_range)
            z = truth[:2] + np.linalg.cholesky(R) @ draws[n:]
            x, P = oracles.predict(x, P, F, Q)
            x, P = oracles.update(x, P, z - x[:2], np.eye(2, n), R)
            peer.predict()
            peer.update(z, R=R)
            np.testing.assert_allclose(state.truth.targets[e], truth, rtol=1e-10, atol=1e-9)
            for mean, covariance in ((x, P), (peer.x, peer.P)):
                assert oracles.covariance_distance(state.belief.covariance[e], covariance) < tolerance
                assert np.abs((state.belief.mean[e] - mean) / np.sqrt(np.diag(covariance))).max() < 10 * tolerance
            assert state.belief.step[e] == k + 1
            np.testing.assert_allclose(system.cost(state.belief)[e], np.diag(P) @ system.weights, rtol=tolerance)


def test_first_estimate_is_drawn_with_its_covariance():
    system = KershawEvans(**{**CA, "start_covariance": "random"}, horizon=1)
    state = system.initial(oracles.worlds(system, 4000))
    ratio = np.diagonal(state.belief.covariance, axis1=1, axis2=2) / system.prior_variance
    assert ratio.min() > 0.1
    assert ratio.max() < 10.0
    # log10 of the ratio is uniform in [-1, 1]: mean 0 and variance 1/3, to four standard errors
    assert np.abs(np.log10(ratio).mean(axis=0)).max() < 4 * np.sqrt(1 / 3 / 4000)
    error = (state.belief.mean - state.truth.targets) / np.sqrt(np.diagonal(state.belief.covariance, axis1=1, axis2=2))
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 4000 * 3)
    assert low < np.square(error).sum() < high


def test_metrics_are_errors_and_mahalanobis_distance():
    system = KershawEvans(**CA)
    state = system.initial(oracles.worlds(system, 5))
    metrics = system.state_info(state)
    error = (state.belief.mean - state.truth.targets)[:, :2]
    np.testing.assert_array_equal(metrics["position_error"], np.abs(error[:, 0]))
    np.testing.assert_array_equal(metrics["velocity_error"], np.abs(error[:, 1]))
    expected = [e @ np.linalg.solve(P, e) for e, P in zip(error, state.belief.covariance[:, :2, :2], strict=True)]
    np.testing.assert_allclose(metrics["nees"], expected, rtol=1e-10)


@pytest.mark.parametrize("kwargs", [{}, {"action": "box"}, CA])
def test_imagining_at_the_true_range_gives_the_covariance_to_come(kwargs):
    """A target that flies straight, estimated without error, is where the filter predicts it."""
    system = KershawEvans(targets="scripted", script=(), tracker="kalman", **kwargs)
    worlds = oracles.worlds(system, 3)
    state = system.initial(worlds)
    belief = state.belief._replace(mean=state.truth.targets)
    for candidate in system.candidates()[::9]:
        action = np.stack([candidate] * 3)
        predicted = system.predict(belief, action)
        after = system.transition(state._replace(belief=belief), action, worlds)
        np.testing.assert_allclose(predicted.mean, after.truth.targets, rtol=1e-14)
        # the same arithmetic, but for the last bit of the range; S may have a condition number of 1e9
        assert oracles.covariance_distance(predicted.covariance, after.belief.covariance) < 1e-6
        assert (predicted.step == after.belief.step).all()


@pytest.mark.parametrize("kwargs", [{}, {"action": "box"}, CA])
def test_the_innovation_covariance_is_that_at_the_predicted_range(kwargs):
    system = KershawEvans(**kwargs)
    belief = system.initial(oracles.worlds(system, 3)).belief
    shared = system.candidates()[None, ::7]
    pulses = [(k, sweep) for k in system.durations for sweep in system.sweeps][::7]
    ranges = system.predict(belief, shared).mean[:, 0, 0]
    R = [[oracles.received_covariance(*pulse, r, system.reference_range) for pulse in pulses] for r in ranges]
    predicted = shortcuts.next_pulse(system, belief)[0][:, None, :2, :2]
    np.testing.assert_allclose(shortcuts.innovation_covariance(system, belief, shared), predicted + R, rtol=1e-9)


def test_library_and_box_transmit_the_same_pulses():
    library, box = KershawEvans(), KershawEvans(action="box")
    points = box.candidates()
    assert points.shape == (88, 2)
    assert np.abs(points).max() == 1.0
    pulses = [oracles.chirp_covariance(k, sweep) for k in library.durations for sweep in library.sweeps]
    # the box goes by a logarithm and back
    for C in (library.unit_covariance(library.candidates()), box.unit_covariance(points)):
        assert oracles.covariance_distance(C, np.array(pulses)) < 1e-12


@pytest.mark.parametrize("kwargs", [{}, {"q": 100.0, "sweeps": MODERATE}, CA])
def test_the_steady_covariance_is_a_fixed_point(kwargs):
    system = KershawEvans(**kwargs)
    n = len(system.weights)
    F, Q = oracles.motion(n, system.dt, system.q)
    R = oracles.received_covariance(system.durations[4], max(system.sweeps), 185e3, system.reference_range)
    P = system.steady_covariance
    _, ahead = oracles.predict(np.zeros(n), P, F, Q)
    _, ahead = oracles.update(np.zeros(n), ahead, np.zeros(2), np.eye(2, n), R)
    assert oracles.covariance_distance(ahead, P) < 1e-6
    assert (system.initial(oracles.worlds(system, 2)).belief.covariance == P).all()


def test_the_recursion_is_the_loops_covariance():
    system = KershawEvansPosition(horizon=5)
    worlds = oracles.worlds(system, 3)
    recursion = shortcuts.deterministic_recursion(system, worlds)
    actions = np.random.default_rng(1).integers(recursion.R.shape[2], size=(3, 5))
    P = recursion.covariance
    for k, state in enumerate(play(system, worlds, actions)):
        for e in range(3):
            R = recursion.R[e, k, actions[e, k]]
            _, ahead = oracles.predict(np.zeros(2), P[e], recursion.F, recursion.Q)
            _, ahead = oracles.update(np.zeros(2), ahead, np.zeros(2), recursion.M, R)
            assert oracles.covariance_distance(ahead, state.belief.covariance[e]) < 1e-9
        P = state.belief.covariance
    assert (recursion.weights == system.weights).all()


def test_the_tracker_adapts_where_the_targets_are_not_drawn_from_its_model() -> None:
    """The user can choose another tracker."""
    trackers = {targets: KershawEvans(targets=targets)._given_tracker for targets in ("random", "scripted")}
    assert trackers["random"] is None
    assert [model.Q[1, 1] for model in trackers["scripted"].models] == [0.01, 1.0, 100.0]  # q dt
    assert KershawEvans(targets="scripted", tracker="kalman")._given_tracker is None
    assert KershawEvans(truth={"targets": "scripted"})._given_tracker is None  # what the tracker does not know
    assert KershawEvans(tracker="imm", **CA)._given_tracker.models[2].Q[2, 2] == 100.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["myopic", "lookahead:2"])
def test_the_adaptive_tracker_is_better_than_a_kalman_filter_of_the_wrong_noise(name) -> None:
    """Targets that fly straight, then turn hard; the filters assume q = 0.01, q = 1000, or both."""
    script = ((25.0, 0.0), (5.0, 30.0), (5.0, -30.0), (15.0, 0.0))
    error, consistency = {}, {}
    for key, given in {
        "low": {"q": 0.01, "tracker": "kalman"},
        "high": {"q": 1000.0, "tracker": "kalman"},
        "imm": {"densities": (0.01, 1000.0)},
    }.items():
        settings = {"targets": "scripted", "script": script, **given}
        played = compare("wavegym/KershawEvansPosition-v0", [name], worlds=100, jobs=1, **settings).played[name][0]
        error[key], consistency[key] = np.mean(np.square(played.rmse)), np.mean(played.nees)
    assert error["imm"] < 0.8 * min(error["low"], error["high"])
    assert consistency["low"] > 100.0
    assert consistency["imm"] < 3.0


@pytest.mark.parametrize("action", ["library", "box"])
def test_whoever_writes_into_candidates_changes_no_other_system(action):
    wanted = KershawEvans(action=action).candidates().copy()
    KershawEvans(action=action).candidates()[:] = 0
    np.testing.assert_array_equal(KershawEvans(action=action).candidates(), wanted)
