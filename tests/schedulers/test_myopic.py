"""The grid's choice against plain matrices over all actions."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import oracles
import pytest
from rf_eo_scenes import FOLDED, beliefs, scene
from scheduler_systems import CA, Ladder, Start

from wavegym.core import shortcuts
from wavegym.schedulers import Myopic, rollout
from wavegym.schedulers.myopic import determinant
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition


def objectives(system, mean, P):
    """Each objective of every action, from the formulas."""
    n = len(mean)
    F, Q = oracles.motion(n, system.dt, system.q)
    x, ahead = oracles.predict(mean, P, F, Q)
    values = {"trace": [], "determinant": [], "gate": []}
    for k in system.durations:
        for sweep in system.sweeps:
            R = oracles.received_covariance(k, sweep, x[0], system.reference_range)
            _, updated = oracles.update(x, ahead, np.zeros(2), np.eye(2, n), R)
            values["trace"].append(np.diag(updated) @ system.weights)
            values["determinant"].append(np.linalg.det(updated))
            values["gate"].append(np.linalg.det(ahead[:2, :2] + R))
    return values


@pytest.mark.parametrize("objective", ["trace", "determinant", "gate"])
@pytest.mark.parametrize("system", [KershawEvansPosition(), KershawEvans(sweeps=(0.0, 1e6, -1e6), **CA)])
@pytest.mark.slow
def test_the_choice_is_the_least_over_all_actions(system, objective):
    rng = np.random.default_rng(0)
    n = len(system.weights)
    belief = system.initial(oracles.worlds(system, 30)).belief
    belief = belief._replace(covariance=oracles.random_covariance(rng, n, (30,)))
    policy = Myopic(objective)
    policy.begin(system, 30, rng)
    chosen = policy.act(belief, None, None)
    assert objective == "determinant" or len(np.unique(chosen)) > 1  # det P runs to an edge whatever the belief
    for e in range(30):
        values = np.array(objectives(system, belief.mean[e], belief.covariance[e])[objective])
        assert values[chosen[e]] <= values.min() * (1 + 1e-8)


def test_what_is_masked_is_not_chosen():
    system = KershawEvansPosition()
    belief = system.initial(oracles.worlds(system, 5)).belief
    policy = Myopic()
    policy.begin(system, 5, None)
    free = policy.act(belief, None, None)
    mask = np.ones((5, 56), bool)
    assert (policy.act(belief, None, mask) == free).all()
    mask[np.arange(5), free] = False
    second = policy.act(belief, None, mask)
    cost = system.cost(system.predict(belief, np.arange(56)[None]))
    assert (second == np.argsort(cost, axis=1)[:, 1]).all()
    ladder = Ladder()
    worlds = oracles.worlds(ladder, 20)
    level = worlds.level
    for k in range(ladder.horizon):
        actions = rollout(ladder, Myopic(), worlds).actions[:, k]
        live = level <= 40
        assert ladder.mask(ladder.initial(Start(level)).belief)[np.arange(20), actions][live].all()
        level = ladder.predict(ladder.initial(Start(level)).belief, actions).level


def test_a_box_is_searched_at_its_librarys_points():
    library, box = KershawEvansPosition(), KershawEvansPosition(action="box")
    belief = library.initial(oracles.worlds(library, 10)).belief
    chosen = []
    for system in (library, box):
        policy = Myopic()
        policy.begin(system, 10, None)
        chosen.append(policy.act(belief, None, None))
    assert (chosen[1] == box.candidates()[chosen[0]]).all()


def test_an_own_objective():
    system = KershawEvansPosition()
    belief = system.initial(oracles.worlds(system, 4)).belief
    policy = Myopic(lambda system, belief, candidates: -np.ones((4, 1)) * candidates)
    policy.begin(system, 4, None)
    assert (policy.act(belief, None, None) == 55).all()


@pytest.mark.parametrize("kind", [{}, {"far": True}, FOLDED], ids=["near", "far", "folded"])
@pytest.mark.parametrize("margin", [0.0, 2.0])
@pytest.mark.parametrize(
    ("platforms", "targets", "points"),
    [(1, 1, (8, 2, 8)), (1, 3, (8, 1, 8)), (2, 2, (4, 1, 4)), (2, 3, (4, 1, 4)), (3, 1, (3, 1, 3)), (3, 3, (3, 1, 3))],
)
def test_a_search_platform_after_platform_is_nearly_the_best_of_all_settings(kind, margin, platforms, targets, points):
    """For one platform the search finds the best setting. For several it does so in most cases.

    Over these beliefs these are 19 of 20 cases with two targets, and 3 of 4 with three targets. With three targets it
    is off by 0.5 % on average: by 2 % at most with two platforms, and once by 16 % with three.
    """
    system = scene(platforms=platforms, targets=targets, points=points, action="joint", margin=margin, **kind)
    belief = beliefs(system)
    costs = []
    for fused in (True, False):
        policy = Myopic(fused=fused)
        policy.begin(system, len(belief.step), None)
        costs.append(system.cost(system.predict(belief, policy.act(belief, None, None))))
    off = costs[0] / costs[1] - 1
    assert off.min() > -1e-9
    assert off.max() < (1e-9, 0.02, 0.2)[platforms - 1]
    assert off.mean() < 0.005
    assert (off < 1e-9).mean() > (0.95 if targets < 3 else 0.75)


WHOLE = ((2.0, 0.5, -0.3, 0.0), (0.5, 40.0, 0.0, -6.0), (-0.3, 0.0, 1.0, 0.2), (0.0, -6.0, 0.2, 9.0))


@pytest.mark.parametrize("kind", [{}, {"far": True}, FOLDED], ids=["near", "far", "folded"])
def test_a_search_minimises_the_trace_of_the_whole_weighting_matrix(kind):
    system = scene(points=(4, 1, 4), action="joint", weights=WHOLE, **kind)
    belief = beliefs(system)
    predicted = system.predict(belief, system.candidates()[None])
    want = np.einsum("ij,ectji->ec", np.array(WHOLE), predicted.covariance)
    np.testing.assert_allclose(system.cost(predicted), want, rtol=1e-12)
    chosen = shortcuts.best_action(system, belief)
    off = want[np.arange(len(chosen)), chosen] / want.min(axis=1) - 1
    assert off.max() < 0.02
    assert (off < 1e-9).mean() > 0.95
    diagonal = dataclasses.replace(system, weights=tuple(np.diag(WHOLE).tolist()))
    assert np.abs(diagonal.cost(predicted) / want - 1).max() > 0.01
    first, cost = shortcuts.plan(system, belief, 1)
    np.testing.assert_allclose(cost, want[np.arange(len(first)), first], rtol=1e-9)


def test_a_systems_own_search_needs_no_candidates():
    class Own(KershawEvansPosition):
        def candidates(self):
            raise AssertionError

    @shortcuts.best_action.register(Own)
    def best_action(system, belief):
        return np.full(len(belief.step), 7)

    system = Own()
    belief = system.initial(oracles.worlds(system, 3)).belief
    policy = Myopic()
    policy.begin(system, 3, None)
    assert policy.act(belief, None, None).tolist() == [7, 7, 7]
    with pytest.raises(AssertionError):
        policy.act(belief, None, np.ones((3, 56), bool))


def test_a_margin_of_prediction_replaces_the_systems_own():
    system = scene(True, margin=0.0)
    belief = beliefs(system, 3, 4)
    chosen = {}
    for margin in (None, 0.0, 2.0):
        policy = Myopic(margin=margin)
        policy.begin(system, len(belief.step), None)
        chosen[margin] = policy.act(belief, None, None)
    assert (chosen[None] == chosen[0.0]).all()
    assert (chosen[2.0] == shortcuts.best_action(dataclasses.replace(system, margin=2.0), belief)).all()
    assert (chosen[2.0] != chosen[0.0]).any()


def test_a_small_product_of_determinants_counts_not_a_small_sum():
    dets = np.array([[[1.0, 16.0], [4.0, 5.0]]])  # (env, candidate, target); products 16 and 20, sums 17 and 9
    covariance = dets[..., None, None] ** 0.5 * np.eye(2)
    system = SimpleNamespace(predict=lambda belief, actions: SimpleNamespace(covariance=covariance))
    np.testing.assert_allclose(determinant(system, None, np.arange(2)[None]), [[16.0, 20.0]], rtol=1e-12)


def test_the_determinant_of_several_targets_is_their_product():
    system = scene(False, action="joint", points=(2, 1, 2))
    belief = beliefs(system, 3, 4)
    policy = Myopic("determinant")
    policy.begin(system, len(belief.step), None)
    covariance = system.predict(belief, system.candidates()[None]).covariance  # (env, candidate, target, 4, 4)
    together = np.linalg.slogdet(covariance)[1].sum(axis=2)
    np.testing.assert_array_equal(policy.act(belief, None, None), together.argmin(axis=1))
