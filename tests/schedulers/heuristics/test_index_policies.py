from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from delay_systems import CANDIDATES, TARGET, DelaySystem, delay_worlds
from hypothesis import given, settings
from hypothesis import strategies as st

from wavegym.core import shortcuts, trees
from wavegym.core.errors import InputError
from wavegym.core.horizon_weights import horizon_weights
from wavegym.core.policy import Policy
from wavegym.schedulers import Myopic, RandomChoice, rollout
from wavegym.schedulers.cycle import best_dwell, setups
from wavegym.schedulers.heuristics.base import PolicyAsHeuristic, greatest
from wavegym.schedulers.heuristics.grids import BAND_RULES, HEURISTICS, TIMELINE
from wavegym.schedulers.heuristics.index_policies import AwareGreedy, CostOfDelay, Gain, Greedy, HoldUntilDetected
from wavegym.schedulers.heuristics.price_policies import AdaptiveLagrangianPrice, ConstantPace, LagrangianPrice
from wavegym.schedulers.simple import Cycle
from wavegym.schedulers.tuned_constants import Search, best_simple, tune_heuristic
from wavegym.schedulers.tuning import log_cost, tuned
from wavegym.systems.kershaw_evans.system import KershawEvansPosition

SYSTEM = DelaySystem()
SILENCE = CANDIDATES.index("silence")
EXAMPLES = [
    Greedy(3),
    AwareGreedy(0.5, 3),
    CostOfDelay(0.4, 2, 3),
    Gain(3),
    LagrangianPrice(5.0, 3),
    AdaptiveLagrangianPrice(3),
    ConstantPace(3),
    PolicyAsHeuristic(Cycle([0, 2])),
]


def beliefs(count=40, steps=5, system=SYSTEM, seed=0):
    """Beliefs that random actions lead to."""
    worlds = delay_worlds(system, count, seed)
    state, policy = system.initial(worlds), RandomChoice()
    policy.begin(system, count, np.random.default_rng(seed))
    for _ in range(steps):
        state = system.transition(state, policy.act(state.belief, None, system.mask(state.belief)), worlds)
    return state.belief


def begun(heuristic, system=SYSTEM):
    heuristic.begin(system, 1, np.random.default_rng(0))
    return heuristic


def summed_cost(system, belief, first, ahead):
    """Cost of ``ahead`` steps of which the first transmits ``first`` and the others nothing, expected detections."""
    total = np.zeros(len(belief.step))
    for step in range(ahead):
        belief = system.predict(belief, np.full(len(total), first if step == 0 else SILENCE))
        total += system.cost(belief)
    return total


@pytest.mark.parametrize("ahead", [1, 2, 5])
@pytest.mark.parametrize("wait", [0, 1, 3])
def test_the_gain_of_a_pulse_is_that_of_repeated_prediction(ahead, wait):
    """Set up for the target and after ``wait`` silent steps: the gain by the formula and horizon_weights."""
    system = DelaySystem(horizon=30)
    belief = beliefs(steps=4, system=system)
    for candidate, target in enumerate(TARGET[:SILENCE]):
        ready = belief._replace(pointing=np.full_like(belief.step, target), dead=np.zeros_like(belief.step))
        for _ in range(wait):
            ready = system.predict(ready, np.full(len(ready.step), SILENCE))
        expected = summed_cost(system, ready, SILENCE, ahead) - summed_cost(system, ready, candidate, ahead)
        np.testing.assert_allclose(
            shortcuts.gain(system, belief, wait, ahead)[:, candidate], expected, rtol=1e-9, atol=1e-9
        )


def test_l_step_gain_is_the_least_cost_of_the_steps_to_come():
    belief = beliefs()
    costs = np.stack([summed_cost(SYSTEM, belief, candidate, 4) for candidate in range(5)], axis=1)
    chosen = begun(Gain(4)).act(belief, None, None)
    np.testing.assert_allclose(costs[np.arange(len(chosen)), chosen], costs.min(axis=1), rtol=1e-12)


def test_the_gain_of_one_step_is_the_myopic_choice():
    worlds = delay_worlds(SYSTEM, 20)
    np.testing.assert_array_equal(rollout(SYSTEM, Gain(1), worlds).actions, rollout(SYSTEM, Myopic(), worlds).actions)


def test_horizon_weights_sum_the_costs_of_a_covariance_that_nothing_reduces():
    rng = np.random.default_rng(0)
    F, root, weights = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), np.array([1.0, 0.5, 2.0])
    P, total = root @ root.T, 0.0
    here = P
    for _ in range(4):
        total += weights @ np.diag(here)
        here = F @ here @ F.T
    assert np.trace(horizon_weights(F, weights, 4) @ P) == pytest.approx(total, rel=1e-12)


def test_aware_greedy_without_weight_on_delay_is_the_index_without_any_other_constant():
    belief = beliefs()
    plain = begun(CostOfDelay(alpha=0.0, later=1, ahead=3, power=0.0, bonus=0.0)).act(belief, None, None)
    np.testing.assert_array_equal(begun(AwareGreedy(0.0, 3)).act(belief, None, None), plain)


