from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wavegym.core import shortcuts, trees
from wavegym.core.action_sets import Parameter, ParameterBox
from wavegym.core.system import State, System
from wavegym.schedulers import Cycle, rollout
from wavegym.schedulers.tuning import POLISHING, TOLERANCE, best_constant, best_fixed, polished, tuning_costs
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition


def worlds(system, count):
    return trees.stack([system.draw_world(np.random.default_rng(i)) for i in range(count)])


@pytest.mark.parametrize(
    ("env_id", "system"),
    [
        ("wavegym/KershawEvans-v0", KershawEvans(horizon=6)),
        ("wavegym/KershawEvansPosition-v0", KershawEvansPosition(horizon=6)),
    ],
)
def test_it_is_the_cheapest_of_all_played_in_the_environment(env_id, system):
    envs = gym.make_vec(env_id, num_envs=8, horizon=6)
    totals = []
    for candidate in range(len(system.candidates())):
        envs.reset(seed=list(range(100, 108)))
        totals.append(sum(envs.step(np.full(8, candidate))[4]["cost"].sum() for _ in range(6)))
        tape = envs.unwrapped.world
    assert best_fixed(system, tape) == int(np.argmin(totals))


class Belief(NamedTuple):
    step: Any  # (env,)
    last: Any  # (env,) candidate chosen last


class Leaving(System):
    """Candidate 0 costs 3 and ends the episode, candidate 1 costs 2 at each of four steps."""

    horizon = 4

    def candidates(self):
        return np.arange(2)

    def initial(self, world):
        return State(None, Belief(np.zeros(len(world), np.int64), np.ones(len(world), np.int64)))

    def transition(self, state, action, world):
        return State(None, Belief(state.belief.step + 1, action))

    def cost(self, belief):
        return 3.0 - belief.last

    def terminal(self, belief):
        return (belief.step >= 4) | (belief.last == 0)


def test_ending_early_is_no_saving():
    assert best_fixed(Leaving(), np.zeros(5)) == 1


def test_a_candidate_whose_cost_is_not_a_number_is_never_best():
    @dataclass(frozen=True)
    class Broken(KershawEvans):
        def transition(self, state, action, world):
            after = super().transition(state, action, world)
            bad = np.where(action == 3, np.nan, 1.0)[:, None, None]
            return State(after.truth, after.belief._replace(covariance=after.belief.covariance * bad))

    plain = KershawEvans(horizon=4)
    assert best_fixed(Broken(horizon=4), worlds(plain, 3)) == best_fixed(plain, worlds(plain, 3)) != 3


class Shot(NamedTuple):
    step: Any  # (env,)
    action: Any  # (env, 2)


@dataclass(frozen=True)
class Bowl(System):
    """The cost is 1 and the squared distance of the action from ``best``; beyond ``cliff`` in either is no cost."""

    best: tuple[float, float]
    cliff: float = 1.0
    horizon: int = 2

    @property
    def actions(self):
        return ParameterBox(tuple(Parameter(name, "1", -1.0, 1.0, "linear") for name in "ab"))

    def candidates(self):
        return np.stack(np.meshgrid(*[np.linspace(-1, 1, 4)] * 2), axis=-1).reshape(-1, 2)

    def initial(self, world):
        return State(None, Shot(np.zeros(len(world), np.int64), np.zeros((len(world), 2))))

    def transition(self, state, action, world):
        return State(None, Shot(state.belief.step + 1, action))

    def cost(self, belief):
        cost = 1 + np.square(belief.action - self.best).sum(axis=-1)
        beyond = np.where(belief.action[:, 0] > 0, np.inf, np.nan)
        return np.where(np.abs(belief.action).max(axis=-1) > self.cliff, beyond, cost)


inside = st.floats(-0.6, 0.6)


@settings(max_examples=30)
@given(st.tuples(inside, inside), st.sampled_from([1.0, 0.7]))
@pytest.mark.slow
def test_the_best_constant_of_a_box_is_found_though_others_diverge(best, cliff):
    found = best_constant(Bowl(best, cliff), np.zeros(3))
    np.testing.assert_allclose(found, best, atol=2 * TOLERANCE)


def test_an_optimum_outside_the_box_is_met_on_its_face():
    np.testing.assert_allclose(best_constant(Bowl((0.3, -1.5)), np.zeros(1)), (0.3, -1.0), atol=2 * TOLERANCE)


def test_where_every_constant_diverges_the_first_is_kept():
    assert best_constant(Bowl((0.0, 0.0), cliff=-1.0), np.zeros(1)).tolist() == [-1.0, -1.0]


@pytest.mark.parametrize("size", [1, 6, 18])
def test_a_polish_keeps_to_its_budget_and_is_never_worse(size):
    start, seen = np.full((size,), 0.4), []

    def rugged(x):
        seen.append(float(np.exp(np.abs(x).sum()) * (2 + np.sin(40 * x).sum() / size)))
        assert (np.abs(x) <= 1).all()
        return seen[-1]

    found = polished(rugged, start)
    assert len(seen) <= POLISHING
    assert rugged(found) == min(seen) <= seen[0]


def test_a_polished_constant_is_no_worse_than_the_librarys_and_always_the_same():
    system = KershawEvansPosition(horizon=10, action="box")
    tapes = worlds(system, 8)
    found = best_constant(system, tapes)
    assert (found == best_constant(system, tapes)).all()
    library = [rollout(system, Cycle(action[None]), tapes).mean_cost.mean() for action in shortcuts.constants(system)]
    assert rollout(system, Cycle(found[None]), tapes).mean_cost.mean() <= min(library)


def test_groups_of_worlds_have_a_mean_each():
    system = KershawEvans(horizon=3)
    tapes = worlds(system, 4)
    halves = [tuning_costs(system, Cycle([5]), trees.take(tapes, rows))[0] for rows in (np.arange(2), np.arange(2, 4))]
    np.testing.assert_allclose(tuning_costs(system, Cycle([5]), tapes, groups=2), halves, rtol=1e-12)
