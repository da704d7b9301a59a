"""Playing a policy without an environment."""

from __future__ import annotations

import numpy as np
import oracles
from scheduler_systems import Ladder, Start, small

from wavegym.core.system import System
from wavegym.schedulers import Fixed, Myopic, RandomChoice, rollout
from wavegym.schedulers.rollout import allowed


def test_costs_and_actions_are_those_of_the_loop():
    system = small(horizon=7)
    worlds = oracles.worlds(system, 5)
    result = rollout(system, RandomChoice(), worlds, np.random.default_rng(3))
    assert result.cost.shape == result.actions.shape == (5, 7)
    assert (result.steps == 7).all()
    state = system.initial(worlds)
    for k in range(7):
        state = system.transition(state, result.actions[:, k], worlds)
        assert (result.cost[:, k] == system.cost(state.belief)).all()
    np.testing.assert_allclose(result.mean_cost, result.cost.mean(axis=1), rtol=1e-14)
    again = rollout(system, RandomChoice(), worlds, np.random.default_rng(3))
    assert (again.actions == result.actions).all()


def test_box_actions_keep_their_axis():
    system = small(horizon=3, action="box")
    assert rollout(system, Fixed(1), oracles.worlds(system, 2)).actions.shape == (2, 3, 2)


class FreeLadder(Ladder):
    """Without masks."""

    mask = System.mask


def test_an_early_end_costs_nothing_more():
    system = FreeLadder()
    worlds = Start(np.array([1.0, 30.0]))
    result = rollout(system, Fixed(1), worlds)
    # level -> 1.5 level + 1 until it exceeds 40
    assert result.steps.tolist() == [6, 1]
    np.testing.assert_allclose(result.cost[0], [2.5, 4.75, 8.125, 13.1875, 20.78125, 32.171875])
    assert result.cost[1].tolist() == [46.0, 0, 0, 0, 0, 0]
    np.testing.assert_allclose(result.mean_cost, [81.515625 / 6, 46.0])


def test_masks_reach_the_policy_only_where_a_system_has_them():
    ladder, free = Ladder(), small(horizon=2)
    belief = ladder.initial(oracles.worlds(ladder, 3)).belief
    assert (allowed(ladder, belief) == ladder.mask(belief)).all()
    assert allowed(free, free.initial(oracles.worlds(free, 3)).belief) is None


def test_a_clairvoyant_policy_is_shown_the_worlds():
    class Prophet(Myopic):
        def reveal(self, world):
            self.seen = world

    system = small(horizon=2)
    worlds, policy = oracles.worlds(system, 3), Prophet()
    rollout(system, policy, worlds)
    assert policy.seen is worlds
