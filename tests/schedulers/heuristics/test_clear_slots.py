from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from delay_systems import DelaySystem, delay_worlds

from wavegym.core import shortcuts
from wavegym.core.errors import InputError
from wavegym.schedulers import rollout
from wavegym.schedulers.heuristics.price_policies import (
    ClearSlotPrice,
    LagrangianPrice,
    clear_slots_left,
    gain_until_clear,
    hidden_steps,
)
from wavegym.systems.energy_budget.known import EnergyBudgetKnown
from wavegym.systems.energy_budget.system import EnergyBudget


class Windows(NamedTuple):
    step: Any
    visible: Any


CLEAR = np.array([[1, 1, 0, 0, 0, 1, 0, 1], [1, 1, 1, 1, 1, 1, 0, 0]], bool)


@pytest.mark.parametrize(("step", "hidden", "left"), [(0, [0, 0], [4, 6]), (1, [3, 0], [3, 5]), (5, [1, 32], [2, 1])])
def test_hidden_steps_and_clear_slots_are_counted(step, hidden, left):
    belief = Windows(np.full(2, step), CLEAR)
    assert hidden_steps(belief).tolist() == hidden
    assert clear_slots_left(belief, 8).tolist() == left
    by_target = Windows(np.full(2, step), np.stack([CLEAR, np.zeros_like(CLEAR)], axis=2))
    assert hidden_steps(by_target)[:, 0].tolist() == hidden
    assert clear_slots_left(by_target, 8).tolist() == left


def known(**settings):
    system = EnergyBudgetKnown(horizon=24, **settings)
    worlds = delay_worlds(system, 6)
    return system, worlds, system.initial(worlds).belief


def test_the_gain_of_each_environment_counts_its_own_steps():
    system, _, belief = known(budget=0.2)
    ahead = np.array([1, 3, 3, 9, 2, 20])
    gains = gain_until_clear(system, belief, ahead)
    for row, steps in enumerate(ahead):
        np.testing.assert_array_equal(gains[row], shortcuts.gain(system, belief, 0, int(steps))[row])


def test_without_occlusions_and_powers_it_is_the_lagrangian_price():
    system, worlds, _ = known(budget=0.2, hidden=(0, 0))
    price = {"price": 200.0, "ahead": 8}
    played = rollout(system, ClearSlotPrice(**price, power=0.0), worlds).actions
    np.testing.assert_array_equal(played, rollout(system, LagrangianPrice(**price), worlds).actions)


def test_fewer_clear_slots_left_make_energy_cheaper():
    system, _, belief = known(budget=0.2)
    rule = ClearSlotPrice(power=1.0, cushion=0.0)
    rule.begin(system, 6, np.random.default_rng(0))
    few = belief._replace(visible=belief.visible & (np.arange(24) < 3))
    more, less = belief.visible.sum(axis=1), few.visible.sum(axis=1)
    np.testing.assert_allclose(rule._prices(belief) * less, rule._prices(few) * more)


def test_a_look_before_a_long_occlusion_is_worth_more():
    system = DelaySystem(setup=0, budget=99.0)
    belief = system.initial(delay_worlds(system, 4)).belief
    shown = belief._replace(visible=np.ones_like(belief.visible))
    hiding = shown.visible.copy()
    hiding[:, 1:9] = False
    rule = ClearSlotPrice(price=20.0, power=0.0, ahead=1.0)
    rule.begin(system, 4, np.random.default_rng(0))
    silence = 4
    assert (rule.act(shown, None, None) == silence).all()
    assert (rule.act(shown._replace(visible=hiding), None, None) != silence).all()


def test_unknown_occlusions_are_refused():
    system = EnergyBudget(horizon=6)
    rule = ClearSlotPrice()
    rule.begin(system, 2, np.random.default_rng(0))
    with pytest.raises(InputError, match=r"clear-slot-price.* its belief does not know when slots are clear"):
        rule.act(system.initial(delay_worlds(system, 2)).belief, None, None)
