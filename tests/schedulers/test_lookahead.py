"""Lookahead: fused search = generic search = all sequences written out."""

from __future__ import annotations

import itertools

import numpy as np
import oracles
import pytest
from rf_eo_scenes import FOLDED, beliefs, scene
from scheduler_systems import Ladder, Start, small, small_ca

from wavegym.core import shortcuts, trees
from wavegym.core.errors import InputError
from wavegym.schedulers import Lookahead, Myopic, lookahead, rollout
from wavegym.systems.kershaw_evans.system import KershawEvansPosition


def sequences(system, mean, P, depth):
    """Cost of every sequence, in plain matrices; SNR at the predicted range."""
    n = len(mean)
    F, Q = oracles.motion(n, system.dt, system.q)
    pulses = [(k, sweep) for k in system.durations for sweep in system.sweeps]
    for actions in itertools.product(range(len(pulses)), repeat=depth):
        x, covariance, cost = mean, P, 0.0
        for a in actions:
            x, covariance = oracles.predict(x, covariance, F, Q)
            R = oracles.received_covariance(*pulses[a], x[0], system.reference_range)
            _, covariance = oracles.update(x, covariance, np.zeros(2), np.eye(2, n), R)
            cost += np.diag(covariance) @ system.weights
        yield actions, cost


@pytest.mark.parametrize("make", [small, small_ca])
@pytest.mark.parametrize(
    ("depth", "step", "left"),
    [(1, 0, 1), (2, 3, 2), (3, 0, 3), (3, 6, 2), (3, 7, 1), (5, 6, 2), (2, 8, 1), (3, 9, 1)],
)
def test_fused_equals_generic_equals_enumeration(make, depth, step, left):
    """``left`` is how many steps count: the episode has 8, and past its end the choice is the myopic one."""
    system = make(horizon=8)
    n = len(system.weights)
    belief = system.initial(oracles.worlds(system, 4)).belief
    belief = belief._replace(covariance=oracles.random_covariance(np.random.default_rng(depth), n, (4,)))
    belief = belief._replace(step=np.full(4, step))
    fused, generic = Lookahead(depth), Lookahead(depth, fused=False)
    for policy in (fused, generic):
        policy.begin(system, 4, None)
    chosen = fused.act(belief, None, None)
    assert (chosen == generic.act(belief, None, None)).all()
    _, costs = shortcuts.best_sequence(system, belief, depth)
    for e in range(4):
        listed = list(sequences(system, belief.mean[e], belief.covariance[e], left))
        best, cost = min(listed, key=lambda pair: pair[1])
        np.testing.assert_allclose(costs[e], cost, rtol=1e-8)
        assert chosen[e] == best[0]


def test_environments_at_different_steps_are_independent():
    system = small(horizon=5)
    belief = system.initial(oracles.worlds(system, 5)).belief._replace(step=np.arange(5))
    for fused in (True, False):
        policy = Lookahead(3, fused)
        policy.begin(system, 5, None)
        together = policy.act(belief, None, None)
        alone = [policy.act(oracles.rows(belief, slice(e, e + 1)), None, None)[0] for e in range(5)]
        assert (together == alone).all()


def ladder_value(system, level, step, depth):
    """Best cost and first action by plain recursion, masks and early ends included."""
    belief = system.initial(Start(np.array([level]))).belief._replace(step=np.array([step]))
    best = np.inf, -1
    for action in np.flatnonzero(system.mask(belief)[0]):
        after = system.predict(belief, np.array([action]))
        cost = after.level[0]
        if depth > 1 and not system.terminal(after)[0]:
            cost += ladder_value(system, after.level[0], step + 1, depth - 1)[0]
        best = min(best, (cost, action))
    return best


@pytest.mark.parametrize("depth", [1, 2, 4])
def test_masks_and_early_ends_are_predicted(depth):
    system = Ladder()
    belief = system.initial(oracles.worlds(system, 50)).belief
    policy = Lookahead(depth)
    policy.begin(system, 50, None)
    chosen = policy.act(belief, None, system.mask(belief))
    assert (chosen == [ladder_value(system, level, 0, depth)[1] for level in belief.level]).all()


@pytest.mark.slow
def test_depth_one_is_myopic_and_each_depth_is_better():
    system = KershawEvansPosition()
    worlds = oracles.worlds(system, 40)
    costs = {d: rollout(system, Lookahead(d), worlds).cost.sum(axis=1) for d in (1, 2, 3)}
    assert (rollout(system, Myopic(), worlds).cost.sum(axis=1) == costs[1]).all()
    assert costs[3].mean() < costs[2].mean() < 0.9 * costs[1].mean()


@pytest.mark.parametrize("depth", [2, 3])
def test_memory_is_bounded_by_chunks(depth, monkeypatch):
    sizes = []

    class Counting(KershawEvansPosition):
        def predict(self, belief, actions, outcome=None):
            result = super().predict(belief, actions)
            sizes.append(result.step.size)
            return result

    system = Counting(durations=(10e-6, 50e-6, 300e-6), sweeps=(0.0, 1e6, -1e6))
    belief = system.initial(oracles.worlds(system, 60)).belief
    policy = Lookahead(depth, fused=False)
    policy.begin(system, 60, None)
    free = policy.act(belief, None, None)
    assert max(sizes) == 60 * 9**depth
    sizes.clear()
    monkeypatch.setattr(lookahead, "NODES", 1000)
    assert (policy.act(belief, None, None) == free).all()
    assert max(sizes) <= 1000
    assert sum(sizes) == 60 * sum(9**d for d in range(1, depth + 1))


