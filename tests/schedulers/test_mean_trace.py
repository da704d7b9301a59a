"""Eq. (7) of Barbosa et al. as a scheduler: the mean trace of all tracks, beside the existence-weighted cost."""

from __future__ import annotations

import numpy as np
import oracles
import pytest

from wavegym.schedulers import Myopic, rollout
from wavegym.schedulers.myopic import mean_trace
from wavegym.systems.kershaw_evans.system import KershawEvans
from wavegym.systems.urban.system import Urban
from wavegym.systems.urban.tracker import EMPTY

SYSTEM = Urban(durations=(0.5e-6, 1.375e-6))


@pytest.fixture(scope="module")
def belief():
    """Four worlds after forty scans of round robin: tracks in some slots."""
    worlds = oracles.worlds(SYSTEM, 4)
    state = SYSTEM.initial(worlds)
    for k in range(40):
        state = SYSTEM.transition(state, np.full(4, k % 4), worlds)
    assert (state.belief.status != EMPTY).any(axis=1).all()
    return state.belief


def by_hand(predicted, e, c):
    """Mean trace over the tracks in use: moments of the mixture of models, track by track."""
    traces = []
    for t in np.flatnonzero(predicted.status[e, c] != EMPTY):
        mu, x, P = predicted.mu[e, c, t], predicted.x[e, c, t], predicted.P[e, c, t]
        off = x - mu @ x
        traces.append(np.trace(np.einsum("j,jab->ab", mu, P)) + (mu * (off**2).sum(axis=1)).sum())
    return np.mean(traces)


def test_it_is_the_mean_of_the_traces_up_to_the_number_of_tracks(belief):
    candidates = SYSTEM.candidates()[None]
    values, predicted = mean_trace(SYSTEM, belief, candidates), SYSTEM.predict(belief, candidates)
    for e in range(4):
        wanted = [by_hand(predicted, e, c) for c in range(4)]
        number = (belief.status[e] != EMPTY).sum()
        np.testing.assert_allclose(values[e] / number, wanted, rtol=1e-9)


def test_doubt_does_not_count(belief):
    doubtful = belief._replace(existence=0.3 * belief.existence)
    candidates = SYSTEM.candidates()[None]
    np.testing.assert_array_equal(mean_trace(SYSTEM, doubtful, candidates), mean_trace(SYSTEM, belief, candidates))
    costs = [SYSTEM.cost(SYSTEM.predict(one, candidates)) for one in (belief, doubtful)]
    assert (costs[0] < costs[1]).all()


def test_both_send_the_longer_pulse_at_a_track(belief):
    for policy in (Myopic(), Myopic("mean-trace")):
        policy.begin(SYSTEM, 4, np.random.default_rng(0))
        assert (policy.act(belief, None, None) >= 2).all()


def test_where_no_track_is_lost_it_is_the_cost():
    system = KershawEvans(horizon=5)
    worlds = oracles.worlds(system, 5)
    actions = [rollout(system, policy, worlds).actions for policy in (Myopic(fused=False), Myopic("mean-trace"))]
    np.testing.assert_array_equal(*actions)
