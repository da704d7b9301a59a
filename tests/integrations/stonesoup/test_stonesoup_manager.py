"""Policies of wavegym in Stone Soup's loop: the same choices, and on the same tape the same costs."""

from __future__ import annotations

from datetime import timedelta

import numpy as np
import oracles
import pytest
from stonesoup.models.transition.linear import ConstantVelocity
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.sensormanager import BruteForceSensorManager
from stonesoup.types.array import StateVector
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater

from wavegym.core import trees
from wavegym.core.action_sets import Library
from wavegym.core.errors import InputError
from wavegym.core.worlds import word
from wavegym.evaluation import as_policy
from wavegym.evaluation.play import make_task
from wavegym.integrations.stonesoup import (
    PolicySensorManager,
    WaveformRadar,
    WeightedTraceReward,
    path_of,
    radars_of,
    simulate,
)
from wavegym.integrations.stonesoup.simulation import START
from wavegym.observations.observer import Observer
from wavegym.policies.runs import load_pretrained
from wavegym.schedulers.rollout import rollout
from wavegym.systems.agile_clutter import AgileClutter
from wavegym.systems.composed import LinearTargets, Loop, PlanarRadar, Pulses, WeightedTrace
from wavegym.systems.energy_budget import EnergyBudget
from wavegym.targets import constant_velocity
from wavegym.waveforms import gaussian_chirp_library

ID = "wavegym/KershawEvansPosition-v0"
SYSTEM = make_task(ID, {}).system
STEP = timedelta(seconds=1)


def track_of(mean, covariance, time=START):
    return Track([GaussianState(StateVector(mean), covariance, timestamp=time)])


def policy_of(name, system=SYSTEM):
    """The policy that the manager is to play, ready for one environment."""
    policy = load_pretrained(ID, name, system) if name in ("ppo", "dqn") else as_policy(name, make_task(ID, {}))
    policy.begin(system, 1, np.random.default_rng([word("policy"), 0]))
    return policy


def beliefs(seed):
    """Beliefs of all steps of a drawn episode."""
    world = oracles.worlds(SYSTEM, 1, seed)
    state = SYSTEM.initial(world)
    for k in range(SYSTEM.horizon):
        yield state.belief
        state = SYSTEM.transition(state, np.array([(11 * k) % len(SYSTEM.actions)]), world)


@pytest.mark.parametrize("name", ["myopic", "lookahead:2", "ppo", "random"])
def test_the_choice_is_that_of_the_policy_on_the_same_belief(name):
    """The state vector of Stone Soup has another order and more elements than the belief."""
    (radar,) = radars_of(SYSTEM, ndim_state=4, mapping=(2, 1))
    for seed in range(3):
        manager, policy = PolicySensorManager(sensors={radar}, env=ID, policy=name), policy_of(name)
        observer, track, chosen = Observer(SYSTEM), Track(), []
        for k, belief in enumerate(beliefs(seed)):
            mean, covariance = np.full(4, -7.0), np.eye(4)
            mean[[2, 1]], covariance[np.ix_([2, 1], [2, 1])] = belief.mean[0], belief.covariance[0]
            now = START + k * STEP
            track.append(GaussianState(StateVector(mean), covariance, timestamp=now))
            read = manager.belief({track}, now + STEP)
            for field in ("step", "mean", "covariance"):
                np.testing.assert_array_equal(getattr(read, field), getattr(belief, field))
            (config,) = manager.choose_actions({track}, now + STEP)
            (action,) = config[radar]
            assert action.target_value == policy.act(belief, observer(belief)[0], None)[0]
            assert action.end_time == now + STEP
            chosen.append(action.target_value)
        assert len(set(chosen)) > 2


@pytest.mark.parametrize("updater", [ExtendedKalmanUpdater, UnscentedKalmanUpdater])
@pytest.mark.parametrize("name", ["myopic", "lookahead:2", "ppo", "random"])
def test_the_loop_costs_what_wavegym_costs_on_the_same_tape(name, updater):
    """Predictor, updater, process noise and loop are Stone Soup's; for a linear sensor only rounding differs."""
    for seed in range(3):
        world = oracles.worlds(SYSTEM, 1, seed)
        state = SYSTEM.initial(world)
        (radar,) = radars_of(SYSTEM)
        filters = KalmanPredictor(ConstantVelocity(SYSTEM.q)), updater()
        track = track_of(state.belief.mean[0], state.belief.covariance[0])
        manager = PolicySensorManager(sensors={radar}, env=ID, policy=name)
        record = simulate(radar, manager, *filters, path_of(state.truth.path[0], 1.0), track, world.normal[0, 1:, -2:])
        costs, waveforms = [], []
        policy, observer = policy_of(name), Observer(SYSTEM)
        for _ in range(SYSTEM.horizon):
            action = policy.act(state.belief, observer(state.belief)[0], None)
            state = SYSTEM.transition(state, action, world)
            costs.append(SYSTEM.cost(state.belief)[0])
            waveforms.append(action[0])
        np.testing.assert_array_equal(record.waveform, waveforms)
        np.testing.assert_allclose(record.covariance[:, 0, 0], costs, rtol=1e-7)
        np.testing.assert_allclose(record.mean[-1], state.belief.mean[0], rtol=1e-7)
        assert len(track) == SYSTEM.horizon + 1