def predicted(system, belief, depth):
    """Cost of every sequence by repeated ``predict``, (env, first action, rest), and of the one-step scheduler's."""
    candidates, count = system.candidates(), len(belief.step)
    own, mine, total, flat = belief, 0.0, np.zeros(count), belief
    for k in range(depth):
        on = (belief.step + k < system.horizon) | (k == 0)
        own = system.predict(own, shortcuts.best_action(system, own))
        mine = mine + on * system.cost(own)
        predicted = system.predict(flat, candidates[None])
        added = np.repeat(on, len(flat.step) // count)[:, None] * system.cost(predicted)
        total = (total[:, None] + added).ravel()
        flat = trees.tree_map(lambda a: a.reshape(-1, *a.shape[2:]), predicted)
    return total.reshape(count, len(candidates), -1), mine


@pytest.mark.parametrize("far", [False, True])
@pytest.mark.parametrize(("depth", "points"), [(1, (3, 2, 3)), (2, (3, 1, 3)), (3, (2, 1, 2))])
def test_a_plan_is_nearly_the_best_of_all_sequences(far, depth, points):
    """Its cost is that of a sequence with its first action, never above the one-step scheduler's own sequence."""
    system = scene(far, points=points, action="joint")
    belief = beliefs(system)
    listed, mine = predicted(system, belief, depth)
    chosen, cost = shortcuts.plan(system, belief, depth)
    with_it = listed[np.arange(len(chosen)), chosen]
    np.testing.assert_allclose(np.abs(with_it / cost[:, None] - 1).min(axis=1), 0.0, atol=1e-9)
    assert (cost <= mine * (1 + 1e-9)).all()
    off = cost / listed.min(axis=(1, 2)) - 1
    assert off.max() < 0.005
    assert (off < 1e-9).mean() > 0.85
    if depth == 1:
        assert (chosen == shortcuts.best_action(system, belief)).all()
    elif not far:
        assert cost.sum() < mine.sum() * (1 - 1e-6)  # looking ahead is worth something here


@pytest.mark.parametrize("margin", [0.0, 2.0])
def test_a_plan_whose_worth_depends_on_the_spread_has_the_cost_of_a_sequence(margin):
    """With folding, and with a margin to the edges, what a setting is worth depends on the plan before it."""
    system = scene(points=(3, 1, 3), action="joint", margin=margin, **FOLDED)
    belief = beliefs(system)
    listed, mine = predicted(system, belief, 2)
    chosen, cost = shortcuts.plan(system, belief, 2)
    with_it = listed[np.arange(len(chosen)), chosen]
    np.testing.assert_allclose(np.abs(with_it / cost[:, None] - 1).min(axis=1), 0.0, atol=1e-9)
    assert (cost <= mine * (1 + 1e-9)).all()
    off = cost / listed.min(axis=(1, 2)) - 1
    assert off.max() < 0.005
    assert (off < 1e-9).mean() > 0.85


def test_a_plan_in_a_box_is_never_above_the_one_step_schedulers_sequence():
    system = scene()
    belief = beliefs(system, 2)
    for depth in (1, 4):
        own, mine = belief, 0.0
        for k in range(depth):
            own = system.predict(own, shortcuts.best_action(system, own))
            mine = mine + ((belief.step + k < system.horizon) | (k == 0)) * system.cost(own)
        _, cost = shortcuts.plan(system, belief, depth)
        assert (cost <= mine * (1 + 1e-9)).all()
        if depth == 1:
            np.testing.assert_allclose(cost, mine, rtol=1e-9)


def test_a_systems_plan_is_played_at_any_depth_but_not_where_it_is_unwanted():
    system = scene(points=(3, 1, 3), action="joint")
    belief = beliefs(system, 2)
    policy = Lookahead(50)
    policy.begin(system, 2, None)
    assert (policy.act(belief, None, None) == shortcuts.plan(system, belief, 50)[0]).all()
    with pytest.raises(InputError, match=r"81\^12 sequences"):
        Lookahead(50, fused=False).begin(system, 2, None)
    with pytest.raises(InputError, match=r"81\^12 sequences"):
        policy.act(belief, None, np.ones((len(belief.step), 81), bool))
    shallow, mask = Lookahead(2), np.ones((len(belief.step), 81), bool)
    shallow.begin(system, 2, None)
    free = shallow.act(belief, None, None)
    mask[np.arange(len(free)), free] = False
    masked = shallow.act(belief, None, mask)
    assert mask[np.arange(len(free)), masked].all()
    assert (masked == best_pair_masked(system, belief, mask)).all()


def best_pair_masked(system, belief, mask):
    """The first action of the cheapest two, the first of them masked."""
    cost = predicted(system, belief, 2)[0].min(axis=2)
    return np.where(mask, cost, np.inf).argmin(axis=1)


def test_an_exhaustive_search_goes_before_a_plan():
    class Both(KershawEvansPosition):
        pass

    @shortcuts.plan.register(Both)
    def plan(system, belief, depth):
        raise AssertionError

    system = Both(durations=(10e-6, 50e-6, 300e-6), sweeps=(0.0, 1e6, -1e6))
    belief = system.initial(oracles.worlds(system, 3)).belief
    policy = Lookahead(2)
    policy.begin(system, 3, None)
    assert (policy.act(belief, None, None) == shortcuts.best_sequence(system, belief, 2)[0]).all()
