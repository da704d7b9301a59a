"""The shared band: one step in plain NumPy, consistency under every policy, price, delay and bad input."""

from __future__ import annotations

import math
from itertools import pairwise

import gymnasium as gym
import numpy as np
import oracles
import pytest
from filterpy.kalman import KalmanFilter

from wavegym.core import shortcuts
from wavegym.core.errors import InputError
from wavegym.evaluation import compare
from wavegym.schedulers import Myopic
from wavegym.sensors import assumed_echo, contiguous_bands, echo_law, noise_factors, range_law_snr
from wavegym.systems.shared_spectrum import SharedSpectrum
from wavegym.systems.shared_spectrum.privileged import Clairvoyant, Informed

C = 299792458.0


def played(system, count=60, steps=10, seed=0):
    """A state some drawn choices on, and its tapes."""
    worlds, rng = oracles.worlds(system, count), np.random.default_rng(seed)
    state = system.initial(worlds)
    for _ in range(steps):
        state = system.transition(state, rng.integers(len(system.actions.labels), size=count), worlds)
    return state, worlds


def errors(system, band, eta, delay):
    """Covariance of range and range-rate of a train, from delay, Doppler and the ridge of an up-chirp."""
    width, wavelength = system.channel_width * system.bands.width[band], C / system.carrier_hz
    times = system.interval * (np.arange(system.pulses) - 0.5 * (system.pulses - 1))
    doppler = 1.0 / ((2 * math.pi) ** 2 * np.mean(times**2) * eta)  # Hz^2
    uncoupled = 12.0 * delay / ((2 * math.pi * width) ** 2 * eta)  # of delay - Doppler / k, s^2
    k = width / system.pulse_duration
    to = np.array([[0.5 * C, 0.5 * C / k], [0.0, -0.5 * wavelength]])  # Doppler is positive for an approaching target
    return to @ np.diag([uncoupled, doppler]) @ to.T


@pytest.mark.parametrize(("receiver", "sensing"), [("matched", 0.0), ("matched", 3.0), ("whitening", 0.0)])
def test_a_step_is_the_filter_of_the_textbook_with_the_errors_of_the_law(receiver, sensing):
    """The belief after a step, from the mean noise given the measured one, by filterpy's Kalman filter."""
    system = SharedSpectrum(receiver=receiver, sensing=sensing)
    state, worlds = played(system)
    action = np.random.default_rng(1).integers(36, size=60)
    moved = system.move(state.truth, state.belief.step, worlds)
    seen = system.measure(moved, state.belief, action, worlds)
    after = system.track(state.belief, action, seen)
    if not sensing:
        np.testing.assert_allclose(seen.noise, moved.noise)
    deviation = 0.1 * math.log(10.0) * sensing  # of the logarithm of the measured noise
    mean = np.where(seen.noise < math.exp(2.0 * deviation), 1.0, seen.noise * math.exp(0.5 * deviation**2))
    gains, delays = noise_factors(mean, contiguous_bands(8), receiver)
    law = echo_law((system.false_alarm,), system.fluctuation, 2, cells=system.cells)
    for e in range(60):
        kf = KalmanFilter(dim_x=2, dim_z=2)
        kf.x, kf.P, kf.H = state.belief.mean[e][:, None], state.belief.covariance[e], np.eye(2)
        kf.F, kf.Q = system.motion.F, system.motion.Q
        kf.predict()
        eta = range_law_snr(kf.x[0, 0], system.reference_range, system.nearest_range) * gains[e, action[e]]
        if seen.present[e]:
            R = errors(system, action[e], assumed_echo(eta, law).effective, delays[e, action[e]])
            kf.update(seen.z[e][:, None], R=R)
        np.testing.assert_allclose(after.mean[e], kf.x[:, 0], rtol=1e-6)
        np.testing.assert_allclose(after.covariance[e], kf.P, rtol=1e-4, atol=1e-9)


def test_errors_of_detected_echoes_have_the_covariance_of_the_law():
    """At a steady echo without other users: 20 000 errors, whitened, have unit covariance to five standard errors."""
    system = SharedSpectrum(users=(), fluctuation="swerling0", sensing=0.0, horizon=20, history=2, q=0.0)
    worlds = oracles.worlds(system, 1000)
    state, found = system.initial(worlds), []
    for _ in range(20):
        before = state
        moved = system.move(before.truth, before.belief.step, worlds)
        action = np.full(1000, 9)
        seen = system.measure(moved, before.belief, action, worlds)
        eta = range_law_snr(moved.targets[:, 0], system.reference_range, system.nearest_range)
        root = np.array([np.linalg.cholesky(errors(system, 9, value, 1.0)) for value in eta])
        white = np.linalg.solve(root, (seen.z - moved.targets)[..., None])[..., 0]
        found.append(white[seen.present])
        state = system.transition(before, action, worlds)
    white = np.concatenate(found)
    assert len(white) > 15_000
    np.testing.assert_allclose(white.T @ white / len(white), np.eye(2), atol=5 * math.sqrt(2 / len(white)))


