"""Rollouts of dwells: what they choose."""

from __future__ import annotations

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.schedulers.heuristics.grids import SEARCHED_DWELL
from wavegym.schedulers.heuristics.timeline_rules import SearchedDwell
from wavegym.schedulers.planners.rollout import DwellRollout
from wavegym.schedulers.registry import make_policy
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

SYSTEM = MultifunctionRadar(known=1.0, slots=30)
BASE = SearchedDwell(**SEARCHED_DWELL)


def first_choice(policy):
    worlds = draw_worlds(SYSTEM, world_seeds(0, "tune", 8))
    belief = SYSTEM.initial(worlds).belief
    policy.begin(SYSTEM, 8, np.random.default_rng(0))
    return policy.act(belief, None, SYSTEM.mask(belief)), belief


def test_with_one_candidate_it_is_the_rule():
    np.testing.assert_array_equal(first_choice(DwellRollout(BASE, 1, candidates=1))[0], first_choice(BASE)[0])


def test_the_candidate_of_least_simulated_cost_is_taken():
    planner = DwellRollout(BASE, 2, candidates=5, seconds=0.1)
    action, belief = first_choice(planner)
    score = np.where(SYSTEM.mask(belief), shortcuts.scores(SYSTEM, belief, planner.rule), -np.inf)
    tried = np.argsort(-score, axis=1)[:, :5]
    cost = shortcuts.simulate(SYSTEM, belief, tried, planner.rule, 0.1, 2)
    np.testing.assert_array_equal(action, tried[np.arange(8), cost.argmin(axis=1)])


def test_its_name_says_how_many_futures_it_simulates():
    planner = make_policy("dwell-rollout:3", MultifunctionRadar(), None)
    assert isinstance(planner, DwellRollout)
    assert planner.futures == 3
