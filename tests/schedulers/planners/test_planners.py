"""Planners on a small system: they reach what trying everything reaches, and never lose to their base."""

from itertools import product

import numpy as np
import pytest
from delay_systems import CANDIDATES, DelaySystem, delay_worlds

from wavegym.core import trees
from wavegym.schedulers.heuristics.index_policies import AwareGreedy
from wavegym.schedulers.planners import (
    BeamSearch,
    MonteCarloTree,
    PlanOnce,
    RecedingHorizon,
    RolloutPlanner,
    TreeSearch,
    mcts,
)
from wavegym.schedulers.planners import base as planner_base
from wavegym.schedulers.planners.base import SampledFutures, significant
from wavegym.schedulers.planners.receding_horizon import neighbours
from wavegym.schedulers.rollout import rollout
from wavegym.schedulers.simple import Fixed

STEPS = 4
CERTAIN = DelaySystem(horizon=STEPS, setup=1, budget=2.0, pd=1.0)  # every pulse detects what is visible


def base():
    return AwareGreedy(0.4, 3)


def exhaustive(system, worlds):
    """The least mean cost of any sequence that can be afforded, (world,), by the closed loop itself."""
    sequences = np.array(list(product(range(len(CANDIDATES)), repeat=system.horizon)))
    count = len(worlds.noise)
    tiled = trees.take(worlds, np.repeat(np.arange(count), len(sequences)))
    state, total = system.initial(tiled), 0.0
    can = np.ones(len(tiled.noise), np.bool_)
    for t in range(system.horizon):
        action = np.tile(sequences[:, t], count)
        can &= system.mask(state.belief)[np.arange(len(can)), action]
        state = system.transition(state, action, tiled)
        total = total + system.cost(state.belief)
    return np.where(can, total, np.inf).reshape(count, -1).min(axis=1) / system.horizon


@pytest.mark.slow
@pytest.mark.parametrize(
    "planner",
    [
        TreeSearch(base(), STEPS, STEPS),
        BeamSearch(base(), 150, STEPS, levels=STEPS),
        RecedingHorizon(base(), STEPS, rounds=40, first=40),
        PlanOnce(base(), rounds=80),
        MonteCarloTree(base(), 400, STEPS),
    ],
    ids=["tree", "beam", "receding-horizon", "plan-once", "mcts"],
)
def test_planners_reach_the_exhaustive_optimum(planner):
    """Nothing is left to chance here, so the best sequence is the best policy; the base is far from it."""
    worlds = delay_worlds(CERTAIN, 12)
    best = exhaustive(CERTAIN, worlds)
    assert rollout(CERTAIN, base(), worlds).mean_cost.mean() > 1.05 * best.mean()
    np.testing.assert_allclose(rollout(CERTAIN, planner, worlds).mean_cost, best, rtol=1e-9)


def expectimax(system, belief, steps):
    """The least expected cost to come of any policy, (1,), by both outcomes of every pulse."""
    if steps == 0:
        return 0.0
    mask, best = system.mask(belief)[0], np.inf
    for action in np.flatnonzero(mask):
        chance = system.pd if not is_blind(system, belief, action) else 0.0
        value = 0.0
        for draw, weight in ((0.0, chance), (1.0, 1.0 - chance)):
            if weight > 0.0:
                after = system.predict(belief, np.array([action]), np.array([[draw]]))
                value += weight * (system.cost(after)[0] + expectimax(system, after, steps - 1))
        best = min(best, value)
    return best


def is_blind(system, belief, action):
    """Whether neither outcome differs from the other."""
    hit, miss = (system.predict(belief, np.array([action]), np.array([[draw]])).covariance for draw in (0.0, 1.0))
    return np.array_equal(hit, miss)


def expected_cost(system, policy, belief, tries, seed):
    """Mean and standard error of what ``policy`` costs from ``belief`` (1,) on, by sampled outcomes."""
    rng = np.random.default_rng(seed)
    here, total = trees.take(belief, np.zeros(tries, np.int64)), 0.0
    policy.begin(system, tries, rng)
    for _ in range(system.horizon):
        action = policy.act(here, None, system.mask(here))
        here = system.predict(here, action, rng.random((tries, 1)))
        total = total + system.cost(here)
    return total.mean(), total.std() / np.sqrt(tries)


def test_a_node_of_the_tree_search_knows_the_cost_to_come_from_it(monkeypatch):
    """With two certain steps, the root has the cost of both and its children that of the second."""
    roots, given = [], mcts._line
    monkeypatch.setattr(mcts, "_line", lambda root, options: roots.append(root) or given(root, options))
    belief = CERTAIN.initial(delay_worlds(CERTAIN, 1)).belief
    planner = MonteCarloTree(base(), 60, 2)
    planner.begin(CERTAIN, 1, np.random.default_rng(0))
    planner.act(belief, None, CERTAIN.mask(belief))
    seen = 0
    for (first, _), child in roots[0].children.items():
        after = CERTAIN.predict(belief, np.array([first]))
        for second in np.flatnonzero(child.visits):
            want = CERTAIN.cost(CERTAIN.predict(after, np.array([second])))[0]
            assert child.total[second] == pytest.approx(child.visits[second] * want, rel=1e-12)
            seen += 1
    assert seen > 5


