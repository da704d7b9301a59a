"""The agile-clutter loop and its prediction against plain NumPy; the one-step choice against exhaustive search."""

from __future__ import annotations

import agile_clutter_oracle as plain
import numpy as np
import oracles
import pytest

from research.papers.agile_clutter.study import CountingEverySensor
from wavegym.core import shortcuts
from wavegym.schedulers import Myopic
from wavegym.systems.agile_clutter.shortcuts import after_sensor, sensor_costs
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.waveforms import parse_law

WELL = ("pfm:3", "hfm:0.5", "efm:0.5")  # 1 - rho^2 about 0.06
CROSSING = ((2e3, -1e3, -100.0, 800.0), (1.9e3, -1e3, -60.0, 800.0), (1e3, -1e3, 100.0, 800.0))
TABLES = 1e-3  # standard deviations by which the interpolated law may move estimates
THREE = {"starts": CROSSING, "births": (0, 1, 7), "lifetime": 12, "horizon": 14, "durations": (100e-6,)}


SEVERAL = {"false_alarms": (1e-4, 1e-2, 0.1), "durations": (100e-6,), "sweeps": (15e6,)}


def transmitted(system, actions):
    """C (env, sensor, 2, 2) of the chirps that ``actions`` name, by quadrature."""
    laws = [parse_law(law) for law in system.laws]
    chirps = [(law, d, sign * s) for law in laws for d in system.durations for s in system.sweeps for sign in (1, -1)]
    if system.action == "joint":
        longest, widest = max(system.durations), max(system.sweeps)
        chirps = [(law, longest, sign * widest) for law in laws for sign in (1, -1)]
        actions = np.stack(np.unravel_index(actions, (len(chirps),) * len(system.sensors)), axis=-1)
    if system.action != "box":
        return np.array([[plain.unit_covariance(*chirps[j][0], *chirps[j][1:]) for j in row] for row in actions])
    low, high, top = min(system.durations), max(system.durations), max(system.sweeps)

    def chirp(a, b, c):
        law = laws[min(int(len(laws) * (a + 1) / 2), len(laws) - 1)]
        return plain.unit_covariance(*law, low * (high / low) ** ((b + 1) / 2), top * c)

    return np.array([[chirp(*point) for point in row.reshape(-1, 3)] for row in actions])


def random_actions(system, rng, count):
    if system.action == "box":
        return rng.uniform(-1, 1, (count, 3 * len(system.sensors)))
    if system.action == "joint":
        return rng.integers(len(system.candidates()), size=count)
    return rng.integers(len(system.actions), size=(count, len(system.sensors)))


def apart(got, want):
    """Largest differences of means and of covariances, in standard deviations of ``want``."""
    sigma = np.sqrt(np.diagonal(want.covariance, axis1=-2, axis2=-1))
    off = oracles.covariance_distance(got.covariance, want.covariance)
    return max(np.abs((got.mean - want.mean) / sigma).max(), off)


@pytest.mark.parametrize(
    "settings",
    [
        {"laws": WELL},
        {"laws": WELL, "action": "joint"},
        {"laws": WELL, "action": "box", "gate": 1.5},
        {"laws": WELL, **THREE, "sweeps": (15e6,)},
        {"laws": WELL, "snr_law": "printed"},
        {"laws": WELL, "fluctuation": "swerling3", "false_alarm": 1e-3},
        {"laws": ("lfm",), "durations": (100e-6,), "sweeps": (15e6,), "horizon": 4},
    ],
)
def test_transition_with_jpda_is_the_plain_loop(settings):
    """The plain loop runs on its own results, so errors may add up over the episode.

    Pd and the effective eta are interpolated, with relative errors of 1e-4 at most: hence TABLES.
    """
    system = AgileClutter(tracker="jpda", **settings)
    worlds, rng = oracles.worlds(system, 2, seed=5), np.random.default_rng(6)
    state = system.initial(worlds)
    mean, covariance = state.belief.mean.copy(), state.belief.covariance.copy()
    outside = np.zeros(state.truth.outside.shape, int)
    for k in range(system.horizon):
        actions = random_actions(system, rng, 2)
        C, belief = transmitted(system, actions), state.belief._replace(mean=mean, covariance=covariance)
        state = system.transition(state, actions, worlds)
        steps = [plain.step(system, worlds, e, belief, state.truth.path[e], C[e]) for e in range(2)]
        want = plain.Step(*(np.array(parts) for parts in zip(*steps, strict=True)))
        mean, covariance, outside = want.mean, want.covariance, outside + want.outside
        assert apart(state.belief, want) < TABLES, f"step {k + 1}"
        metrics = system.state_info(state)
        np.testing.assert_array_equal(metrics["detections"], want.detections)
        np.testing.assert_array_equal(metrics["clutter"], want.clutter)
        np.testing.assert_array_equal(state.truth.outside, outside)
        np.testing.assert_array_equal(metrics["returns_outside"], outside)
    assert (outside.max() > 5) == (system.gate < 2.0)