def test_brute_force_with_the_trace_as_reward_is_myopic():
    """Stone Soup's manager enumerates the radar's actions; the two searches have nothing in common."""
    world = oracles.worlds(SYSTEM, 1, 4)
    state = SYSTEM.initial(world)
    found = []
    for searched in (True, False):
        (radar,) = radars_of(SYSTEM)
        filters = KalmanPredictor(ConstantVelocity(SYSTEM.q)), UnscentedKalmanUpdater()
        manager = PolicySensorManager(sensors={radar}, env=ID)
        if searched:
            manager = BruteForceSensorManager({radar}, reward_function=WeightedTraceReward(*filters, SYSTEM.weights))
        path = path_of(state.truth.path[0, :9], 1.0)
        track = track_of(state.belief.mean[0], state.belief.covariance[0])
        found.append(simulate(radar, manager, *filters, path, track, world.normal[0, 1:9, -2:]).waveform)
    np.testing.assert_array_equal(*found)


def test_two_radars_and_targets_that_come_later():
    """AgileClutter: the radars are found by their places, the tracks take the slots of the nearest targets."""
    system = make_task("AgileClutter-v0", {}).system
    radars = radars_of(system, mapping=(0, 2, 1, 3))
    manager = PolicySensorManager(sensors=set(radars), env="AgileClutter-v0", start_time=START)
    policy = as_policy("myopic", make_task("AgileClutter-v0", {}))
    policy.begin(system, 1, np.random.default_rng(0))
    state = system.initial(oracles.worlds(system, 1))
    step, order, ids = timedelta(seconds=system.dt), [0, 2, 1, 3], {}
    for k in range(9):
        belief = state.belief
        tracks = []
        for t in range(2 if k >= system.births[1] else 1):
            inverse = np.argsort(order)
            mean, covariance = belief.mean[0, t][inverse], belief.covariance[0, t][np.ix_(inverse, inverse)]
            track = ids.setdefault(t, track_of(mean, covariance))
            track.append(GaussianState(StateVector(mean), covariance, timestamp=START + k * step))
            tracks.append(track)
        read = manager.belief(set(tracks), START + (k + 1) * step)
        np.testing.assert_allclose(read.mean[0, : len(tracks)], belief.mean[0, : len(tracks)])
        np.testing.assert_allclose(read.covariance[0, : len(tracks)], belief.covariance[0, : len(tracks)])
        (config,) = manager.choose_actions(set(tracks), START + (k + 1) * step)
        chosen = policy.act(belief, None, None)
        assert [config[radar][0].target_value for radar in radars] == chosen[0].tolist()
        state = system.transition(state, chosen, oracles.worlds(system, 1))


def test_tracks_in_a_plane_are_seen_along_the_line_of_sight():
    """An agent for one line of sight schedules a radar in the plane: by hand, of a target on the x axis."""
    pulses = Pulses(SYSTEM.actions, SYSTEM.carrier_hz)
    radar = WaveformRadar(
        pulses, law=PlanarRadar(), ndim_state=4, mapping=(0, 2, 1, 3), position=StateVector([1e3, 0.0])
    )
    manager = PolicySensorManager(sensors={radar}, env=ID)
    covariance = oracles.random_covariance(np.random.default_rng(0), 4)
    belief = manager.belief({track_of([21e3, 150.0, 0.0, 40.0], covariance)}, START + STEP)
    np.testing.assert_allclose(belief.mean, [[20e3, 150.0]])
    H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 40.0 / 20e3, 0.0]])  # d(rdot)/dy = ydot / r
    np.testing.assert_allclose(belief.covariance[0], H @ covariance @ H.T, rtol=1e-9)


def test_a_loop_of_parts_is_played():
    """A system without an id, with a radar in the plane and two targets."""
    motion = constant_velocity(1.0, 1.0, ("x", "y"), order="derivative")
    low, high = (
        ((15e3, 0.0, -50.0, -50.0), (-20e3, 5e3, -50.0, -50.0)),
        ((16e3, 1e3, 50.0, 50.0), (-19e3, 6e3, 50.0, 50.0)),
    )
    targets = LinearTargets(motion, low, high, (1e3, 1e3, 100.0, 100.0))
    pulses = Pulses(gaussian_chirp_library((20e-6, 200e-6), (0.0, 1e6)), 10.4e9)
    loop = Loop(
        targets=targets, sensor=PlanarRadar((2e3, 1e3)), waveforms=pulses, objective=WeightedTrace((1, 1, 0, 0))
    )
    (radar,) = radars_of(loop)
    manager = PolicySensorManager(sensors={radar}, env=loop, policy="lookahead:2")
    belief = loop.initial(trees.stack([loop.draw_world(np.random.default_rng(1))])).belief
    tracks = {track_of(x, P) for x, P in zip(belief.mean[0], belief.covariance[0], strict=True)}
    read = manager.belief(tracks, START + STEP)
    np.testing.assert_array_equal(read.mean, belief.mean)
    (config,) = manager.choose_actions(tracks, START + STEP)
    policy = as_policy("lookahead:2", manager._task)
    policy.begin(loop, 1, np.random.default_rng(0))
    assert config[radar][0].target_value == policy.act(belief, None, None)[0]


