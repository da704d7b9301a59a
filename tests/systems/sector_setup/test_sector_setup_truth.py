"""A world that differs from what the tracker assumes, in both environments; and that a lost track never pays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import oracles
import pytest

from wavegym.schedulers.heuristics.index_policies import CostOfDelay
from wavegym.systems.sector_setup.city import SectorSetupCity
from wavegym.systems.sector_setup.system import SectorSetup

SYSTEMS = {
    "plain": SectorSetup(),
    "city": SectorSetupCity(),
}
EVERY = pytest.mark.parametrize("name", SYSTEMS)


def play(system, worlds):
    """States of an episode with a heuristic that keeps all tracks."""
    count, rule = len(worlds.density), CostOfDelay(alpha=0.0, ahead=18)
    rule.begin(system, count, np.random.default_rng(0))
    states = [system.initial(worlds)]
    for _ in range(system.horizon):
        states.append(system.transition(states[-1], rule.act(states[-1].belief, None, None), worlds))
    return states


def nees(system, states):
    return np.mean([system.state_info(state)["nees"] for state in states[1:]])


@pytest.mark.slow
@EVERY
def test_the_tracker_is_not_told_of_manoeuvres(name):
    """Four times the process noise: until the first look it knows nothing of them, and then its errors are too great.

    400 worlds: a NEES of mean 4 has a standard error of at most .07.
    """
    system = replace(SYSTEMS[name], iterations=1)
    mistaken = replace(system, truth={"q": tuple(4 * q for q in system.q)})
    worlds = oracles.worlds(system, 400)
    worlds = worlds._replace(detection=np.zeros_like(worlds.detection))
    here, there = system.initial(worlds), mistaken.initial(worlds)
    np.testing.assert_allclose(there.truth.q, 4 * here.truth.q, rtol=1e-12)
    for _ in range(system.dead_steps + 1):
        here, there = (
            s.transition(state, np.zeros(400, int), worlds) for s, state in ((system, here), (mistaken, there))
        )
    assert here.truth.detections.sum() > 200
    for field in ("covariance", "q", "visible"):
        seen = field == "covariance" and name == "city"  # of target 0 it is known where it is visible
        one, other = (getattr(each.belief, field)[:, 1 if seen else 0 :] for each in (here, there))
        np.testing.assert_array_equal(one, other)
    assert np.abs(here.belief.mean - there.belief.mean).max() > 0.01
    assert nees(mistaken, play(mistaken, worlds)) > nees(system, play(system, worlds)) + 0.5


@EVERY
@pytest.mark.parametrize("parameter", ["turn_rate", "prior_variance"])
def test_other_mistakes_raise_the_errors_too(name, parameter):
    """A turn of 3 degrees a second, and first errors three times as great; a tracker that is told is consistent."""
    system, worlds = SYSTEMS[name], oracles.worlds(SYSTEMS[name], 100)
    value = 0.05 if parameter == "turn_rate" else tuple(9 * variance for variance in system.prior_variance)
    mistaken, told = replace(system, truth={parameter: value}), replace(system, **{parameter: value})
    assert nees(mistaken, play(mistaken, worlds)) > 5.0
    assert abs(nees(told, play(told, worlds)) - 4.0) < 4 * np.sqrt(8 / 400)


@EVERY
def test_a_weaker_radar_detects_less_than_schedulers_expect(name):
    system = SYSTEMS[name]
    mistaken, worlds = (
        replace(system, truth={"reference_range": 0.6 * system.reference_range}),
        oracles.worlds(system, 100),
    )
    detections = [np.sum([s.truth.detections for s in play(each, worlds)]) for each in (system, mistaken)]
    assert detections[1] < 0.8 * detections[0]


@EVERY
def test_targets_hide_where_nobody_expects_it(name):
    """Windows of the truth stop detections; those of the belief are what schedulers see."""
    system = SYSTEMS[name]
    windows = tuple((t, 0, system.horizon - 1) for t in range(system.targets))
    mistaken, worlds = replace(system, truth={"windows": windows}), oracles.worlds(system, 20)
    states = play(mistaken, worlds)
    assert sum(state.truth.detections.sum() for state in states) == 0
    np.testing.assert_array_equal(states[0].belief.visible, system.initial(worlds).belief.visible)
    assert states[0].belief.visible.any()


@EVERY
@pytest.mark.parametrize("k", [10, 30])
def test_losing_a_track_never_pays(name, k):
    """Pairs of worlds, in one of which target 1 is not detected from step k on: the mean cost of no step falls.

    With the same actions, and with a heuristic that may spend its looks elsewhere: there by two standard errors.
    """
    system = SYSTEMS[name]
    worlds = oracles.worlds(system, 300)
    deaf = worlds.detection.copy()
    deaf[:, k:, :, 0] = 1.0
    lost = worlds._replace(detection=deaf)
    whole, adapted, same = play(system, worlds), play(system, lost), [system.initial(lost)]
    rule = CostOfDelay(alpha=0.0, ahead=18)
    rule.begin(system, 300, np.random.default_rng(0))
    for state in whole[:-1]:
        same.append(system.transition(same[-1], rule.act(state.belief, None, None), lost))
    kept = np.array([system.cost(state.belief) for state in whole])
    for states, standard_errors in ((same, 0.0), (adapted, 2.0)):
        rise = np.array([system.cost(state.belief) for state in states]) - kept
        assert (rise[: k + 1] == 0.0).all()
        error = rise.std(axis=1) / np.sqrt(300)
        assert (rise.mean(axis=1) >= -standard_errors * error).all()
        total = rise.sum(axis=0)
        assert total.mean() > 4 * total.std() / np.sqrt(300)
