"""Lookahead: fused search = generic search = all sequences written out."""

from __future__ import annotations

import itertools

import numpy as np
import oracles
import pytest
from scheduler_systems import Ladder, Start, small, small_ca

from wavegym.errors import InputError
from wavegym.schedulers import Lookahead, Myopic, lookahead, rollout
from wavegym.systems.kershaw_evans import KershawEvans, KershawEvansPosition


def sequences(system, mean, P, depth):
    """Cost of every sequence, in plain matrices; SNR at the predicted range."""
    n = len(mean)
    F, Q = oracles.motion(n, system.dt, system.q)
    pulses = [oracles.chirp_covariance(k, sweep) for k in system.durations for sweep in system.sweeps]
    for actions in itertools.product(range(len(pulses)), repeat=depth):
        x, covariance, cost = mean, P, 0.0
        for a in actions:
            x, covariance = oracles.predict(x, covariance, F, Q)
            R = pulses[a] * (x[0] / 50e3) ** 4
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
    public = system.begin(oracles.worlds(system, 4)).public
    public = public._replace(covariance=oracles.random_covariance(np.random.default_rng(depth), n, (4,)))
    public = public._replace(step=np.full(4, step))
    fused, generic = Lookahead(depth), Lookahead(depth, fused=False)
    for policy in (fused, generic):
        policy.begin(system, 4, None)
    chosen = fused.act(public, None, None)
    assert (chosen == generic.act(public, None, None)).all()
    _, costs = system.best_sequence(public, depth)
    for e in range(4):
        listed = list(sequences(system, public.mean[e], public.covariance[e], left))
        best, cost = min(listed, key=lambda pair: pair[1])
        np.testing.assert_allclose(costs[e], cost, rtol=1e-8)
        assert chosen[e] == best[0]


def test_environments_at_different_steps_are_independent():
    system = small(horizon=5)
    public = system.begin(oracles.worlds(system, 5)).public._replace(step=np.arange(5))
    for fused in (True, False):
        policy = Lookahead(3, fused)
        policy.begin(system, 5, None)
        together = policy.act(public, None, None)
        alone = [policy.act(oracles.rows(public, slice(e, e + 1)), None, None)[0] for e in range(5)]
        assert (together == alone).all()


def ladder_value(system, level, step, depth):
    """Best cost and first action by plain recursion, masks and early ends included."""
    public = system.begin(Start(np.array([level]))).public._replace(step=np.array([step]))
    best = np.inf, -1
    for action in np.flatnonzero(system.mask(public)[0]):
        after = system.imagine(public, np.array([action]))
        cost = after.level[0]
        if depth > 1 and not system.ended(after)[0]:
            cost += ladder_value(system, after.level[0], step + 1, depth - 1)[0]
        best = min(best, (cost, action))
    return best


@pytest.mark.parametrize("depth", [1, 2, 4])
def test_masks_and_early_ends_are_foreseen(depth):
    system = Ladder()
    public = system.begin(oracles.worlds(system, 50)).public
    policy = Lookahead(depth)
    policy.begin(system, 50, None)
    chosen = policy.act(public, None, system.mask(public))
    assert (chosen == [ladder_value(system, level, 0, depth)[1] for level in public.level]).all()


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
        def imagine(self, public, actions, outcome=None):
            result = super().imagine(public, actions)
            sizes.append(result.step.size)
            return result

    system = Counting(durations=(10e-6, 50e-6, 300e-6), sweeps=(0.0, 1e6, -1e6))
    public = system.begin(oracles.worlds(system, 60)).public
    policy = Lookahead(depth, fused=False)
    policy.begin(system, 60, None)
    free = policy.act(public, None, None)
    assert max(sizes) == 60 * 9**depth
    sizes.clear()
    monkeypatch.setattr(lookahead, "NODES", 1000)
    assert (policy.act(public, None, None) == free).all()
    assert max(sizes) <= 1000
    assert sum(sizes) == 60 * sum(9**d for d in range(1, depth + 1))


@pytest.mark.parametrize(
    ("depth", "horizon", "most", "nearest"),
    [
        (3, 9, 729, None),
        (3, 9, 728, 2),
        (9, 3, 729, None),
        (9, 3, 728, 2),
        (2, 9, 80, 1),
        (1, 9, 1, None),
        (99, 99, 1e6, 6),
    ],
)
def test_more_sequences_than_can_be_tried_are_refused(depth, horizon, most, nearest):
    """Nine candidates; no sequence is longer than the episode, and one step is what myopic tries too."""
    policy, system = Lookahead(depth, most=most), small(horizon=horizon)
    if nearest is None:
        policy.begin(system, 1, None)
        return
    words = rf"depth is {depth}, .* 9\^{min(depth, horizon)} sequences a decision, expected .* \(nearest: {nearest}\)$"
    with pytest.raises(InputError, match=words):
        policy.begin(system, 1, None)


def test_the_suites_largest_library_can_be_looked_ahead_in_by_three():
    system = KershawEvans()
    assert len(system.candidates()) == 88
    Lookahead(3).begin(system, 1, None)
    with pytest.raises(InputError, match=r"88\^4 sequences"):
        Lookahead(4).begin(system, 1, None)


def test_a_depth_of_no_steps_is_refused():
    with pytest.raises(InputError, match="lookahead depth is 0, expected at least 1"):
        Lookahead(0)
