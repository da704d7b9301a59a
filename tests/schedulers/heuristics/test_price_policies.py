from __future__ import annotations

import itertools

import numpy as np
import pytest
from delay_systems import SPENDING, DelaySystem, delay_worlds

from wavegym.core import shortcuts, trees
from wavegym.schedulers import rollout
from wavegym.schedulers.heuristics.index_policies import AwareGreedy
from wavegym.schedulers.heuristics.price_policies import (
    CUSHION,
    LADDER,
    AdaptiveLagrangianPrice,
    ConstantPace,
    LagrangianPrice,
)

SYSTEM = DelaySystem(horizon=10, setup=0, budget=4.0)


def begun(heuristic, system=SYSTEM):
    heuristic.begin(system, 1, np.random.default_rng(0))
    return heuristic


def start(count, system=SYSTEM):
    return system.initial(delay_worlds(system, count)).belief


def followed(system, belief, heuristic):
    """The spending to the end in the expected recursion, one belief at a time, from an unlimited account."""
    total, belief = 0.0, belief._replace(energy=np.array([1e6]))
    while not system.terminal(belief).all():
        action = heuristic.choose(belief, None, None)
        total += SPENDING[action[0]]
        belief = system.predict(belief, action)
    return total


def test_a_price_trades_gain_against_spending():
    belief = start(30)
    gain = shortcuts.gain(SYSTEM, belief, shortcuts.delay(SYSTEM, belief), 3)
    for price in (0.0, 2.0, 20.0):
        chosen = begun(LagrangianPrice(price, 3)).act(belief, None, None)
        for row, k in enumerate(chosen):
            assert gain[row, k] - price * SPENDING[k] == pytest.approx(np.max(gain[row] - price * SPENDING), rel=1e-12)


@pytest.mark.parametrize("power", [0.5, 2.0])
def test_a_price_with_feedback_rises_as_less_is_left_for_each_step(power):
    """At one unit a step it is the price itself; with a fraction of the account it is higher."""
    belief = start(40)
    left = SYSTEM.horizon - belief.step
    for energy in (left * 1.0, (left + 1.0) / 4.0 - 1.0, (left + 1.0) * 3.0 - 1.0):
        here = belief._replace(energy=energy)
        dearer = ((left[0] + 1.0) / (energy[0] + 1.0)) ** power
        chosen = begun(LagrangianPrice(2.0, 3, power)).act(here, None, None)
        np.testing.assert_array_equal(chosen, begun(LagrangianPrice(2.0 * dearer, 3)).act(here, None, None))


def test_without_a_price_it_is_greedy_and_at_a_high_one_silent():
    worlds = delay_worlds(SYSTEM, 20)
    belief = SYSTEM.initial(worlds).belief
    greedy, free = (
        begun(heuristic).act(belief, None, None) for heuristic in (AwareGreedy(0.0, 3), LagrangianPrice(0.0, 3))
    )
    np.testing.assert_array_equal(greedy, free)
    assert (SPENDING[rollout(SYSTEM, LagrangianPrice(1e9, 3), worlds).actions] == 0.0).all()


def test_predicted_spending_is_that_of_the_expected_recursion():
    belief = start(6)
    heuristic, prices = begun(AdaptiveLagrangianPrice(3)), np.array([0.5, 3.0, 20.0])
    spent = heuristic.spent(belief, np.tile(prices, (6, 1)))
    for env, (k, price) in itertools.product(range(6), enumerate(prices)):
        one = trees.take(belief, np.array([env]))
        assert spent[env, k] == pytest.approx(followed(SYSTEM, one, begun(LagrangianPrice(price, 3))), abs=1e-9)


def test_the_prepared_price_is_the_lowest_of_an_exhaustive_search_that_lasts():
    """Every price of the ladder is followed to the end; where spending falls steadily, the first that fits is found."""
    belief = start(5)
    heuristic = begun(AdaptiveLagrangianPrice(3))
    prepared = heuristic.prepare(belief)[:, 0]
    scale = heuristic.scale(belief)
    for env in range(5):
        one = trees.take(belief, np.array([env]))
        rungs = scale[env] * LADDER[1:]
        spent = heuristic.spent(trees.take(belief, np.full(len(rungs), env)), rungs[:, None])[:, 0]
        fits = spent <= belief.energy[env]
        at = int(np.searchsorted(rungs, prepared[env] * (1 - 1e-9)))
        assert fits[at]
        assert not fits[at - 1]
        if (np.diff(spent) <= 1e-9).all():
            assert at == int(np.argmax(fits))
        assert followed(SYSTEM, one, begun(LagrangianPrice(prepared[env], 3))) <= belief.energy[env]


@pytest.mark.parametrize("thrift", [0.5, 1.0, 1.5])
def test_the_predicted_account_is_spent_as_the_thrift_says(thrift):
    """For each unit that the expected recursion spends, 1 / thrift leaves the account."""
    belief = start(5)
    prepared = begun(AdaptiveLagrangianPrice(3, thrift)).prepare(belief)
    for env in range(5):
        one = trees.take(belief, np.array([env]))
        spent = followed(SYSTEM, one, begun(LagrangianPrice(prepared[env, 0], 3)))
        assert prepared[env, -1] == pytest.approx(belief.energy[env] - spent / thrift, abs=1e-9)


