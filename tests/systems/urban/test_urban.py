"""The urban closed loop: measurements, cost and observation."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
from scipy.stats import chi2, poisson
from urban_plays import LONG_UP, played

from wavegym.core.system import State
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.rollout import rollout
from wavegym.systems.urban.state import MOST, Belief
from wavegym.systems.urban.system import Urban
from wavegym.systems.urban.tracker import CONFIRMED, EMPTY, Tracks
from wavegym.waveforms import (
    measurement_covariances,
)

SYSTEM = Urban()


def test_targets_drive_as_the_paper_says():
    """Ten seconds apart, from (1950, 1500) to (2069.33, 1669.33)."""
    true_states, present = SYSTEM.scene.truth, SYSTEM.scene.present
    np.testing.assert_allclose(true_states[-1, 0, :2], [2069.33, 1669.33], atol=0.01)
    np.testing.assert_allclose(true_states[40:, 1], true_states[:-40, 0], atol=1e-9)
    assert present.sum(axis=0).tolist() == [141, 101]


def test_returns_and_clutter_are_as_frequent_and_as_exact_as_they_should_be():
    """Direct return of the first target at scan 100 in 4000 worlds: Pd, mean, covariance; number of other returns."""
    law = {"error_snr": "mean", "searched": 0, "false_alarm": 1e-3}
    count, scan, system = 4000, 100, Urban(arrivals=(0.0,), truth={"sigma": 0.0}, **law)
    route = system.scene.truth[scan, 0, :4]
    worlds, state = oracles.worlds(system, count), system.initial(oracles.worlds(system, count))
    state = at_scan(system, state, scan - 1)
    truth = system.transition(state, np.full(count, LONG_UP), worlds).truth
    exact = np.append(system.pairs[0].measure(route)[0], system.pairs[0].directions(route[:2])[0])
    kept = energy_kept(system, system.scene.truth[scan, 0])
    eta = 200.0 * (100.0 / exact[0]) ** 4 * kept
    R = np.diag([0.0, 0.01, 12.0 / (np.pi**2 * (3**2 - 1) * eta)])
    R[:2, :2] += measurement_covariances(system.actions, 4e9)[LONG_UP] / eta
    paths = system.scene.z[0, scan, 0, : system.scene.path_count[0, scan, 0]]
    off = truth.z[:, 0, 0] - exact  # returns over paths come first, the direct one before all others
    squared = (off * np.linalg.solve(R, off.T).T).sum(axis=1)
    detected = squared < chi2.ppf(1 - 1e-6, 3)
    pd = 1e-3 ** (1.0 / (1.0 + eta / 2.0))
    assert abs(detected.mean() - pd) < 4.5 * np.sqrt(pd * (1 - pd) / count)
    errors = off[detected] / np.sqrt(np.diag(R))
    assert np.abs(errors.mean(axis=0)).max() < 4.5 / np.sqrt(detected.sum())
    assert np.abs(errors.T @ errors / detected.sum() - np.eye(3)).max() < 4.5 * np.sqrt(2.0 / detected.sum())
    expected = 1e-3 * 300.0 * 2.0 * system.ambiguity
    most = [
        1e-3 ** (1.0 / (1.0 + kept * 100.0 * (100.0 / r) ** 4 * 0.4**k))
        for r, k in zip(paths[:, 0], walls(system, scan), strict=True)
    ]
    number = truth.number[:, 0].mean()
    assert abs(number - expected - sum(most)) < 4.5 * np.sqrt((expected + len(most) / 4) / count)
    assert truth.z.shape[2] == MOST
    assert poisson.sf(MOST // 2, expected) < 1e-6  # the array has room for all


def at_scan(system, state, scan):
    """The state with the targets and the clock of a scan, on the route."""
    count = len(state.belief.step)
    targets = np.repeat(system.scene.truth[scan][None], count, axis=0)
    return State(state.truth._replace(targets=targets), state.belief._replace(step=np.full(count, scan)))


def energy_kept(system, target, pulses=249):
    """Power at the peak of the spectrum of a simulated train over that of a uniform motion; target (6,), direct path.

    The phase of each pulse follows from the path length of the accelerating target.
    """
    t = 1e-3 * (np.arange(pulses) - pulses // 2)[:, None]
    place = target[:2] + t * target[2:4] + 0.5 * t**2 * target[4:]
    length = sum(np.hypot(*(place - end).T) for end in np.array([system.transmitters[0], system.receivers[0]]))
    spectrum = np.fft.fft(np.exp(2j * np.pi * length * 4e9 / 299792458.0), 64 * pulses)
    return (np.abs(spectrum) ** 2).max() / pulses**2


@pytest.mark.parametrize("pushed", [0.0, 2.0, 6.0])
def test_acceleration_along_the_line_of_sight_costs_energy(pushed, tmp_path):
    """Detections of 4000 echoes follow the law at the energy that a simulated train keeps, within 4.5 sigma."""
    count, scan, road = 4000, 30, tmp_path / "plain.toml"
    road.write_text("roads = [{centre = [[1900, 1505], [2200, 1505]], width = 30}]")
    common = {"city": str(road), "arrivals": (0.0,), "charged": 1, "clutter_density": 1e-12}
    system = Urban(**common, truth={"sigma": 0.0}, searched=0, false_alarm=1e-3, reference_snr=10.0)
    target = system.scene.truth[scan, 0].copy()
    target[4:] = pushed, 0.0
    worlds = oracles.worlds(system, count)
    state = system.initial(worlds)
    truth = state.truth._replace(targets=np.tile(target, (count, 1, 1)))
    belief = state.belief._replace(step=np.full(count, scan - 1))
    found = system.measure(truth, belief, np.full(count, LONG_UP), worlds)
    eta = 10.0 * (100.0 / system.pairs[0].measure(target[:4])[0, 0]) ** 4 * energy_kept(system, target)
    pd = 1e-3 ** (1.0 / (1.0 + eta / 2.0))
    assert abs(found.number[:, 0].mean() - pd) < 4.5 * np.sqrt(pd * (1 - pd) / count)


def test_the_tracker_assumes_the_mean_loss_of_its_accelerations():
    """Accelerations of 1 m/s^2 cost 0.58 dB on average, and random ones less; trains of 25 pulses lose nothing."""
    for pulses, loss in ((249, 10**-0.058), (25, 1.0)):
        system = Urban(pulses=pulses)
        np.testing.assert_allclose(system._believed_waves[1], loss * system._waves[1], rtol=1e-3)


def test_targets_leave_the_route_and_come_back():
    """4000 targets after 30 s: the deviation has the covariance of the oscillator that white acceleration drives."""
    count, system = 4000, Urban(arrivals=(0.0,))
    worlds = oracles.worlds(system, count)
    truth = system.initial(worlds).truth
    for k in range(120):
        truth = system.move(truth, np.full(count, k), worlds)
    off = (truth.targets - system.scene.truth[120])[:, 0, :4]
    white = 0.25**2 * 0.25  # spectral density of accelerations of 0.25 m/s^2 that last 0.25 s each
    expected = np.array([white / (4 * 0.7 * 0.3**3)] * 2 + [white / (4 * 0.7 * 0.3)] * 2)
    np.testing.assert_allclose(off.var(axis=0), expected, rtol=4.5 * np.sqrt(2.0 / count) + 0.03)  # 0.03: sampling
    assert (np.abs(off.mean(axis=0)) < 4.5 * np.sqrt(expected / count)).all()


def test_there_is_room_for_all_clutter():
    """Room for six standard deviations of clutter and the returns of targets; the number of false returns is right."""
    system, count = Urban(clutter_density=1e-2), 40
    worlds = oracles.worlds(system, count)
    truth = system.transition(system.initial(worlds), np.zeros(count, int), worlds).truth
    expected = 1e-2 * 300.0 * 2.0 * system.ambiguity  # 112
    assert poisson.sf(truth.z.shape[2] - 1, expected) < 1e-8
    assert abs(truth.number.mean() - expected) < 4.5 * np.sqrt(expected / truth.number.size)


def test_a_target_that_no_track_holds_counts_as_an_error():
    system = Urban(reference_snr=1e-3)
    worlds = oracles.worlds(system, 2)
    figures = system.state_info(system.transition(system.initial(worlds), np.zeros(2, int), worlds))
    np.testing.assert_array_equal(figures["position_error"], [[20.0, 0.0]] * 2)  # the second target has not arrived yet


def walls(system, scan):
    """Number of walls of each visible path to the first receiver."""
    return np.log(system.scene.reflected[0, scan, 0, : system.scene.path_count[0, scan, 0]]) / np.log(0.4)


def test_measurements_do_not_depend_on_other_choices():
    """Up and down sweeps of equal energy get the same returns and the same clutter."""
    worlds = oracles.worlds(SYSTEM, 20)
    state = SYSTEM.initial(worlds)
    up, down = (SYSTEM.transition(state, np.full(20, a), worlds).truth for a in (0, 1))
    np.testing.assert_array_equal(up.number, down.number)
    np.testing.assert_allclose(up.z, down.z, atol=1e-3)  # both sweeps have equal variances in a train


def test_losing_a_track_never_pays():
    """Emptying any slot, with any covariance, raises the cost."""
    rng = np.random.default_rng(0)
    belief = played(SYSTEM, "random", 30, stop=100)[-1].belief
    belief = belief._replace(
        existence=np.where(belief.status == EMPTY, 0.0, rng.random(belief.existence.shape)),
        P=belief.P * 10.0 ** rng.uniform(-3, 3, (*belief.existence.shape, 1, 1, 1)),
    )
    before = SYSTEM.cost(belief)
    assert (belief.status != EMPTY).any(axis=0).sum() > 1
    for slot in range(SYSTEM.slots):
        existence, status = belief.existence.copy(), belief.status.copy()
        existence[:, slot], status[:, slot] = 0.0, EMPTY
        assert (SYSTEM.cost(belief._replace(existence=existence, status=status)) >= before - 1e-12).all()
    nothing = SYSTEM.initial(oracles.worlds(SYSTEM, 1)).belief
    assert SYSTEM.cost(nothing) == pytest.approx(2 * SYSTEM.absent)


def test_the_trace_is_that_of_all_tracks_in_use():
    belief = played(SYSTEM, f"fixed:{LONG_UP}", 5, stop=100)[-1].belief
    _, P = Tracks(*belief[1:]).combined()
    want = [sum(np.trace(P[e, s]) for s in np.flatnonzero(belief.status[e])) for e in range(5)]
    np.testing.assert_allclose(SYSTEM.trace(belief), want)
    assert (belief.status != 0).any()
    assert (belief.status == 0).any()


def test_prediction_has_the_shapes_of_the_contract_and_is_a_prediction():
    belief = played(SYSTEM, "round-robin", 3, stop=70)[-1].belief
    each, one = SYSTEM.predict(belief, np.arange(4)[None]), SYSTEM.predict(belief, np.full(3, LONG_UP))
    for many, single in zip(each, one, strict=True):
        assert many.shape[:2] == (3, 4)
        np.testing.assert_array_equal(many[:, LONG_UP], single)
    cost = SYSTEM.cost(each)
    assert cost.shape == (3, 4)
    np.testing.assert_allclose(cost[:, 0], cost[:, 1], rtol=1e-3)  # up and down
    assert (cost[:, 0] <= cost[:, 2] + 1e-9).all()  # the longer pulse has more energy
    assert (each.step == belief.step[:, None] + 1).all()


def test_observation_is_the_mean_and_deviation_of_the_mixture():
    belief = played(SYSTEM, "random", 4, stop=90)[-1].belief
    x, P = Tracks(*belief[1:]).combined()
    shown = [
        SYSTEM.observe(belief)[:, [i for i, e in enumerate(SYSTEM.observation_fields) if e.name.startswith(name)]]
        for name in ("x_", "y_", "xdot_", "ydot_", "sigma_position_", "sigma_velocity_", "existence_", "confirmed_")
    ]
    there, variance = belief.status != EMPTY, np.diagonal(P, 0, -2, -1)
    sigma = np.sqrt(variance[..., 0] + variance[..., 1]), np.sqrt(variance[..., 2] + variance[..., 3])
    place = x[..., 0] - SYSTEM.transmitters[0][0], x[..., 1] - SYSTEM.transmitters[0][1], x[..., 2], x[..., 3]
    for ours, exact in zip(shown, (*place, *sigma, belief.existence, belief.status == CONFIRMED), strict=True):
        np.testing.assert_allclose(ours, np.where(there, exact, 0.0), rtol=1e-9, atol=1e-9)
    named = [e.name for e in SYSTEM.observation_fields]
    turning = SYSTEM.observe(belief)[:, [named.index(f"mu_CT_left_{s}") for s in range(1, SYSTEM.slots + 1)]]
    np.testing.assert_array_equal(turning, np.where(there, belief.mu[..., 2], 0.0))
    assert there.any()


def test_with_no_track_the_one_step_scheduler_sends_the_longer_pulse():
    """Without tracks all costs are equal and the first waveform is sent; with tracks the greater energy wins."""
    belief = SYSTEM.initial(oracles.worlds(SYSTEM, 3)).belief
    costs = SYSTEM.cost(SYSTEM.predict(belief, np.arange(4)[None]))
    assert (costs == costs[:, :1]).all()
    always, myopic = (played(SYSTEM, policy, 5)[-1] for policy in (f"fixed:{LONG_UP}", "myopic"))
    np.testing.assert_allclose(SYSTEM.cost(always.belief), SYSTEM.cost(myopic.belief), rtol=1e-3)


def test_the_belief_has_the_fields_of_tracks():
    assert Belief._fields[1:] == Tracks._fields


@pytest.mark.slow
def test_a_tree_of_futures_can_be_searched():
    """The belief has no single covariance: the tree identifies nodes by the whole observation."""
    system = Urban(horizon=40)
    worlds = oracles.worlds(system, 2)
    played = rollout(system, make_policy("mcts:6", system, worlds), worlds)
    longest = rollout(system, make_policy("fixed:0", system, None), worlds)
    np.testing.assert_array_equal(played.steps, 40)
    assert (played.mean_cost <= 1.05 * longest.mean_cost).all()
