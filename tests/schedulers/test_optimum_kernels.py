"""The parts of the branch and bound, one by one, against eigenvalues and enumeration."""

from __future__ import annotations

import itertools

import numpy as np
import oracles
import pytest
from scheduler_systems import small, small_ca

from wavegym.core import shortcuts
from wavegym.schedulers import optimum_kernels as kernels


def sizes(n):
    return (0,) * n, (0, 0)


def order_margin(A, B):
    """Least eigenvalue of A^-1/2 (A - B) A^-1/2: B <= A where it is not negative."""
    root = np.linalg.inv(np.linalg.cholesky(A))
    return 1.0 - np.linalg.eigvalsh(root @ B @ root.T).max()


@pytest.mark.parametrize("n", [2, 3, 4])
def test_the_loewner_order_is_that_of_eigenvalues(n):
    rng = np.random.default_rng(n)
    A = oracles.random_covariance(rng, n, (2000,))
    # a perturbation of about the size that decides
    noise = rng.standard_normal((2000, n, n))
    B = A @ (np.eye(n) - 0.3 * rng.random((2000, 1, 1)) * np.eye(n)) + 0.05 * (noise + np.swapaxes(noise, 1, 2))
    tried = np.zeros((n, n))
    answers = [
        [kernels.dominates(e, B, e, A, factor, tried, sizes(n)[0]) for factor in (1.0, 1.2)] for e in range(2000)
    ]
    for e, (plain, eased) in enumerate(answers):
        margins = order_margin(A[e], B[e]), order_margin(1.2 * A[e], B[e])
        for answer, margin in zip((plain, eased), margins, strict=True):
            assert answer == (margin >= 0) or abs(margin) < 1e-9
    shares = np.mean(answers, axis=0)
    assert (shares > 0.1).all()
    assert (shares < 0.9).all()
    assert kernels.dominates(0, A, 0, A, 1.0, tried, sizes(n)[0])  # itself, with no margin
    flat = np.zeros((1, n, n))
    flat[0, 0, 0] = 1.0
    assert kernels.dominates(0, flat, 0, flat, 1.0, tried, sizes(n)[0])  # and singular


@pytest.mark.parametrize("n", [2, 3])
@pytest.mark.parametrize(("slack", "allowance", "room"), [(0.0, 0.0, np.inf), (0.0, 0.02, 12.0), (0.05, 0.0, 30.0)])
def test_pruning_drops_what_the_rule_drops_and_no_more(n, slack, allowance, room):
    rng = np.random.default_rng(7)
    count = 400
    children, nodes = (kernels.make_nodes(count, sizes(n)[0]) for _ in range(2))
    gap = rng.random(count)  # the dearer, the better known, more or less
    children.cost[...] = 10 + 0.3 * gap
    children.P[...] = (1.4 - 0.4 * gap + 0.1 * rng.random(count))[:, None, None] * np.diag(np.arange(1.0, n + 1))
    children.P[...] += 1e-4 * oracles.random_covariance(rng, n, (count,))
    children.origin[...] = np.arange(count)
    kept, lost = kernels.prune(children, count, slack, allowance, room, nodes, count, sizes(n)[0])
    assert lost == np.inf
    survivors = nodes.origin[:kept]
    assert 1 < kept < count
    assert (np.diff(nodes.cost[:kept]) >= 0).all()
    assert (nodes.P[:kept] == children.P[survivors]).all()

    def drops(b, a):
        """Whether b drops a: c_B + e (room - c_A) <= c_A + allowance with the least e >= 0 that the order allows."""
        ease = (children.cost[a] - children.cost[b] + allowance) / (room - children.cost[a])
        return order_margin((1 + slack + ease) * children.P[a], children.P[b]) >= 0

    for a in range(count):
        cheaper = [b for b in survivors if children.cost[b] < children.cost[a]]
        assert any(drops(b, a) for b in cheaper) == (a not in survivors)


@pytest.mark.parametrize("limit", [1, 5])
def test_the_cheapest_are_kept_where_room_is_short(limit):
    rng = np.random.default_rng(1)
    children, nodes = (kernels.make_nodes(50, sizes(2)[0]) for _ in range(2))
    children.cost[...] = rng.permutation(50) + 1.0
    children.P[...] = np.eye(2) / children.cost[:, None, None]  # the dearer, the better known: none is dominated
    children.origin[...] = np.arange(50)
    kept, lost = kernels.prune(children, 50, 0.0, 0.0, np.inf, nodes, limit, sizes(2)[0])
    assert kept == limit
    assert lost == limit + 1
    assert (nodes.cost[:limit] == np.arange(limit) + 1).all()


@pytest.mark.parametrize("make", [small, small_ca])
def test_no_schedule_costs_less_than_the_bound_on_what_is_to_come(make):
    system = make(horizon=6)
    recursion = shortcuts.deterministic_recursion(system, oracles.worlds(system, 1))
    _, F, Q, M, R, weights = recursion
    nn, mm = sizes(len(F))
    model = kernels.Model(F[None].copy(), Q[None].copy(), M[None].copy(), weights.copy())
    nodes, children = kernels.make_nodes(1000, nn), kernels.make_nodes(9001, nn)
    rest = kernels.cost_to_come(model, R[0].copy(), nodes, children, nn, mm)
    assert rest[-1] == 0.0
    for k in range(5):
        left = 5 - k
        least = np.inf
        for actions in itertools.product(range(9), repeat=min(left, 3)):
            P, cost = np.zeros_like(F), 0.0
            for step, a in enumerate(actions, start=k + 1):
                _, P = oracles.predict(np.zeros(len(F)), P, F, Q)
                _, P = oracles.update(np.zeros(len(F)), P, np.zeros(2), M, R[0, step, a])
                cost += np.diag(P) @ weights
            least = min(least, cost)
        if left <= 3:
            assert rest[k] <= least * (1 + 1e-9)
            assert rest[k] >= 0.5 * least  # a bound worth having
        else:
            assert rest[k] > least  # more steps, more cost
    starved = kernels.cost_to_come(model, R[0].copy(), kernels.make_nodes(2, nn), children, nn, mm)
    assert (starved <= rest).all()
    assert starved[0] < rest[0]