def test_the_papers_rule_counts_at_every_sensor():
    system = CountingEverySensor(tracker="jpda", gate=1.5)
    first = AgileClutter(tracker="jpda", gate=1.5)
    worlds, rng = oracles.worlds(system, 2, seed=5), np.random.default_rng(6)
    state, outside = system.initial(worlds), 0
    for _ in range(system.horizon):
        actions = random_actions(system, rng, 2)
        C, before = transmitted(system, actions), state
        state = system.transition(state, actions, worlds)
        steps = [plain.step(system, worlds, e, before.belief, state.truth.path[e], C[e]) for e in range(2)]
        outside = outside + np.array([step.outside for step in steps])
        np.testing.assert_array_equal(system.state_info(state)["clutter"], [step.clutter for step in steps])
        np.testing.assert_array_equal(state.truth.outside, outside)
        fewer = first.transition(before, actions, worlds)
        assert (fewer.truth.outside <= state.truth.outside).all()
        np.testing.assert_array_equal(fewer.belief.covariance, state.belief.covariance)


def beliefs(system, count=3, steps=(0, 6, 7, 20), seed=1):
    """Beliefs at several steps of episodes with random actions."""
    worlds, rng = oracles.worlds(system, count, seed), np.random.default_rng(seed)
    state, found = system.initial(worlds), []
    for k in range(max(steps) + 1):
        if k in steps:
            found.append(state.belief)
        state = system.transition(state, random_actions(system, rng, count), worlds)
    return found


@pytest.mark.parametrize("action", ["library", "joint", "box"])
@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("snr_law", ["realised", "printed"])
def test_predict_is_equations_13_and_14_mended(action, given, snr_law):
    system = AgileClutter(laws=WELL, action=action, snr_law=snr_law)
    rng = np.random.default_rng(2)
    for belief in beliefs(system):
        actions = random_actions(system, rng, 3)
        outcome = rng.integers(2, size=(3, 2, 2)).astype(float) if given else None  # 0: detected, 1: missed
        C, got = transmitted(system, actions), system.predict(belief, actions, outcome)
        for e in range(3):
            detected = outcome[e] == 0.0 if given else None
            x, P = plain.predicted_after(system, belief.step[e], belief.mean[e], belief.covariance[e], C[e], detected)
            one = got._replace(mean=got.mean[e], covariance=got.covariance[e])
            assert apart(one, plain.Step(x, P, np.zeros(2), 0, 0)) < TABLES
        np.testing.assert_array_equal(got.step, belief.step + 1)


@pytest.mark.parametrize("gate", [3.0, 4.0, 6.0])
def test_prediction_knows_clutter_by_its_density_whatever_the_gate(gate):
    """q2 depends on the clutter density: a wider gate includes more clutter, but far from the target's return."""
    system = AgileClutter(laws=WELL, gate=gate, clutter_density=1e-3)
    belief = beliefs(system, steps=(7,))[0]
    actions = np.array([[0, 17], [5, 3], [12, 9]])
    got, C = system.predict(belief, actions), transmitted(system, actions)
    for e in range(3):
        _, P = plain.predicted_after(system, 7, belief.mean[e], belief.covariance[e], C[e])
        assert oracles.covariance_distance(got.covariance[e], P) < TABLES