def test_the_next_episode_begins_after_the_horizon():
    (radar,) = radars_of(SYSTEM)
    manager = PolicySensorManager(sensors={radar}, env=ID, parameters={"horizon": 5})
    track = track_of([20e3, 100.0], np.diag([100.0, 100.0]))
    steps = []
    for k in range(12):
        now = START + k * STEP
        track.append(GaussianState(StateVector([20e3, 100.0]), np.diag([100.0, 100.0]), timestamp=now))
        steps.append(int(manager.belief({track}, now + STEP).step[0]))
    assert steps == [0, 1, 2, 3, 4, 0, 1, 2, 3, 4, 0, 1]


def refused(match, tracks=None, timestamp=START + STEP, radars=None, nchoose=1, **properties):
    manager = PolicySensorManager(sensors=set(radars or radars_of(SYSTEM)), **{"env": ID, **properties})
    given = {track_of([20e3, 100.0], np.eye(2))} if tracks is None else tracks
    with pytest.raises(InputError, match=match) as caught:
        manager.choose_actions(given, timestamp, nchoose)
    assert "\n" not in str(caught.value)


def test_what_does_not_fit_is_refused():
    track, other = (track_of([20e3, 100.0], np.eye(2)) for _ in range(2))
    late = track_of([20e3, 100.0], np.eye(2), START + STEP)
    refused("nchoose is 2, expected 1", nchoose=2)
    refused("the scheduler is given 2 tracks, expected 1 to 1", {track, other})
    refused(r"the tracks end at \[\], expected one time", set())
    refused("the tracks end at .* append the prediction", {track, late}, START + 2 * STEP)
    refused(
        "0 s after the start and 2 s before the measurement, expected whole time steps of 1 s", None, START + 2 * STEP
    )
    few = WaveformRadar(Pulses(Library(SYSTEM.actions.entries[:5]), SYSTEM.carrier_hz))
    refused(r"library of 5 waveforms, expected the system's 56 \(nearest: radars_of\(system\)\)", radars=[few])
    refused("the manager has 1 sensors, expected 2", env="AgileClutter-v0")
    shifted = radars_of(AgileClutter())
    shifted[0].position = StateVector([0.0, 0.0])
    refused(r"no sensor of the manager is at \(3000.0, -16000.0\) m", radars=shifted, env="AgileClutter-v0")
    refused("belief of KershawEvansPosition has memory", parameters={"tracker": "imm"})
    three = radars_of(SYSTEM, ndim_state=3, mapping=(0, 1, 2))
    refused(r"mapping of the radar is \(0, 1, 2\), expected a mapping of 2 elements", radars=three)


def test_unknown_policies_and_systems_are_refused():
    with pytest.raises(InputError, match="did you mean 'myopic'"):
        PolicySensorManager(env=ID, policy="myopik")
    with pytest.raises(InputError, match="system is EnergyBudget"):
        PolicySensorManager(sensors=set(radars_of(SYSTEM)), env=EnergyBudget()).choose_actions(set(), START)


def test_the_simulation_refuses_what_does_not_fit():
    (radar,) = radars_of(SYSTEM)
    path = path_of(np.array([[20e3, 100.0]] * 3), 1.0)
    parts = (
        radar,
        PolicySensorManager(sensors={radar}, env=ID),
        KalmanPredictor(ConstantVelocity(1.0)),
        ExtendedKalmanUpdater(),
    )
    with pytest.raises(InputError, match="draws has 3 rows, expected 2"):
        simulate(*parts, path, track_of([20e3, 100.0], np.eye(2)), np.zeros((3, 2)))
    with pytest.raises(InputError, match=r"the track's time is .* expected that of the path's start"):
        simulate(*parts, path, track_of([20e3, 100.0], np.eye(2), START + STEP))


def test_rollout_and_simulation_agree():
    """wavegym's own rollout as a second witness, with lookahead."""
    world = oracles.worlds(SYSTEM, 1, 9)
    want = rollout(SYSTEM, policy_of("lookahead:2"), world)
    state = SYSTEM.initial(world)
    (radar,) = radars_of(SYSTEM)
    filters = KalmanPredictor(ConstantVelocity(SYSTEM.q)), ExtendedKalmanUpdater()
    track = track_of(state.belief.mean[0], state.belief.covariance[0])
    manager = PolicySensorManager(sensors={radar}, env=ID, policy="lookahead:2")
    got = simulate(radar, manager, *filters, path_of(state.truth.path[0], 1.0), track, world.normal[0, 1:, -2:])
    np.testing.assert_allclose(got.covariance[:, 0, 0], want.cost[0], rtol=1e-8)