def test_in_a_simulated_future_the_price_rises_with_the_cube_of_what_is_missing():
    """At the root it is the prepared price; if the account is 1 / 1.1 of the prediction, 1.1^3 times that price."""
    belief = start(6)
    heuristic = begun(AdaptiveLagrangianPrice(3))
    prepared = heuristic.prepare(belief)
    np.testing.assert_allclose(heuristic.price(belief, prepared), prepared[:, 0], rtol=1e-12)
    short = belief._replace(energy=(belief.energy + CUSHION) / 1.1 - CUSHION)
    np.testing.assert_allclose(heuristic.price(short, prepared), 1.331 * prepared[:, 0], rtol=1e-12)


def test_more_energy_is_a_lower_price_and_thrift_a_higher_one():
    belief = start(20)
    rich = belief._replace(energy=2.0 * belief.energy)
    plain = begun(AdaptiveLagrangianPrice(3)).prepare(belief)[:, 0]
    assert (begun(AdaptiveLagrangianPrice(3)).prepare(rich)[:, 0] <= plain).all()
    assert (begun(AdaptiveLagrangianPrice(3, 0.5)).prepare(belief)[:, 0] >= plain).all()
    assert (begun(AdaptiveLagrangianPrice(3)).prepare(rich)[:, 0] < plain).any()


@pytest.mark.parametrize(
    "heuristic",
    [LagrangianPrice(5.0, 3), AdaptiveLagrangianPrice(3), ConstantPace(3, 1.5)],
    ids=lambda heuristic: type(heuristic).__name__,
)
def test_budgets_are_kept(heuristic):
    worlds = delay_worlds(SYSTEM, 30)
    assert (SPENDING[rollout(SYSTEM, heuristic, worlds).actions].sum(axis=1) <= SYSTEM.budget + 1e-6).all()


@pytest.mark.slow
def test_the_adaptive_price_uses_up_the_account_and_beats_greedy_spending():
    system = DelaySystem(horizon=20, setup=0, budget=5.0)
    worlds = delay_worlds(system, 40)
    adaptive, greedy = rollout(system, AdaptiveLagrangianPrice(6), worlds), rollout(system, AwareGreedy(0.0, 6), worlds)
    left = system.budget - SPENDING[adaptive.actions].sum(axis=1)
    assert np.median(left) < 1.0  # the dearest pulse
    gap = np.log(adaptive.mean_cost) - np.log(greedy.mean_cost)
    assert gap.mean() + 3.0 * gap.std() / np.sqrt(len(gap)) < 0.0


def test_what_is_left_is_worth_its_price():
    belief = start(4)
    heuristic = begun(AdaptiveLagrangianPrice(3))
    prepared = heuristic.prepare(belief)
    np.testing.assert_array_equal(heuristic.leftover(belief, prepared), -prepared[:, 0] * belief.energy)


def test_in_simulated_futures_the_price_follows_what_is_left():
    """With the account predicted: the price of the root. With less: a higher price; with more: a lower price."""
    belief = start(6)
    heuristic = begun(AdaptiveLagrangianPrice(3))
    prepared = heuristic.prepare(belief)
    left = belief.energy
    for k in range(SYSTEM.horizon + 1):
        np.testing.assert_array_equal(prepared[:, 1 + k] <= left, True)  # an account is never filled up
        left = prepared[:, 1 + k]
        worth = {}
        for name, energy in (("as predicted", left), ("less", 0.5 * left), ("more", left + 1.0)):
            at = belief._replace(step=np.full(6, k), energy=energy)
            worth[name] = heuristic.price(at, prepared)
        spends = left > 0
        np.testing.assert_allclose(worth["as predicted"][spends], prepared[spends, 0], rtol=1e-12)
        assert (worth["less"][spends] > worth["as predicted"][spends]).all()
        assert (worth["more"][spends] < worth["as predicted"][spends]).all()


def test_constant_pace_spends_no_more_than_its_share():
    belief = start(10)
    gain = shortcuts.gain(SYSTEM, belief, 0, 3)
    for share, allowed in [(1.0, [0, 2, 4]), (3.0, range(5)), (0.1, [4])]:  # 0.4 a step: the short pulses and silence
        chosen = begun(ConstantPace(3, share)).act(belief, None, None)
        assert set(chosen) <= set(allowed)
        best = gain[:, list(allowed)].max(axis=1)
        np.testing.assert_array_equal(gain[np.arange(10), chosen], best)


def test_constant_pace_takes_the_least_spending_where_everything_is_too_dear():
    belief = start(10)._replace(energy=np.full(10, 0.5))
    mask = SYSTEM.mask(belief) & (np.arange(5) != 4)  # no silence
    assert set(begun(ConstantPace(3, 0.1)).act(belief, None, mask)) <= {0, 2}