def test_the_tree_search_tries_what_it_knows_least():
    node = mcts._Node(np.array([True, True, False]))
    node.visits[:2], node.total[:2] = (10, 2), (10.0, 2.1)  # means 1 and 1.05
    assert [node.option(0, spread) for spread in (0.0, 0.01, 1.0)] == [0, 0, 1]  # roots of ln 12 / n differ by 0.62


@pytest.mark.parametrize("is_given", [True, False])
def test_a_receding_horizon_goes_on_with_the_plan_it_has_made(is_given):
    """Given a good plan of an episode it plays the rest of it, without any search; left to its base it costs more."""
    system = DelaySystem(horizon=8, setup=1, budget=3.0, pd=1.0)
    worlds = delay_worlds(system, 12)
    good = rollout(system, PlanOnce(base(), rounds=40), worlds)
    planner = RecedingHorizon(base(), 8, rounds=0, first=0, asks=False)
    planner.begin(system, 12, np.random.default_rng(0))
    if is_given:
        planner._plan, planner._made = good.actions.copy(), np.zeros(12, np.int64)
    state, more = system.transition(system.initial(worlds), good.actions[:, 0], worlds), np.zeros(12)
    for t in range(1, 8):
        state = system.transition(state, planner.act(state.belief, None, system.mask(state.belief)), worlds)
        more += system.cost(state.belief) - good.cost[:, t]
    assert (np.abs(more) < 1e-6).all() == is_given
    assert (more > -1e-6).all()


def test_chunks_of_environments_meet_their_own_futures(monkeypatch):
    system, rng = DelaySystem(), np.random.default_rng(0)
    belief = system.initial(delay_worlds(system, 7)).belief
    futures = SampledFutures(base(), 5, 4)
    futures.begin(system, 7, rng)
    draws, plans = futures.draw(7), rng.integers(-1, len(CANDIDATES), (7, 3, 2))
    whole = futures.costs(belief, plans, None, draws)
    assert whole.shape == (7, 3, 4)
    monkeypatch.setattr(planner_base, "ROWS", 3 * 4 * 2)  # two environments at a time, and one
    np.testing.assert_array_equal(futures.costs(belief, plans, None, draws), whole)


@pytest.mark.parametrize("masked", [False, True])
def test_the_shortlist_holds_the_candidates_of_least_cost_one_step_ahead(masked):
    system = DelaySystem(setup=0)
    belief = system.initial(delay_worlds(system, 20)).belief
    planner = RolloutPlanner(base(), shortlist=2)
    planner.begin(system, 20, np.random.default_rng(0))
    mask = np.arange(len(CANDIDATES)) % 2 == 0 if masked else np.ones(len(CANDIDATES), np.bool_)
    listed, permitted = planner.options(belief, np.tile(mask, (20, 1)) if masked else None)
    costs = np.stack([system.cost(system.predict(belief, np.full(20, k))) for k in range(len(CANDIDATES))], axis=1)
    left = np.where(mask, costs, np.inf)
    np.testing.assert_array_equal(np.take_along_axis(costs, listed, axis=1), np.sort(left, axis=1)[:, :2])
    assert permitted.all()


@pytest.mark.slow
def test_searched_futures_come_close_to_the_best_policy_where_pulses_may_fail():
    """Against the exact expectimax over choices and outcomes: no better, and at most a few per cent worse."""
    system = DelaySystem(horizon=3, setup=1, budget=2.0, pd=0.6)
    belief = system.initial(delay_worlds(system, 1)).belief
    best = expectimax(system, belief, 3)
    for planner in (TreeSearch(base(), 3, 3, futures=32), MonteCarloTree(base(), 60, 3, futures=32)):
        mean, error = expected_cost(system, planner, belief, 100, 0)
        assert best - 4 * error < mean < 1.04 * best + 4 * error


@pytest.mark.slow
@pytest.mark.parametrize(
    "planner",
    [
        RolloutPlanner(base(), 12),
        TreeSearch(base(), 2, 12),
        BeamSearch(base(), 4, 12, levels=3),
        RecedingHorizon(base(), 12, rounds=2, first=10),
        RecedingHorizon(base(), 12, rounds=2, first=10, asks=False),
        MonteCarloTree(base(), 30, 12),
    ],
    ids=["rollout", "tree", "beam", "receding-horizon", "replan-unasked", "mcts"],
)
def test_no_planner_is_worse_than_its_base(planner):
    system = DelaySystem()
    worlds = delay_worlds(system, 60, seed=5)
    ratio = np.log(rollout(system, planner, worlds).mean_cost / rollout(system, base(), worlds).mean_cost)
    assert ratio.mean() + 2 * ratio.std() / np.sqrt(len(ratio)) < 0


