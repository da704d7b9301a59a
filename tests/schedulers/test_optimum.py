"""The finite-horizon optimum against all schedules written out, and as the floor under every scheduler."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
from scheduler_systems import small, small_ca

from wavegym.core import shortcuts
from wavegym.core.errors import InputError
from wavegym.schedulers import Fixed, Lookahead, Myopic, Optimum, RandomChoice, best_schedule, rollout
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition


def all_schedules(system, worlds):
    """Least cost (env,) by plain matrices; SNR at the true range."""
    n = len(system.weights)
    F, Q = oracles.motion(n, system.dt, system.q)
    pulses, r0 = [(k, sweep) for k in system.durations for sweep in system.sweeps], system.reference_range
    state = system.initial(worlds)
    best = []
    for path, P in zip(state.truth.path, state.belief.covariance, strict=True):
        P, cost = P[None], np.zeros(1)
        for k in range(system.horizon):
            P = F @ P @ F.T + Q
            S = P[:, None, :2, :2] + [oracles.received_covariance(*pulse, path[k + 1, 0], r0) for pulse in pulses]
            V = P[:, None, :, :2]
            P = (P[:, None] - V @ np.linalg.solve(S, np.swapaxes(V, -1, -2))).reshape(-1, n, n)
            cost = np.repeat(cost, len(pulses)) + np.einsum("aii,i->a", P, system.weights)
        best.append(cost.min())
    return np.array(best)


def prepared(system, worlds, **kwargs):
    policy = Optimum(**kwargs)
    policy.begin(system, len(worlds.normal), None)
    policy.reveal(worlds)
    return policy


@pytest.mark.parametrize("kwargs", [{}, {"action": "box"}, {"weights": (1.0, 1.0), "q": 1.0}, {"q": 0.0}])
@pytest.mark.parametrize("horizon", [1, 3, 5])
def test_it_is_the_least_of_all_schedules(kwargs, horizon):
    system = small(horizon, **kwargs)
    worlds = oracles.worlds(system, 6, seed=horizon)
    plan = prepared(system, worlds).plan
    np.testing.assert_allclose(plan.cost, all_schedules(system, worlds), rtol=1e-9)
    assert (plan.lower_bound == plan.cost).all()


@pytest.mark.parametrize("horizon", [2, 5])
def test_it_is_the_least_of_all_schedules_with_three_states(horizon):
    system = small_ca(horizon, start_covariance="random")
    worlds = oracles.worlds(system, 4)
    plan = prepared(system, worlds).plan
    np.testing.assert_allclose(plan.cost, all_schedules(system, worlds), rtol=1e-9)


def test_the_plan_is_what_is_played():
    for system in (KershawEvansPosition(), KershawEvansPosition(action="box")):
        worlds = oracles.worlds(system, 4)
        policy = Optimum()
        result = rollout(system, policy, worlds)
        np.testing.assert_allclose(result.cost.sum(axis=1), policy.plan.cost, rtol=1e-8)
        assert (result.actions == system.candidates()[policy.plan.actions]).all()
        over = system.initial(worlds).belief._replace(step=np.full(4, system.horizon))
        assert len(policy.act(over, None, None)) == 4


@pytest.mark.parametrize("kwargs", [{"tolerance": 0.05}, {"nodes": 20}, {"nodes": 1}, {"tolerance": 0.3, "nodes": 3}])
@pytest.mark.slow
def test_the_bound_is_certified(kwargs):
    for system in (small(5), small_ca(5, start_covariance="random")):
        worlds = oracles.worlds(system, 6)
        truth, plan = all_schedules(system, worlds), prepared(system, worlds, **kwargs, gap=np.inf).plan
        assert (plan.lower_bound <= truth * (1 + 1e-9)).all()
        assert (truth <= plan.cost * (1 + 1e-9)).all()
        if "nodes" not in kwargs:
            assert (plan.cost <= (1 + 1.1 * kwargs["tolerance"]) * plan.lower_bound).all()


def test_a_plan_that_is_not_certified_is_not_called_the_optimum():
    system = small_ca(5, start_covariance="random")
    with pytest.raises(InputError, match=r"of 6 plans are certified to .* only"):
        prepared(system, oracles.worlds(system, 6), nodes=1)


@pytest.mark.slow
def test_a_tolerance_bounds_the_loss_over_whole_episodes():
    system = KershawEvansPosition()
    worlds = oracles.worlds(system, 5)
    exact = prepared(system, worlds).plan
    assert (exact.lower_bound == exact.cost).all()
    for tolerance in (1e-3, 1e-2):
        plan = prepared(system, worlds, tolerance=tolerance, gap=np.inf).plan
        assert (plan.lower_bound <= exact.cost).all()
        assert (exact.cost <= plan.cost * (1 + 1e-12)).all()
        assert (plan.cost <= plan.lower_bound * (1 + 1.1 * tolerance)).all()


@pytest.mark.slow
@pytest.mark.parametrize("system", [KershawEvansPosition(), KershawEvans()])
def test_nothing_beats_it(system):
    worlds = oracles.worlds(system, 40)
    floor = prepared(system, worlds).plan.cost
    policies = {"myopic": Myopic(), "two": Lookahead(2), "random": RandomChoice(), "fixed": Fixed(20)}
    costs = {name: rollout(system, policy, worlds).cost.sum(axis=1) for name, policy in policies.items()}
    for cost in costs.values():
        assert (floor <= cost * (1 + 1e-8)).all()
    assert floor.mean() <= costs["two"].mean() * (1 + 1e-8)  # as above: a tie but for rounding
    assert costs["two"].mean() <= costs["myopic"].mean() * 1.001 < costs["random"].mean()


@pytest.mark.slow
def test_three_steps_ahead_come_close_where_looking_ahead_pays():
    """Figures of an independent prototype: random starts at 15 to 25 km, whole pulses, about 15 % below myopic."""
    system = KershawEvansPosition(start_range=(15e3, 25e3), reference_range=50e3, eclipsing=False)
    worlds = oracles.worlds(system, 60)
    myopic, two, three, best = (
        rollout(system, policy, worlds).cost.sum(axis=1) for policy in (Myopic(), Lookahead(2), Lookahead(3), Optimum())
    )
    gains = [np.exp(np.log(cost / myopic).mean()) - 1 for cost in (two, three, best)]
    assert (best <= three * (1 + 1e-8)).all()
    np.testing.assert_allclose(gains, [-0.143, -0.153, -0.156], atol=0.01)


def test_the_reference_case():
    """From 20 km at 200 m/s outbound, P0 = diag(1e4, 1e4), everything known: figures of an independent prototype."""

    class Known(KershawEvansPosition):
        def initial(self, world):
            state = super().initial(world)
            mean = state.truth.targets.copy()
            return state._replace(belief=state.belief._replace(mean=mean, covariance=np.diag([1e4, 1e4])[None]))

    system = Known(
        targets="scripted", tracker="kalman", script=(), start_range=(20e3, 20e3), start_speed=(200.0, 200.0),
        reference_range=50e3, eclipsing=False,
    )  # fmt: skip
    worlds = oracles.worlds(system, 1)
    worlds = worlds._replace(normal=np.zeros_like(worlds.normal))
    policies = {"myopic": Myopic(), "two": Lookahead(2), "three": Lookahead(3), "best": Optimum()}
    cost = {name: rollout(system, policy, worlds).cost.sum() for name, policy in policies.items()}
    gains = [100 * (1 - cost[name] / cost["myopic"]) for name in ("two", "three", "best")]
    np.testing.assert_allclose(gains, [15.3, 16.5, 16.8], atol=0.05)


def test_environments_are_planned_independently():
    system = small(6)
    worlds = oracles.worlds(system, 5)
    recursion = shortcuts.deterministic_recursion(system, worlds)
    together = best_schedule(recursion)
    for e in range(5):
        own = slice(e, e + 1)
        alone = best_schedule(recursion._replace(covariance=recursion.covariance[own], R=recursion.R[own]))
        for whole, one in zip(together, alone, strict=True):
            assert (whole[own] == one).all()


def test_what_cannot_be_had_is_refused():
    system = small(2)
    policy = prepared(system, oracles.worlds(system, 1))
    with pytest.raises(InputError, match="given a mask"):
        policy.act(system.initial(oracles.worlds(system, 1)).belief, None, np.ones((1, 9), bool))
    recursion = shortcuts.deterministic_recursion(system, oracles.worlds(system, 1))
    for kwargs, words in (({"tolerance": -1.0}, "tolerance is -1"), ({"nodes": 0}, "nodes is 0")):
        with pytest.raises(InputError, match=words):
            best_schedule(recursion, **kwargs)
