"""The advantages of a rollout planner: each action's saving in shares of the mean cost, in common futures."""

import itertools

import numpy as np
import pytest

from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.schedulers import Fixed, Myopic
from wavegym.schedulers.planners import RolloutPlanner
from wavegym.schedulers.rollout import allowed
from wavegym.systems.energy_budget.system import EnergyBudget
from wavegym.systems.kershaw_evans.system import KershawEvansPosition


@pytest.mark.parametrize("holds", [(1,), (1, 3)])
def test_without_chance_it_is_the_exact_saving_of_the_best_hold(holds):
    system = KershawEvansPosition(horizon=9)
    belief = system.initial(draw_worlds(system, world_seeds(0, "tune", 3))).belief
    planner = RolloutPlanner(Myopic(), 4, shortlist=100, holds=holds)
    planner.begin(system, 3, np.random.default_rng(0))
    saving = planner.advantages(belief, None)
    costs = np.full((3, 56), np.inf)
    for first, hold in itertools.product(range(56), holds):
        here, total = belief, 0.0
        for k in range(4):
            policy = Fixed(first) if k < hold else Myopic()
            policy.begin(system, 3, np.random.default_rng(0))
            here = system.predict(here, policy.act(here, None, None))
            total = total + system.cost(here)
        costs[:, first] = np.minimum(costs[:, first], total)
    np.testing.assert_allclose(saving, 1.0 - costs / costs.mean(axis=1, keepdims=True), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(saving.sum(axis=1), 0.0, atol=1e-10)


def test_what_cannot_be_paid_has_none_and_the_rest_compare_among_themselves():
    system = EnergyBudget(budget=0.02)
    state = system.initial(draw_worlds(system, world_seeds(0, "tune", 4)))
    belief = state.belief._replace(energy=np.array([0.0, 0.25, 0.5, 2.0]))
    planner = RolloutPlanner(Fixed(0), 6, futures=2)
    planner.begin(system, 4, np.random.default_rng(0))
    mask = allowed(system, belief)
    saving = planner.advantages(belief, mask)
    assert (np.isnan(saving) == ~mask).all()
    assert saving[0, 0] == 0.0  # silence is all there is
    np.testing.assert_allclose(np.nansum(saving, axis=1), 0.0, atol=1e-10)


@pytest.mark.parametrize("holds", [(1,), (1, 3)])
@pytest.mark.slow
def test_more_futures_say_the_same_with_less_noise(holds):
    system = EnergyBudget()
    belief = system.initial(draw_worlds(system, world_seeds(0, "tune", 1))).belief
    spread = {}
    for futures in (2, 50):
        planner = RolloutPlanner(Fixed(0), 6, futures=futures, holds=holds)
        planner.begin(system, 1, np.random.default_rng(1))
        spread[futures] = np.std([planner.advantages(belief, None)[0] for _ in range(30)], axis=0).mean()
    # Of 25 times as many futures the spread is a fifth; over 30 samples it is known to a tenth or so.
    assert 0.1 < spread[50] / spread[2] < 0.4
