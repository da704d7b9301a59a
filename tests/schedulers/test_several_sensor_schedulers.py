"""Schedulers over the actions of several sensors, and a system's own shorter list of constants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import oracles
import pytest
from scipy.stats import chi2
from two_sensors import DRIFT, Coupled, Quick, TwoSensors, variances

from wavegym.core import shortcuts
from wavegym.core.errors import InputError
from wavegym.schedulers import Fixed, Lookahead, Myopic, RandomChoice, RoundRobin, rollout
from wavegym.schedulers.simple import FEW
from wavegym.schedulers.tuning import best_fixed

SYSTEM, JOINT, BOX = (TwoSensors(action=form) for form in ("library", "joint", "box"))
ALL = [[i, j] for i in range(3) for j in range(3)]


def ready(policy, system, count, seed=0):
    policy.begin(system, count, np.random.default_rng(seed))
    return policy, system.initial(oracles.worlds(system, count)).belief


def test_candidates_are_all_combinations_and_constants_what_the_system_says():
    assert SYSTEM.candidates().tolist() == ALL
    assert JOINT.candidates().tolist() == [0, 1, 2, 3]
    assert BOX.candidates().shape == (9, 2)
    assert shortcuts.constants(SYSTEM).tolist() == [[0, 0], [1, 1], [2, 2]]
    assert shortcuts.constants(JOINT).tolist() == [0, 3]
    assert (shortcuts.constants(BOX) == BOX.candidates()).all()


def test_fixed_and_round_robin_choose_among_the_constants():
    policy, belief = ready(Fixed(1), SYSTEM, 4)
    assert policy.act(belief, None, None).tolist() == [[1, 1]] * 4
    with pytest.raises(InputError, match=r"fixed:3 is no constant action, expected 0 to 2 .nearest: 2"):
        ready(Fixed(3), SYSTEM, 1)
    policy, belief = ready(RoundRobin(), SYSTEM, 4)
    belief = belief._replace(step=np.array([0, 1, 2, 3]))
    assert policy.act(belief, None, None).tolist() == [[0, 0], [1, 1], [2, 2], [0, 0]]


def test_best_fixed_is_the_cheapest_constant():
    worlds = oracles.worlds(SYSTEM, 30)
    costs = []
    for waveforms in shortcuts.constants(SYSTEM):
        state, total = SYSTEM.initial(worlds), 0.0
        for _ in range(SYSTEM.horizon):
            state = SYSTEM.transition(state, np.tile(waveforms, (30, 1)), worlds)
            total += SYSTEM.cost(state.belief).sum()
        costs.append(total)
    assert best_fixed(SYSTEM, worlds) == int(np.argmin(costs))


@dataclass(frozen=True)
class Few(Coupled):
    """Its constants are the last three of four joint actions, of which the last is never allowed."""


@shortcuts.constants.register(Few)
def constants(system: Few):
    return np.array([3, 0, 2])


def test_a_mask_speaks_of_actions_whatever_the_constants():
    policy, belief = ready(Fixed(0), Few(), 2)
    belief = belief._replace(step=np.array([0, 1]))
    mask = Few().mask(belief)
    assert mask.tolist() == [[True, False, False, False], [True, True, True, False]]
    assert policy.act(belief, None, mask).tolist() == [0, 0]
    policy, _ = ready(Fixed(2), Few(), 2)
    assert policy.act(belief, None, mask).tolist() == [0, 2]


def test_random_is_uniform_over_all_combinations():
    policy, belief = ready(RandomChoice(), SYSTEM, 9000)
    tally = np.bincount(policy.act(belief, None, None) @ np.array([3, 1]), minlength=9)
    assert np.square(tally - 1000).sum() / 1000 < chi2.ppf(1 - 1e-6, 8)


@pytest.mark.slow
def test_random_draws_every_sensor_apart_and_keeps_to_a_mask_of_combinations():
    system = TwoSensors(durations=tuple(np.geomspace(1e-7, 1e-5, 40).tolist()))
    assert len(system.candidates()) == 1600 > FEW
    policy, belief = ready(RandomChoice(), system, 16_000, seed=3)
    chosen = policy.act(belief, None, None)
    counts = np.bincount(chosen @ np.array([40, 1]), minlength=1600)  # nearly Poisson of mean 10
    assert counts.max() < 30  # above this once in 2000 runs
    assert 0.85 < counts.var() / 10 < 1.15  # four standard deviations
    mask = np.zeros((16_000, 1600), bool)
    mask[:, 7:9] = True
    masked = policy.act(belief, None, mask)
    assert set(map(tuple, masked.tolist())) == {(0, 7), (0, 8)}


def test_myopic_takes_the_least_of_all_combinations():
    policy, belief = ready(Myopic(), SYSTEM, 20)
    k = np.array(SYSTEM.durations)
    for e, action in enumerate(policy.act(belief, None, None)):
        costs = {}
        for i, j in ALL:
            R = variances(k[[i, j]], belief.mean[e])
            costs[i, j] = sum(1 / (1 / (belief.variance[e, t] + DRIFT**2) + (1 / R[:, t]).sum()) for t in range(2))
        assert costs[tuple(action)] == pytest.approx(min(costs.values()), rel=1e-12)


def test_a_systems_own_search_is_used_for_the_unmasked_trace_only():
    calls = []

    class Counted(Quick):
        pass

    @shortcuts.best_action.register(Counted)
    def counted(system, belief):
        calls.append(1)
        return system.search(belief)

    for form, used in (("library", True), ("joint", False), ("box", False)):
        system = Counted(action=form)
        fused, belief = ready(Myopic(), system, 200)
        exhaustive, _ = ready(Myopic(fused=False), system, 200)
        chosen = fused.act(belief, None, None)
        assert len(calls) == 1  # which the other forms answer with NotImplementedError
        calls.clear()
        assert len(np.unique(chosen, axis=0)) > 1 or not used
        want = exhaustive.act(belief, None, None)
        cost = [system.cost(system.predict(belief, actions)) for actions in (chosen, want)]
        np.testing.assert_allclose(*cost, rtol=1e-12)
        own, _ = ready(Myopic(lambda system, belief, candidates: np.ones((200, candidates.shape[1]))), system, 200)
        assert (own.act(belief, None, None) == system.candidates()[0]).all()
        everything = np.ones((200, len(system.candidates())), bool)
        assert (fused.act(belief, None, everything) == want).all()
        assert calls == []


def test_a_lookahead_over_combinations_is_no_dearer_than_one_step_predicts():
    worlds = oracles.worlds(SYSTEM, 5)
    played = [rollout(SYSTEM, policy, worlds) for policy in (Lookahead(1), Myopic(), Lookahead(2))]
    assert (played[0].actions == played[1].actions).all()
    assert played[2].actions.shape == (5, SYSTEM.horizon, 2)
    first, second = played[1].actions[:, 0], played[2].actions[:, 0]
    belief = SYSTEM.initial(worlds).belief

    def predicted(action):
        after = SYSTEM.predict(belief, action)
        return SYSTEM.cost(after) + SYSTEM.cost(SYSTEM.predict(after, SYSTEM.candidates()[None])).min(axis=1)

    assert (predicted(second) <= predicted(first) * (1 + 1e-12)).all()