def test_the_index_is_its_formula():
    belief = beliefs()
    delay = shortcuts.delay(SYSTEM, belief)
    worth = shortcuts.gain(SYSTEM, belief, delay, 3) - 0.3 * shortcuts.gain(SYSTEM, belief, delay + 2, 3)
    factor = np.where(delay == 0, 1.5, 1.0) / np.power(1.0 + delay, 1.3)
    values = np.where(worth > 0, worth * factor, worth / factor)
    chosen = begun(CostOfDelay(0.3, 2, 3, 1.3, 0.5)).act(belief, None, None)
    np.testing.assert_allclose(values[np.arange(len(chosen)), chosen], values.max(axis=1), rtol=1e-12)


def test_the_bonus_is_for_the_present_set_up_alone():
    """A bonus that outweighs all else: a pulse that can be sent at once, wherever one is worth anything."""
    belief = beliefs()
    delay = shortcuts.delay(SYSTEM, belief)
    worth = shortcuts.gain(SYSTEM, belief, delay, 3) - 0.3 * shortcuts.gain(SYSTEM, belief, delay + 2, 3)
    at_once = np.where(delay == 0, worth, 0.0)
    counts = at_once.max(axis=1) > 0.0
    rows, (plain, loyal) = (
        np.arange(len(counts)),
        (begun(CostOfDelay(0.3, 2, 3, 0.0, bonus)).act(belief, None, None) for bonus in (0.0, 1e9)),
    )
    np.testing.assert_array_equal(worth[rows, loyal][counts], at_once.max(axis=1)[counts])
    assert (delay[rows, plain][counts] > 0).any()  # without it another set-up is worth more somewhere


def test_a_target_about_to_hide_comes_first():
    """Two equal targets, set up for neither in particular (no delays): the one that hides next step is looked at."""
    system = DelaySystem(setup=0)
    belief = trees.take(system.initial(delay_worlds(system, 1)).belief, np.array([0, 0]))
    visible = np.ones_like(belief.visible)
    visible[0, 1:, 0] = False
    visible[1, 1:, 1] = False
    belief = belief._replace(visible=visible, noise=np.full((2, 2), 0.3))
    chosen = begun(CostOfDelay(0.5, 1, 3, 1.0, 0.0), system).act(belief, None, None)
    np.testing.assert_array_equal(TARGET[chosen], [0, 1])


def test_delay_blind_greedy_changes_its_mind_where_aware_greedy_stays():
    """A little more to gain at the other target does not pay two dead steps."""
    belief = trees.take(SYSTEM.initial(delay_worlds(SYSTEM, 1)).belief, np.array([0]))
    covariance = belief.covariance * np.diag([1.0, 1e-3])  # hardly moving: waiting makes no gain greater
    covariance[0, 1] *= 1.5
    belief = belief._replace(covariance=covariance, noise=np.full((1, 2), 1e-3), visible=np.ones_like(belief.visible))
    assert TARGET[begun(Greedy(1)).act(belief, None, None)] == [1]
    assert TARGET[begun(AwareGreedy(1.0, 1)).act(belief, None, None)] == [0]


@given(seed=st.integers(0, 2**31), masked=st.booleans())
@settings(max_examples=50, deadline=None)
def test_the_greatest_value_and_of_equals_the_least_burden(seed, masked):
    rng = np.random.default_rng(seed)
    values, burden = rng.integers(0, 3, (8, 5)).astype(float), rng.integers(0, 3, (8, 5))
    mask = (rng.random((8, 5)) < 0.6) | (np.arange(5) == 2) if masked else None
    for row, found in enumerate(greatest(values, mask, burden)):
        open_to = [k for k in range(5) if mask is None or mask[row, k]]
        assert found == min(open_to, key=lambda k: (-values[row, k], burden[row, k], k))


@pytest.mark.parametrize("heuristic", EXAMPLES, ids=lambda heuristic: type(heuristic).__name__)
def test_a_batch_chooses_as_its_elements_do(heuristic):
    belief = beliefs(24)
    mask = SYSTEM.mask(belief)
    begun(heuristic)
    assert isinstance(heuristic, Policy)
    together, prepared = heuristic.act(belief, None, mask), heuristic.prepare(belief)
    for env in range(24):
        one = trees.take(belief, np.array([env]))
        assert heuristic.act(one, None, mask[env : env + 1])[0] == together[env]
        if prepared is not None:
            np.testing.assert_array_equal(heuristic.prepare(one)[0], prepared[env])


@pytest.mark.parametrize("heuristic", EXAMPLES, ids=lambda heuristic: type(heuristic).__name__)
def test_heuristics_keep_to_the_mask_and_choose_from_what_is_prepared(heuristic):
    belief, rng = beliefs(60), np.random.default_rng(1)
    mask = SYSTEM.mask(belief) & (rng.random((60, 5)) < 0.6) | (np.arange(5) == SILENCE)
    begun(heuristic)
    chosen = heuristic.choose(belief, mask, heuristic.prepare(belief))
    assert mask[np.arange(60), chosen].all()
    np.testing.assert_array_equal(chosen, heuristic.act(belief, None, mask))