@pytest.mark.parametrize("price", [0.0, 2.0])
def test_the_expected_belief_is_the_mean_over_drawn_outcomes(price):
    """Covariance and price of every band, over 4000 draws of occupancy and detection, to five standard errors."""
    system = SharedSpectrum(price=price)
    state, _ = played(system, 3, 30)
    bands, draws = np.broadcast_to(np.arange(36), (3, 36)), np.random.default_rng(3).random((4000, 3, 9))
    costs = np.array([system.cost(system.predict(state.belief, bands, each)) for each in draws])
    expected = system.cost(system.predict(state.belief, bands))
    assert (abs(costs.mean(axis=0) - expected) <= 5 * costs.std(axis=0) / math.sqrt(4000) + 1e-9).all()
    found = shortcuts.best_action(system, state.belief)
    np.testing.assert_array_equal(found, expected.argmin(axis=1))


def test_a_price_makes_the_scheduler_avoid_others():
    collisions = []
    for price in (0.0, 0.1, 10.0):
        played_ = compare("SharedSpectrum-v0", ["myopic"], worlds=50, jobs=1, progress=False, price=price)
        collisions.append(played_.results("myopic").collisions.mean())
    assert collisions[0] > collisions[2]
    assert collisions[0] >= collisions[1]


def test_a_delay_of_sensing_hides_the_last_steps():
    """The belief of the history is that of two steps ago without a delay, and nothing of the last two steps."""
    late, prompt = SharedSpectrum(sensing_delay=2), SharedSpectrum()
    now, then = played(late, 20, 12)[0].belief, played(prompt, 20, 10)[0].belief
    np.testing.assert_array_equal(now.heard, then.heard)
    np.testing.assert_array_equal(now.level, then.level)
    np.testing.assert_array_equal(
        shortcuts.sensed_band(late).noise(now, 3), shortcuts.sensed_band(prompt).noise(then, 3)
    )
    noise = slice(4, 4 + late.history * late.channels)
    np.testing.assert_array_equal(late.observe(now)[:, noise], prompt.observe(then)[:, noise])
    np.testing.assert_array_equal(now.covariance, played(prompt, 20, 12)[0].belief.covariance)


def test_planners_may_predict_finished_episodes():
    """The history of other environments stays as it was, and an expected step adds what is likely."""
    system = SharedSpectrum(horizon=20, history=4)
    state, worlds = played(system, 2, 20)
    fresh = system.initial(worlds).belief
    mixed = state.belief._replace(step=np.array([20, 5]))
    after = system.predict(mixed, np.array([35, 35]))
    np.testing.assert_array_equal(after.heard[0], mixed.heard[0])
    np.testing.assert_array_equal(after.sent[0], mixed.sent[0])
    changed = np.flatnonzero((after.heard[1] != mixed.heard[1]).any(axis=1))
    assert set(changed) <= {9}
    ahead = system.predict(fresh, np.array([0, 0])).heard[:, 4] >= 10
    np.testing.assert_array_equal(ahead, system.occupancy(fresh) > 0.5)


def test_an_opponent_that_knows_the_users_pays_for_occupied_channels_only():
    system = SharedSpectrum(price=1e3, users=("static",), takeover=0.0)
    worlds = oracles.worlds(system, 20)
    policy, state = Clairvoyant(), system.initial(worlds)
    policy.begin(system, 20, np.random.default_rng(0))
    policy.reveal(worlds)
    for _ in range(5):
        state = system.transition(state, policy.act(state.belief, None, None), worlds)
    assert (state.truth.collisions == 0).all()
    assert (system.state_info(state)["share"] > 0.2).all()  # all clear channels of one side, not the cheapest one


def test_the_observation_is_the_history():
    system = SharedSpectrum(history=3, sensing_delay=1)
    state, _ = played(system, 5, 6)
    seen = dict(zip([field.name for field in system.observation_fields], system.observe(state.belief).T, strict=True))
    for steps_ago in (1, 2, 3):
        band = state.belief.sent[:, 6 - steps_ago]
        for c in range(8):
            np.testing.assert_array_equal(seen[f"noise_{steps_ago}_{c}"], 0.5 * state.belief.heard[:, 8 - steps_ago, c])
            held = (system.bands.first[band] <= c) & (c < system.bands.first[band] + system.bands.width[band])
            np.testing.assert_array_equal(seen[f"sent_{steps_ago}_{c}"], held)


@pytest.mark.slow
def test_both_forms_of_the_action_are_drawn():
    for action in ("library", "box"):
        env = gym.make("wavegym/SharedSpectrum-v0", action=action, render_mode="rgb_array")
        env.reset(seed=0)
        env.action_space.seed(0)
        env.step(env.action_space.sample())
        assert np.ptp(env.render()) == 255


def test_an_agent_of_the_belief_plays_where_measurements_are_shown():
    found = [
        compare("SharedSpectrum-v0", {"ppo": None}, worlds=3, jobs=1, progress=False, observation=observation)
        for observation in ("belief", "measurements")
    ]
    np.testing.assert_array_equal(*(each.results("ppo").cost for each in found))


