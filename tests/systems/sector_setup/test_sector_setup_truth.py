"""A weaker radar, and targets that hide, of which nobody is told; and that a lost track never pays."""

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


def play(system, worlds, hidden_from=None):
    """States of an episode with a heuristic that keeps all tracks; target 1 may be hidden from a step on."""
    count, rule = len(worlds.density), CostOfDelay(alpha=0.0, ahead=18)
    rule.begin(system, count, np.random.default_rng(0))
    states = [hidden(system.initial(worlds), hidden_from)]
    for _ in range(system.horizon):
        states.append(system.transition(states[-1], rule.act(states[-1].belief, None, None), worlds))
    return states


def hidden(state, step):
    """The state whose target 1 is truly hidden from ``step`` on."""
    if step is None:
        return state
    visible = state.truth.visible.copy()
    visible[:, step:, 0] = False
    return state._replace(truth=state.truth._replace(visible=visible))


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
def test_targets_hide_although_the_belief_does_not_expect_it(name):
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
@pytest.mark.slow
def test_losing_a_track_never_pays(name, k):
    """Pairs of worlds, in one of which target 1 is not detected from step k on: the mean cost of no step falls.

    With the same actions, and with a heuristic that may spend its looks elsewhere: there by two standard errors.
    """
    system = SYSTEMS[name]
    worlds = oracles.worlds(system, 300)
    whole, adapted, same = play(system, worlds), play(system, worlds, k), [hidden(system.initial(worlds), k)]
    rule = CostOfDelay(alpha=0.0, ahead=18)
    rule.begin(system, 300, np.random.default_rng(0))
    for state in whole[:-1]:
        same.append(system.transition(same[-1], rule.act(state.belief, None, None), worlds))
    kept = np.array([system.cost(state.belief) for state in whole])
    for states, standard_errors in ((same, 0.0), (adapted, 2.0)):
        rise = np.array([system.cost(state.belief) for state in states]) - kept
        assert (rise[: k + 1] == 0.0).all()
        error = rise.std(axis=1) / np.sqrt(300)
        assert (rise.mean(axis=1) >= -standard_errors * error).all()
        total = rise.sum(axis=0)
        assert total.mean() > 4 * total.std() / np.sqrt(300)
