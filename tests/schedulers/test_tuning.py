from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pytest

from wavegym.schedulers.tuning import best_fixed
from wavegym.systems import trees
from wavegym.systems.contract import State, System
from wavegym.systems.kershaw_evans import KershawEvans, KershawEvansPosition


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


class Public(NamedTuple):
    step: Any  # (env,)
    last: Any  # (env,) candidate chosen last


class Leaving(System):
    """Candidate 0 costs 3 and ends the episode, candidate 1 costs 2 at each of four steps."""

    horizon = 4

    def candidates(self):
        return np.arange(2)

    def begin(self, world):
        return State(None, Public(np.zeros(len(world), np.int64), np.ones(len(world), np.int64)))

    def advance(self, state, action, world):
        return State(None, Public(state.public.step + 1, action))

    def cost(self, public):
        return 3.0 - public.last

    def ended(self, public):
        return (public.step >= 4) | (public.last == 0)


def test_ending_early_is_no_saving():
    assert best_fixed(Leaving(), np.zeros(5)) == 1


def test_a_candidate_whose_cost_is_not_a_number_is_never_best():
    @dataclass(frozen=True)
    class Broken(KershawEvans):
        def advance(self, state, action, world):
            after = super().advance(state, action, world)
            bad = np.where(action == 3, np.nan, 1.0)[:, None, None]
            return State(after.hidden, after.public._replace(covariance=after.public.covariance * bad))

    plain = KershawEvans(horizon=4)
    assert best_fixed(Broken(horizon=4), worlds(plain, 3)) == best_fixed(plain, worlds(plain, 3)) != 3
