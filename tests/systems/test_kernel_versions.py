"""Kernels are compiled once for the arguments that planners pass to a system, for any layout of their arrays."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

from wavegym.core import trees
from wavegym.core.worlds import draw_worlds
from wavegym.evaluation.play import make_task
from wavegym.registration import SYSTEMS

WORLDS, FEW = 2, 3


def versions() -> dict[str, set[Any]]:
    """The types of arguments for which each kernel is compiled."""
    return {
        f"{module}.{name}": set(value.signatures)
        for module, loaded in list(sys.modules.items())
        if module.startswith("wavegym.") and module.endswith("kernels")
        for name, value in vars(loaded).items()
        if isinstance(value, Dispatcher) and value.py_func.__module__ == module
    }


def two_steps(system: Any, belief: Any, actions: np.ndarray) -> None:
    """Predict the cost of some candidates, each followed by the first of them."""
    ahead = system.predict(belief, actions)
    system.cost(ahead)
    flat = trees.tree_map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), ahead)
    system.observe(flat)
    system.cost(system.predict(flat, np.repeat(actions[:1, :1], len(flat.step), axis=0)))


@pytest.mark.parametrize("env_id", SYSTEMS)
def test_arrays_that_cannot_be_written_compile_no_other_version(env_id: str) -> None:
    system: Any = make_task(env_id, {}).system
    belief = system.initial(draw_worlds(system, list(range(WORLDS)))).belief
    actions = np.repeat(system.candidates()[None, :FEW], WORLDS, axis=0)
    two_steps(system, belief, actions)
    before = versions()
    two_steps(system, belief, np.broadcast_to(actions, actions.shape))
    two_steps(system, belief, np.broadcast_to(actions[:1], actions.shape))
    assert {name: types - before[name] for name, types in versions().items() if types - before[name]} == {}
