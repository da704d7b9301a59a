"""Beliefs of RF/EO loops with up to three platforms and targets, near and far."""

from __future__ import annotations

import numpy as np
import oracles

from wavegym.core import trees
from wavegym.schedulers import Myopic
from wavegym.systems.rf_eo.system import RfEo, RfEoFar

NEAR = (
    ((-1e3, -1e3), (1e3, -1e3), (0.0, 3e3)),
    ((-1e3, 0.0, 1e3, 0.0), (1e3, 0.0, 1e3, 0.0), (300.0, 20.0, -400.0, -10.0)),
)
FAR = (
    ((-1e4, -1e4), (1e4, -1e4), (0.0, 5e3)),
    ((-5e3, 0.0, 20e3, 230.0), (0.0, 0.0, 30e3, -210.0), (4e3, 100.0, 9e3, -50.0)),
)
FOLDED = {"far": True, "folding": True, "prf": (2e3, 100e3)}


def scene(far=False, platforms=2, targets=2, **kwargs):
    """A system of so many platforms and targets, far ones with echoes that vanish beyond the unambiguous interval."""
    places, starts = FAR if far else NEAR
    given = {"horizon": 12, "first_estimate": "drawn", "margin": 0.0, **kwargs}
    if far:
        given = {"folding": False, "prf": (1e3, 100e3), **given}
    return (RfEoFar if far else RfEo)(platforms=places[:platforms], starts=starts[:targets], **given)


def beliefs(system, worlds=4, steps=11):
    """Beliefs met under the one-step scheduler, from the first to after ``steps``, as one batch."""
    tapes = oracles.worlds(system, worlds)
    state = system.initial(tapes)
    policy = Myopic()
    policy.begin(system, worlds, np.random.default_rng(0))
    met = [state.belief]
    for _ in range(steps):
        state = system.transition(state, policy.act(state.belief, None, None), tapes)
        met.append(state.belief)
    return trees.tree_map(lambda *arrays: np.concatenate(arrays), *met)
