"""What all systems have in common."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from wavegym.core.worlds import draw_worlds
from wavegym.evaluation.play import make_task
from wavegym.registration import SYSTEMS


@pytest.mark.parametrize("env_id", SYSTEMS)
def test_a_pickle_does_not_depend_on_earlier_use(env_id: str) -> None:
    """Stored work is found again by the hash of its arguments; and a used Urban would be a pickle of 11 MB."""
    fresh, used = (make_task(env_id, {}).system for _ in range(2))
    costs = []
    for system in (used, pickle.loads(pickle.dumps(used))):
        world = draw_worlds(system, [5, 6])
        state = system.initial(world)
        actions = np.repeat(system.candidates()[:1], 2, axis=0)
        costs.append(system.cost(system.transition(state, actions, world).belief))
    np.testing.assert_array_equal(*costs)
    assert pickle.dumps(used) == pickle.dumps(fresh)
    assert len(pickle.dumps(used)) < 10_000