@pytest.mark.parametrize("settings", [{}, SEVERAL])
def test_sensor_costs_are_the_cost_of_predict_sensor_after_sensor(settings):
    system = AgileClutter(**settings)
    pulses = system.action_set
    C, windows, alarm = pulses.sensor_covariances, pulses.sensor_windows, pulses.thresholds[1]
    for belief in beliefs(system):
        predicted, choices = system.predicted_targets(belief), [np.array([3, 9, 20]), np.array([17, 1, 8])]
        first, last = ((C[chosen], windows[chosen], alarm[chosen]) for chosen in choices)
        after = after_sensor(system, predicted, 0, *first)
        second = sensor_costs(system, after, 1, C[None], windows[None], alarm)
        actions = np.stack([np.stack([choices[0], np.full(3, c)], axis=1) for c in range(len(C))], axis=1)
        np.testing.assert_allclose(second, system.cost(system.predict(belief, actions)), rtol=1e-9)
        chosen = np.take_along_axis(second, choices[1][:, None], axis=1)[:, 0]
        both = after_sensor(system, after, 1, *last)._replace(present=predicted.present)
        P = np.diagonal(both.covariance, axis1=2, axis2=3).sum(axis=2)
        np.testing.assert_allclose((P * predicted.present).sum(axis=1), chosen, rtol=1e-9)


@pytest.mark.parametrize("settings", [{}, SEVERAL, SEVERAL | {"action": "joint"}])
def test_the_second_sensor_is_chosen_as_by_trying_all(settings):
    """With the first sensor's choice given, nothing is approximate: the second choice has the least predicted cost."""
    system = AgileClutter(**settings)
    count = len(system.action_set.sensor_library)
    for belief in beliefs(system):
        best = shortcuts.best_action(system, belief)
        first = system.action_set.joint.indices[best, 0] if system.action == "joint" else best[:, 0]
        tried = np.stack([np.stack([first, np.full(3, c)], axis=1) for c in range(count)], axis=1)
        cost = system.cost(system.predict(belief, system.action_set.encode(tried)))
        chosen = system.cost(system.predict(belief, best))
        np.testing.assert_allclose(chosen, cost.min(axis=1), rtol=1e-12)


@pytest.mark.parametrize(
    "settings",
    [
        {"durations": (30e-6, 100e-6), "sweeps": (15e6,)},
        {"action": "joint"},
        {"action": "box", "durations": (30e-6, 100e-6), "sweeps": (15e6,)},
        SEVERAL,
        {"action": "joint", "false_alarms": (1e-4, 0.1), "laws": WELL},
    ],
)
def test_sensor_by_sensor_is_nearly_the_joint_grid(settings):
    """The choice sensor by sensor differs from that of the joint grid, but costs hardly more.

    Measured: with the whole library (16 worlds, 32 steps) it is worse in 10 % of the states, by 7.2 % of the trace at
    most and 0.05 % on average; without clutter in 4 %, by 1.1 % at most. Over whole episodes of a library of 16 (200
    worlds) the ratio of costs is 0.998 +- 0.013.
    """
    system = AgileClutter(**settings)
    worlds, exhaustive = oracles.worlds(system, 12, seed=9), Myopic(fused=False)
    exhaustive.begin(system, 12, np.random.default_rng(0))
    state, gaps = system.initial(worlds), []
    for _ in range(system.horizon):
        choices = shortcuts.best_action(system, state.belief), exhaustive.act(state.belief, None, None)
        chosen, least = (system.cost(system.predict(state.belief, actions)) for actions in choices)
        gaps.append(chosen / least - 1)
        state = system.transition(state, choices[0], worlds)
    gaps = np.array(gaps)
    assert gaps.min() > -1e-12
    assert gaps.max() < 0.1
    assert gaps.mean() < 0.002
    assert (gaps < 1e-12).mean() > 0.8