@pytest.mark.slow
@pytest.mark.parametrize(
    "parameters",
    [
        {},
        {"receiver": "whitening"},
        {"sensing": 4.0},
        {"sensing": 4.0, "receiver": "whitening"},
        {"cells": 0, "fluctuation": "swerling3"},
    ],
)
def test_the_tracker_is_consistent_under_every_policy(parameters):
    """NEES of 2 for both elements: within 0.1, or 0.2 where the noise is measured to 4 dB."""
    policies = {name: None for name in ("random", "sense-and-avoid", "myopic", "fixed:0", "myopic:lags")}
    found = compare(
        "SharedSpectrum-v0",
        {**policies, "clairvoyant": Clairvoyant()},
        worlds=300,
        jobs=1,
        progress=False,
        **parameters,
    )
    for name in found.played:
        results = found.results(name)
        error = 4.0 * results.nees.std() / math.sqrt(results.nees.size)
        assert abs(results.nees.mean() - 2.0) < (0.2 if "sensing" in parameters else 0.1) + error


@pytest.mark.slow
def test_more_knowledge_costs_less():
    """With users that never react: the next train's noise, its distribution, Markov chains, nothing."""
    policies = {"clairvoyant": Clairvoyant(), "informed": Informed(), "myopic": None, "random": None}
    users = ("static", "bursts", "stepped")
    found = compare("SharedSpectrum-v0", policies, worlds=60, jobs=1, progress=False, users=users)
    logs = [np.log(found.cost(name)[0]) for name in policies]
    for knows, less in pairwise(logs):
        difference = less - knows
        assert difference.mean() > 2.0 * difference.std() / math.sqrt(60)
    assert found.results("clairvoyant").collisions.mean() < 0.02


def test_an_opponent_that_knows_the_users_is_for_this_system_only():
    with pytest.raises(InputError, match="Informed was given KershawEvans, expected a SharedSpectrum"):
        compare("KershawEvans-v0", {"informed": Informed()}, worlds=1, jobs=1, progress=False)
    with pytest.raises(InputError, match="futures is 0"):
        Informed(0)


@pytest.mark.parametrize(("wrong", "nearest"), [(-1, 0), (36, 35)])
def test_a_band_outside_the_spectrum_is_refused(wrong, nearest):
    env = gym.make("wavegym/SharedSpectrum-v0", disable_env_checker=True)
    env.reset(seed=0)
    with pytest.raises(InputError, match=rf"action is {wrong}, expected an index in \[0, 35\] \(nearest: {nearest}\)"):
        env.step(wrong)


def test_a_step_does_not_change_the_belief_before_it():
    system = SharedSpectrum()
    state, worlds = played(system, 10)
    before = [np.array(each) for each in state.belief]
    system.transition(state, myopic_action(system, state), worlds)
    system.predict(state.belief, np.arange(36)[None].repeat(10, axis=0))
    for one, two in zip(before, state.belief, strict=True):
        np.testing.assert_array_equal(one, two)


def myopic_action(system, state):
    policy = Myopic()
    policy.begin(system, len(state.belief.step), np.random.default_rng(0))
    return policy.act(state.belief, None, None)


def test_a_point_of_the_box_is_the_nearest_band():
    """Every band's own point is that band, and any other point a band whose centre and width are not far."""
    box, library = SharedSpectrum(action="box"), SharedSpectrum()
    np.testing.assert_array_equal(box.band_of(box.candidates()), np.arange(36))
    points = np.random.default_rng(7).uniform(-1.0, 1.0, (500, 2))
    centre, width = box.actions.decode(points).T
    band = box.band_of(points)
    low = box.carrier_hz - 4 * box.channel_width + box.channel_width * box.bands.first[band]
    assert (abs(box.bands.width[band] * box.channel_width - width) <= 0.5 * box.channel_width + 1e-3).all()
    moved = abs(low + 0.5 * box.channel_width * box.bands.width[band] - centre)
    room = 4 * box.channel_width - 0.5 * box.channel_width * box.bands.width[band]  # of the centre at this width
    beyond = np.maximum(abs(centre - box.carrier_hz) - room, 0.0)
    assert (moved <= beyond + 0.5 * box.channel_width + 1e-3).all()
    worlds = oracles.worlds(library, 30)
    one, two = library.initial(worlds), box.initial(worlds)
    for action in np.random.default_rng(8).integers(36, size=(5, 30)):
        one, two = library.transition(one, action, worlds), box.transition(two, box.candidates()[action], worlds)
    np.testing.assert_array_equal(one.belief.covariance, two.belief.covariance)
    np.testing.assert_array_equal(
        library.cost(library.predict(one.belief, np.arange(36)[None])),
        box.cost(box.predict(two.belief, box.candidates()[None])),
    )


@pytest.mark.slow
def test_rules_and_privileged_opponents_play_in_the_box():
    policies = {"sense-and-avoid": None, "claim": None, "informed": Informed()}
    library, box = (
        compare("SharedSpectrum-v0", policies, worlds=10, jobs=1, progress=False, action=form)
        for form in ("library", "box")
    )
    for name in ("sense-and-avoid", "informed"):
        np.testing.assert_array_equal(library.cost(name), box.cost(name))