def test_after_the_end_heuristics_still_answer():
    """As in an environment's step that only resets."""
    belief = beliefs(8, SYSTEM.horizon)
    assert SYSTEM.terminal(belief).all()
    for heuristic in EXAMPLES:
        assert begun(heuristic).act(belief, None, SYSTEM.mask(belief)).shape == (8,)


def test_setups_are_told_apart_by_their_delays():
    groups = setups(SYSTEM, delay_worlds(SYSTEM, 20))
    assert sorted(group.tolist() for group in groups) == [[0, 1, 4], [2, 3, 4]]

    class Undelayed(DelaySystem):
        pass

    shortcuts.delay.withdraw(Undelayed)
    assert [group.tolist() for group in setups(Undelayed(), delay_worlds(SYSTEM, 2))] == [[k] for k in range(5)]


def test_a_cycle_of_setups_beats_the_short_cycles_where_turning_takes_time():
    system = DelaySystem(horizon=24, setup=3, budget=99.0)
    worlds = delay_worlds(system, 30)
    cycle = best_dwell(system, worlds)
    assert len(cycle) >= 2 * (3 + 1)  # each set-up is held for longer than it takes
    for dwell in (1, 2, 3):
        short = Cycle(np.repeat([0, 2], dwell))
        assert log_cost(system, Cycle(cycle), worlds) < log_cost(system, short, worlds)


def test_coordinate_descent_finds_the_best_of_a_small_grid():
    """Along one coordinate every value is tried, so there it is the exhaustive optimum."""
    worlds, grid = delay_worlds(SYSTEM, 30), {"kappa": (0.0, 0.3, 1.0, 3.0), "ahead": (2,)}
    found, cost = tuned(AwareGreedy, grid, {"kappa": 0.0, "ahead": 2}, SYSTEM, worlds)
    costs = {kappa: np.log(rollout(SYSTEM, AwareGreedy(kappa, 2), worlds).mean_cost).mean() for kappa in grid["kappa"]}
    assert found["kappa"] == min(costs, key=lambda kappa: costs[kappa])
    assert cost == pytest.approx(costs[found["kappa"]], rel=1e-12)
    start = {"kappa": 0.3, "ahead": 2}
    assert tuned(AwareGreedy, grid, start, SYSTEM, worlds, budget=1)[0] == start  # nothing left to try others


def test_hold_until_detected_serves_first_a_target_about_to_hide():
    system = DelaySystem(setup=0, budget=99.0)
    belief = system.initial(delay_worlds(system, 40)).belief
    same = belief._replace(noise=np.ones_like(belief.noise), visible=np.ones_like(belief.visible))
    heuristic = HoldUntilDetected(4)
    heuristic.begin(system, 40, np.random.default_rng(0))
    greedy = Greedy(4)
    greedy.begin(system, 40, np.random.default_rng(0))
    np.testing.assert_array_equal(heuristic.act(same, None, None), greedy.act(same, None, None))  # nothing ever hides
    hiding = same.visible.copy()
    hiding[:, 1:6, 1] = False  # target B, which costs as much as A, from the next step on
    chosen = heuristic.act(same._replace(visible=hiding), None, None)
    assert set(chosen) == {3}  # B, with the better pulse
    longer = shortcuts.gain(system, same, 0, np.array([[4, 9]]))
    np.testing.assert_array_equal(chosen, longer.argmax(axis=1))  # until it is back, five steps later


def test_best_simple_is_the_best_of_all(monkeypatch):
    for name, heuristic in HEURISTICS.items():  # grids of two values: quick
        grid = {constant: (values[0], heuristic.start[constant]) for constant, values in heuristic.grid.items()}
        monkeypatch.setitem(HEURISTICS, name, replace(heuristic, grid=grid))
    system = DelaySystem(horizon=6)
    worlds = delay_worlds(system, 8)
    best, constants, costs, searches = best_simple(system, worlds, Search(evaluations=20))
    assert (
        set(constants) == set(costs) == set(HEURISTICS) - {*TIMELINE, *BAND_RULES, "weighted-myopic"}
    )  # looks have delays
    assert {name: found["evaluations"] for name, found in searches.items()} == {
        "clear-slot-price": 20,
        "searched-rule": 20,
    }
    assert costs[best] == min(costs.values())
    again = rollout(system, HEURISTICS[best].make(**constants[best]), worlds).mean_cost
    assert np.log(again).mean() == pytest.approx(costs[best], rel=1e-12)


@pytest.mark.parametrize(
    "name",
    ["greedy", "aware-greedy", "cost-of-delay", "lagrangian-price", "adaptive-lagrangian-price", "constant-pace"],
)
def test_heuristics_that_a_system_cannot_have_are_refused(name):
    system = KershawEvansPosition(horizon=3)
    with pytest.raises(InputError, match=f"'{name}' cannot be computed for KershawEvansPosition: it has no gain"):
        tune_heuristic(name, system, delay_worlds(system, 2))
