"""The best cycle of a few slots, against all cycles tried by hand on systems in plain Python."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scheduler_systems import Ladder, Level, small

from wavegym.core import shortcuts, trees
from wavegym.core.action_sets import JointLibrary, Library, Parameter, ParameterBox, PerSensorLibrary
from wavegym.core.system import State, System
from wavegym.schedulers import Cycle, Fixed, rollout
from wavegym.schedulers import cycle as searching
from wavegym.schedulers.cycle import best_cycle
from wavegym.schedulers.tuning import TOLERANCE, best_constant, best_fixed

HORIZON, CAP, BEST = 12, 3, 0.8


class Names(NamedTuple):
    labels: tuple[str, ...]

    def __len__(self):
        return len(self.labels)


class Debts(NamedTuple):
    step: np.ndarray  # (env,)
    debt: np.ndarray  # (env, sensor, quantity)
    extra: np.ndarray  # (env,)


@dataclass(frozen=True)
class Neglect(System):
    """Each sensor measures one of its quantities, which makes its debt 0 and raises the others' by 1, or none.

    Measuring none raises all debts up to CAP, the best that a constant can do. In a box (one sensor, two quantities)
    an action below -0.5 looks at the first, above 0.5 at the second, and what it misses of +-BEST is paid squared.
    """

    form: str = "index"
    quantities: int = 2
    sensors: int = 1
    horizon: int = HORIZON
    dt: float = 1.0

    @property
    def actions(self):
        names = Names(("none", *(f"look {i}" for i in range(self.quantities))))
        if self.form == "box":
            return ParameterBox((Parameter("where", "1", -1.0, 1.0, "linear"),))
        forms = {
            "index": names,
            "sensors": PerSensorLibrary(names, self.sensors),
            "joint": JointLibrary(names, self.sensors),
        }
        return forms[self.form]

    def candidates(self):
        return np.array([[-1.0], [0.0], [1.0]]) if self.form == "box" else super().candidates()

    def initial(self, world):
        return State(
            None, Debts(np.zeros(len(world), int), np.zeros((len(world), self.sensors, self.quantities)), world)
        )

    def transition(self, state, action, world):
        step, debt, extra = state.belief
        if self.form == "box":
            extra = (np.abs(action[:, 0]) - BEST) ** 2
            action = np.where(action < -0.5, 1, np.where(action > 0.5, 2, 0))
        if self.form == "joint":
            action = self.actions.indices[action]
        action = action.reshape(len(step), self.sensors, 1)
        debt = np.where(action == 0, np.minimum(debt + 1, CAP), debt + 1)
        return State(None, Debts(step + 1, np.where(action == 1 + np.arange(self.quantities), 0, debt), extra))

    def cost(self, belief):
        return belief.debt.sum(axis=(1, 2)) + belief.extra


def by_hand(cycle, quantities):
    """Mean cost of one sensor's cycle, (slots,) ints, 0 = none."""
    debt, total = [0] * quantities, 0
    for t in range(HORIZON):
        look = cycle[t % len(cycle)]
        debt = [min(d + 1, CAP) if look == 0 else 0 if look == 1 + i else d + 1 for i, d in enumerate(debt)]
        total += sum(debt)
    return total / HORIZON


def least_by_hand(quantities):
    cycles = [c for period in (1, 2, 3) for c in product(range(quantities + 1), repeat=period)]
    return min(by_hand(cycle, quantities) for cycle in cycles)


def cost_of(system, actions, worlds):
    return rollout(system, Cycle(actions), worlds).mean_cost.mean()


WORLDS = np.zeros(20)


@pytest.mark.parametrize("quantities", [2, 3])
def test_a_cycle_of_bad_constants_is_found(quantities):
    system = Neglect(quantities=quantities)
    constants = [by_hand((k,), quantities) for k in range(quantities + 1)]
    assert best_fixed(system, WORLDS) == int(np.argmin(constants)) == 0
    found = best_cycle(system, WORLDS)
    assert sorted(found.tolist()) == list(range(1, quantities + 1))  # each looked at in turn, none of them 0
    full = (1, (2 + 3 * (HORIZON - 1)) / HORIZON)[quantities - 2]  # debts 0 and 1; 0, 1 and 2 from the second step on
    assert least_by_hand(quantities) == full
    assert cost_of(system, found, WORLDS) == pytest.approx(full, rel=1e-12)


@pytest.mark.parametrize("form", ["sensors", "joint"])
def test_several_sensors_change_one_at_a_time(form):
    system = Neglect(form, quantities=3, sensors=2)
    found = best_cycle(system, WORLDS)
    assert found.shape == ((3, 2) if form == "sensors" else (3,))
    assert cost_of(system, found, WORLDS) == pytest.approx(2 * least_by_hand(3), rel=1e-12)


