"""Plans under an account: exchanges stay within it, and end where no change that can be paid saves anything."""

import numpy as np
import pytest
from delay_systems import CANDIDATES, SPENDING, DelaySystem, delay_worlds

from wavegym.schedulers.heuristics.price_policies import LagrangianPrice
from wavegym.schedulers.planners.base import SampledFutures
from wavegym.schedulers.planners.receding_horizon import exchanged

WORLDS = 12
OPTIONS = np.tile(np.arange(len(CANDIDATES)), (WORLDS, 1))


def begun(system):
    futures = SampledFutures(LagrangianPrice(2.0, 3), system.horizon, 1)
    futures.begin(system, WORLDS, np.random.default_rng(0))
    return futures, system.initial(delay_worlds(system, WORLDS)).belief


@pytest.mark.parametrize("pd", [1.0, 0.6])
@pytest.mark.parametrize("first", ["silent", "the dearest as long as it lasts"])
def test_an_exchanged_plan_stays_within_the_account_and_no_single_change_that_fits_saves_more(pd, first):
    system = DelaySystem(horizon=8, setup=0, budget=2.4, pd=pd)
    futures, belief = begun(system)
    plan = np.full((WORLDS, system.horizon), CANDIDATES.index("silence"))
    if first != "silent":
        plan[:, :2] = CANDIDATES.index("A long")
    before = futures.costs(belief, plan[:, None], None, None)[:, 0, 0]
    found = exchanged(futures, belief, plan, OPTIONS, None, None, 50)
    cost = futures.costs(belief, found[:, None], None, None)[:, 0, 0]
    assert (cost < before).all()
    assert (SPENDING[found].sum(axis=1) <= system.budget + 1e-9).all()
    for step in range(system.horizon):
        for option in OPTIONS[0]:
            changed = found.copy()
            changed[:, step] = option
            fits = SPENDING[changed].sum(axis=1) <= system.budget + 1e-9
            costs = futures.costs(belief, changed[:, None], None, None)[:, 0, 0]
            assert (costs[fits] >= cost[fits] * (1 - 1e-9)).all()


def test_what_is_spent_too_early_is_moved_to_where_it_saves_more():
    """The account pays one pulse. It must move to the place of least cost, which no single change can achieve."""
    system = DelaySystem(horizon=6, setup=0, budget=1.0, pd=1.0)
    futures, belief = begun(system)
    plan = np.full((WORLDS, system.horizon), CANDIDATES.index("silence"))
    plan[:, 0] = CANDIDATES.index("B long")
    found = exchanged(futures, belief, plan, OPTIONS, None, None, 50)
    cost = futures.costs(belief, found[:, None], None, None)[:, 0, 0]
    for step in range(system.horizon):
        for option in map(CANDIDATES.index, ("A long", "B long")):
            moved = np.full_like(plan, CANDIDATES.index("silence"))
            moved[:, step] = option
            assert (futures.costs(belief, moved[:, None], None, None)[:, 0, 0] >= cost * (1 - 1e-9)).all()


def test_a_plan_that_nothing_improves_stays_as_it_is():
    system = DelaySystem(horizon=5, setup=0, budget=0.0, pd=1.0)
    futures, belief = begun(system)
    plan = np.full((WORLDS, system.horizon), CANDIDATES.index("silence"))
    np.testing.assert_array_equal(exchanged(futures, belief, plan, OPTIONS, None, None, 5), plan)