def test_a_policy_without_prepare_can_be_a_base():
    system = DelaySystem(horizon=5)
    worlds = delay_worlds(system, 20)
    fixed = Fixed(1)
    got = rollout(system, RolloutPlanner(fixed, 5), worlds).mean_cost
    assert got.mean() < rollout(system, fixed, worlds).mean_cost.mean()


def test_costs_are_those_of_following_the_plan_by_hand():
    system = DelaySystem()
    belief = system.initial(delay_worlds(system, 3)).belief
    futures = SampledFutures(base(), depth=5, count=4)
    futures.begin(system, 3, np.random.default_rng(0))
    plans = np.array([[[0, 1], [4, 2]]] * 3)
    draws = futures.draw(3)
    got = futures.costs(belief, plans, None, draws)
    assert got.shape == (3, 2, 4)
    for e, p, f in np.ndindex(*got.shape):
        here, total, policy = trees.take(belief, np.array([e])), 0.0, base()
        policy.begin(system, 1, np.random.default_rng(0))
        for t in range(5):
            mask = system.mask(here)
            action = policy.act(here, None, mask)
            if t < 2 and mask[0, plans[e, p, t]]:
                action = plans[e, p, t : t + 1]
            here = system.predict(here, action, draws[t, e, f][None])
            total += system.cost(here)[0]
        assert got[e, p, f] == total


def test_futures_end_with_the_episode():
    system = DelaySystem(horizon=3)
    belief = system.initial(delay_worlds(system, 2)).belief
    costs = []
    for depth in (3, 9):
        futures = SampledFutures(base(), depth, 1)
        futures.begin(system, 2, np.random.default_rng(0))
        costs.append(futures.costs(belief, None, None, None))
    np.testing.assert_array_equal(*costs)


def test_a_planner_leaves_its_base_only_for_a_significant_gain():
    base_costs = np.array([[[4.0, 6.0, 5.0, 5.0]]])
    a_bit = base_costs - np.array([3.0, -2.5, 0.0, 0.0])  # mean gain 0.125, standard error 1.1
    surely = base_costs - np.array([0.1, 0.11, 0.09, 0.1])
    assert significant(a_bit, base_costs, 1.0) == -1
    assert significant(a_bit, base_costs, 0.0) == 0
    assert significant(np.concatenate([a_bit, surely], axis=1), base_costs, 1.0) == 1
    assert significant(np.full((1, 1, 4), np.inf), base_costs, 1.0) == -1


def test_the_limit_of_significance_reaches_the_decision():
    """Where detections are random: with a high limit a planner plays its base, without one it does not."""
    system = DelaySystem(horizon=8, pd=0.5)
    worlds = delay_worlds(system, 30)
    own = rollout(system, base(), worlds).actions
    plans = {errors: RolloutPlanner(base(), 4, futures=6, errors=errors) for errors in (0.0, 1.0, 1e9)}
    left = {errors: float((rollout(system, plan, worlds).actions != own).mean()) for errors, plan in plans.items()}
    assert left[1e9] == 0.0 < left[1.0] < left[0.0]


def test_neighbours_differ_by_a_move_or_two_of_what_is_still_to_come():
    rng = np.random.default_rng(0)
    plan = np.tile(np.arange(10, 18), (2, 1))
    options = np.tile(np.arange(5), (2, 1))
    found = neighbours(plan, options, np.array([8, 3]), 400, rng)
    assert found.shape == (2, 400, 8)
    assert len(np.unique(found[0], axis=0)) > 100
    put = [len(set(moved[moved < 10])) for moved in found[0]]
    assert max(put) == 2  # one action for each of two moves
    assert (np.sort(found[0], axis=1) == plan[0]).all(axis=1).any()  # exchanges keep what there is
    still = np.isin(found[1, :, 3:], np.arange(13, 18)) & (found[1, :, 3:] == plan[1, 3:])
    assert ((found[1, :, 3:] < 10) | still).all()  # beyond the end, a run may be put, nothing is moved


def test_decisions_do_not_depend_on_the_batch_where_nothing_is_drawn():
    """A future of the expected recursion does not depend on the rest of the batch."""
    belief = CERTAIN.initial(delay_worlds(CERTAIN, 5)).belief
    futures = SampledFutures(base(), STEPS, 1)
    futures.begin(CERTAIN, 5, np.random.default_rng(0))
    plans = np.tile(np.arange(5)[None, :, None], (5, 1, 1))
    together = futures.costs(belief, plans, None, None)
    for e in range(5):
        alone = futures.costs(trees.take(belief, np.array([e])), plans[:1], None, None)
        np.testing.assert_array_equal(alone[0], together[e])
