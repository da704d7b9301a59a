"""Folded echoes before RF/EO platforms: what is received, what the tracker believes, what schedulers predict."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
import rf_eo_oracle as plain
from scipy.stats import norm

from wavegym.core import shortcuts
from wavegym.sensors import folding_kernels as folding
from wavegym.sensors import platform_measurement
from wavegym.systems.rf_eo.system import RfEo, RfEoFar
from wavegym.waveforms import PulseTiming

FOUR = ((-5e3, 0.0, 20e3, 230.0), (0.0, 0.0, 30e3, -210.0), (12e3, -150.0, 45e3, 60.0), (-20e3, 180.0, 55e3, -120.0))
CLOSED = [
    {},
    {"q": 30.0, "starts": FOUR},
    {"platforms": ((0.0, -10e3),), "starts": FOUR[:1], "looks": (0.1,)},
    {"prior_variance": (9e6, 2500.0, 9e6, 2500.0), "duty": 0.0, "notch": 0.0},
    {"iterations": 1, "duty": 0.3, "margin": 0.0},
    {"starts": ((-9.9e3, 40.0, -9.8e3, 90.0),), "nearest_range": 300.0},
]


def at_random(system, count, seed=0):
    rng = np.random.default_rng(seed)
    return lambda belief: rng.uniform(-1, 1, (count, len(system.actions)))


def closed_loop(system, worlds, choose):
    """(state before, action, state after) of every step."""
    state = system.initial(worlds)
    for _ in range(system.horizon):
        action = choose(state.belief)
        before, state = state, system.transition(state, action, worlds)
        yield before, action, state


@pytest.mark.slow
@pytest.mark.parametrize("settings", CLOSED, ids=str)
def test_transition_and_prediction_are_the_plain_ones(settings):
    """Against all hypotheses listed and whole matrices, from each state of an episode with random settings.

    Predictions are sums of normal distributions and matrices in doubles: 1e-6 of their covariance; repeated
    regressions converge slowly, as without folding.
    """
    system = RfEoFar(horizon=8, **settings)
    worlds, uncertain = oracles.worlds(system, 3, seed=4), 0
    for before, action, state in closed_loop(system, worlds, at_random(system, 3)):
        chosen, k = system.action_set.settings(action), before.belief.step[0]
        predicted = system.predict(before.belief, action)
        for e in range(3):
            shares = []
            for t in range(len(system.starts)):
                mean, P = before.belief.mean[e, t], before.belief.covariance[e, t]
                ahead = plain.predict_ahead(system, mean, P, chosen[e])
                shares.append(ahead.share)
                assert oracles.covariance_distance(predicted.covariance[e, t], ahead.covariance) < 1e-6, (k, e, t)
                draws = worlds.process[e, k, t], worlds.error[e, k, :, t]
                want = plain.step(system, before.truth.targets[e, t], mean, P, chosen[e], *draws)
                assert state.truth.received[e, t] == want.received
                limit, sigma = 0.01 if want.regressed else 1e-5, np.sqrt(np.diag(want.covariance))
                assert oracles.covariance_distance(state.belief.covariance[e, t], want.covariance) < limit, (k, e, t)
                assert np.abs((state.belief.mean[e, t] - want.mean) / sigma).max() < limit, (k, e, t)
                uncertain += want.received > 0 and sigma[0] > 100.0
            np.testing.assert_allclose(state.truth.share[e], min(shares), rtol=1e-6)
    assert uncertain or settings  # the plain scene has steps whose folds are not certain


def test_what_is_received_is_folded_and_outside_blind_zones_and_notches():
    """Blind zones and widths are those of ``PulseTiming``, whose pulse lasts duty/PRF."""
    system = RfEoFar(horizon=40)
    worlds, seen = oracles.worlds(system, 6), []
    for before, action, after in closed_loop(system, worlds, at_random(system, 6)):
        report = system.measure(after.truth, before.belief, action, worlds)
        settings = system.action_set.settings(action)
        true = platform_measurement(after.truth.targets[:, :, None], system.places)
        for e, j in np.ndindex(6, 2):
            prf = settings[e, j, 0]
            timing = PulseTiming(duration=system.duty / prf, carrier_hz=system.carrier_hz, interval=1 / prf, count=128)
            for t in range(2):
                r, rdot, _ = true[e, t, j]
                zones = timing.range_blind_zones(r + 1e5), timing.velocity_blind_zones(system.notch, abs(rdot))
                hidden = any(
                    ((low <= v) & (v <= high)).any()
                    for v, (low, high) in zip((r, rdot), map(np.transpose, zones), strict=True)
                )
                radar = report.variance[e, t, 3 * j : 3 * j + 2]
                assert np.isinf(radar).all() if hidden else np.isfinite(radar).all()
                seen.append(not hidden)
                if not hidden:
                    z = report.z[e, t, 3 * j : 3 * j + 2]
                    widths = np.array([timing.unambiguous_range, timing.unambiguous_velocity])
                    assert (z >= [0.0, -widths[1] / 2]).all()
                    assert (z <= [widths[0], widths[1] / 2]).all()
                    off = (z - true[e, t, j, :2] + widths / 2) % widths - widths / 2
                    assert (np.abs(off) < 6 * np.sqrt(radar)).all()
    assert 0.4 < np.mean(seen) < 0.9


@pytest.mark.parametrize("ratio", [0.05, 0.11, 0.14, 0.18, 0.22, 0.3])
def test_the_probability_of_a_certain_fold(ratio):
    """200000 drawn innovations: how often each other fold is e^12.5 times less likely, to 5 standard errors."""
    y, width, n = np.random.default_rng(0).standard_normal(200_000), 1 / ratio, 200_000
    density = norm.logpdf(y[:, None] + width * np.arange(-9, 10))
    density.sort(axis=1)
    want, got = (density[:, -1] - density[:, -2] >= 12.5).mean(), folding.certain_fold_one(1.0, width, 5.0)
    assert abs(got - want) < 5 * np.sqrt(max(want * (1 - want), 1e-9) / n) + 2 * norm.sf(5.0)


@pytest.mark.slow
def test_predicted_covariances_agree_with_realised_ones():
    """Expected against realised covariance under the one-step scheduler, averaged over 100 worlds.

    The first step is left out: its mean is that of a few worlds that see nothing.
    """
    system = RfEoFar(horizon=60)
    worlds, both = oracles.worlds(system, 100, 3), []
    for before, action, after in closed_loop(system, worlds, shortcuts.best_action.of(system)):
        both.append([system.cost(system.predict(before.belief, action)), system.cost(after.belief)])
    predicted, realised = np.array(both)[1:].mean(axis=2).T
    assert 0.95 < predicted[5:].mean() / realised[5:].mean() < 1.05


def test_without_a_certain_fold_a_range_changes_nothing():
    """One platform, a prior of 1 km, and 100 kHz: the range repeats every 1.5 km, the range-rate every 1.5 km/s."""
    system = RfEoFar(
        horizon=1, platforms=((0.0, 0.0),), starts=((0.0, 0.0, 35.2e3, 60.0),), looks=(3.0,), duty=0.0, notch=0.0
    )
    worlds = oracles.worlds(system, 50)
    action = np.repeat(system.action_set.encode(np.array([[[100e3, 20e6, 1e-5]]])), 50, axis=0)
    after = system.transition(system.initial(worlds), action, worlds)
    assert (after.truth.received == 2).all()
    assert (after.belief.covariance[..., 2, 2] > 0.9e6).all()
    assert (after.belief.covariance[..., 3, 3] < 20.0).all()


def test_a_planted_defect_is_noticed(monkeypatch):
    """A tracker that takes the nearest fold as certain loses targets: the mean NEES is no longer near 4."""
    system = RfEoFar(horizon=10, prior_variance=(9e6, 2500.0, 9e6, 2500.0))
    worlds = oracles.worlds(system, 100)
    choose = at_random(system, 100)
    _, mean, P, *_ = system.initial(worlds).belief
    state = system.initial(worlds)
    state = state._replace(
        belief=state.belief._replace(mean=mean, covariance=P * 1e-2)
    )  # too narrow: folds look certain
    for _ in range(system.horizon):
        state = system.transition(state, choose(state.belief), worlds)
    assert system.state_info(state)["nees"].mean() > 100.0


def test_a_world_with_another_notch_and_duty():
    """The tracker's assumptions do not change what is seen; a wide notch of the world hides more."""
    told = RfEoFar(horizon=20, truth={"notch": 14.0, "duty": 0.3})
    same, worlds = RfEoFar(horizon=20), oracles.worlds(told, 20)

    def received(system):
        return sum(after.truth.received.sum() for *_, after in closed_loop(system, worlds, at_random(system, 20)))

    assert received(told) < 0.8 * received(same)


def test_without_folding_echoes_vanish():
    """The paper's setting is the default of RfEo."""
    assert not RfEo().folding
    assert RfEoFar().folding