def test_in_a_box_the_slots_are_polished():
    found = best_cycle(Neglect("box"), WORLDS)
    np.testing.assert_allclose(np.sort(found[:, 0]), [-BEST, BEST], atol=2 * TOLERANCE)
    assert cost_of(Neglect("box"), found, WORLDS) == pytest.approx(1.0, abs=(2 * TOLERANCE) ** 2)


def test_where_a_constant_is_best_one_slot_is_kept():
    @dataclass(frozen=True)
    class Same(Neglect):
        def cost(self, belief):
            return np.maximum(super().cost(belief), 100.0)

    assert best_cycle(Same(), WORLDS).tolist() == [0]


@pytest.mark.slow
def test_it_is_never_worse_than_the_best_constant_of_a_real_system():
    for action in ("library", "box"):
        system = small(20, action=action)
        worlds = trees.stack([system.draw_world(np.random.default_rng(i)) for i in range(24)])
        constant = shortcuts.constants(system)[best_fixed(system, worlds)]
        found = best_cycle(system, worlds)
        cost, least = cost_of(system, found, worlds), cost_of(system, constant[None], worlds)
        assert cost <= least
        pairs = min(
            cost_of(system, np.stack([a, b]), worlds) for a, b in product(shortcuts.constants(system), repeat=2)
        )
        assert cost <= pairs * (1 + 1e-9) < least  # nine waveforms: the best response to a slot is tried exhaustively
        assert (best_cycle(system, worlds) == found).all()


def test_constants_that_diverge_are_kept_out():
    @dataclass(frozen=True)
    class Broken(Neglect):
        def transition(self, state, action, world):
            after = super().transition(state, action, world).belief
            bad = np.where(action == 3, np.nan, np.where(action == 0, np.inf, 0.0))
            return State(None, after._replace(extra=after.extra + bad))

    found = best_cycle(Broken(quantities=3), WORLDS)
    assert not {0, 3} & set(found.tolist())
    allowed = [c for period in (1, 2, 3) for c in product((1, 2), repeat=period)]
    assert cost_of(Broken(quantities=3), found, WORLDS) == pytest.approx(
        min(by_hand(cycle, 3) for cycle in allowed), rel=1e-12
    )


def test_the_search_stops_when_its_rollouts_are_spent(monkeypatch):
    monkeypatch.setattr(searching, "ROLLOUTS", 0)
    assert best_cycle(Neglect(), WORLDS).tolist() == [0]  # nothing but the constants was tried


@given(
    st.lists(st.integers(0, 2), min_size=1, max_size=4),
    st.integers(0, 9),
    st.lists(st.booleans(), min_size=3, max_size=3).filter(any),
)
def test_a_slot_that_is_not_allowed_gives_way_to_the_next_constant(slots, step, mask):
    policy, system = Cycle(slots), Ladder()
    policy.begin(system, 1, np.random.default_rng(0))
    wanted = slots[step % len(slots)]
    expected = next(k % 3 for k in range(wanted, wanted + 3) if mask[k % 3])
    belief = Level(np.array([step]), np.zeros(1))
    assert policy.act(belief, None, np.array([mask])).tolist() == [expected]
    assert policy.act(belief, None, None).tolist() == [wanted]


def test_a_slot_that_is_no_constant_gives_way_to_the_first():
    class Few(Ladder):
        pass

    @shortcuts.constants.register(Few)
    def constants(system):
        return np.array([2, 0])

    policy = Cycle([1])
    policy.begin(Few(), 3, np.random.default_rng(0))
    mask = np.array([[True, True, True], [True, False, True], [True, False, False]])
    assert policy.act(Level(np.zeros(3, int), np.zeros(3)), None, mask).tolist() == [1, 2, 0]


def test_with_masks_the_search_is_no_worse_than_a_constant_and_transmits_what_is_allowed():
    system = Ladder()
    worlds = trees.stack([system.draw_world(np.random.default_rng(i)) for i in range(30)])
    found = best_cycle(system, worlds)
    cycles = [
        list(c) for period in (1, 2, 3) for c in product(range(len(Library(("a", "b", "c")).labels)), repeat=period)
    ]
    assert cost_of(system, found, worlds) <= rollout(system, Fixed(best_fixed(system, worlds)), worlds).mean_cost.mean()
    few = trees.tree_map(lambda leaf: leaf[: searching.WORLDS], worlds)
    tuned = best_cycle(system, few)
    assert cost_of(system, tuned, few) == pytest.approx(min(cost_of(system, cycle, few) for cycle in cycles), rel=1e-12)
    state = system.initial(worlds)
    policy = Cycle(found)
    policy.begin(system, 30, np.random.default_rng(0))
    for _ in range(system.horizon):
        mask = system.mask(state.belief)
        action = policy.act(state.belief, None, mask)
        assert mask[np.arange(30), action].all()
        state = system.transition(state, action, worlds)


def test_of_a_finite_set_the_tuned_constant_is_the_best_fixed_one():
    assert best_constant(Neglect(quantities=3), WORLDS) == 0
    assert best_constant(Neglect("sensors", sensors=2), WORLDS).tolist() == [0, 0]
