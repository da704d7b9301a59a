"""Cycles in which each set-up is held for a while."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.capabilities import Delay, offers
from wavegym.core.system import System
from wavegym.schedulers.cycle import best_cycle
from wavegym.schedulers.heuristics.tuning import log_cost
from wavegym.schedulers.simple import Cycle

DWELLS = tuple(range(1, 17))  # steps
LONGEST = 64  # steps within which a set-up is taken to be complete
HELD_ON = 16  # worlds on which set-ups are told apart


def best_dwell(system: System, worlds: Any) -> Array:
    """The best cycle found: ``best_cycle``'s, or every set-up in turn, each held for some steps.

    A cycle of set-ups has one slot for each set-up (``setups``), the same of its waveforms in all, held for 1 to 16
    steps, the time of changing included. The cost compared is the geometric mean over worlds.

    Args:
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world.

    Returns:
        The actions, (slots,), (slots, sensor) or (slots, d).
    """
    cycles = [best_cycle(system, worlds)]
    if cycles[0].ndim == 1:
        groups = setups(system, worlds)
        for waveform in range(min(map(len, groups))):
            slots = np.array([group[waveform] for group in groups])
            cycles += [np.repeat(slots, dwell) for dwell in DWELLS]
    return cycles[int(np.argmin([log_cost(system, Cycle(actions), worlds) for actions in cycles]))]


def setups(system: Any, worlds: Any) -> list[Array]:
    """The candidates (k,) that need no change of set-up between them, for each set-up.

    Each candidate is held until its delay is over; those with no delay then, in most worlds, are of its set-up.
    Without delays every candidate is a set-up of its own.
    """
    candidates = system.candidates()
    count = len(candidates)
    if not offers(system, Delay):
        return list(candidates[:, None])
    belief = system.initial(trees.first(worlds, HELD_ON)).belief
    held = np.tile(np.arange(count), len(belief.step))
    belief = trees.repeated(belief, count)
    for _ in range(min(LONGEST, system.horizon)):
        if not system.delay(belief)[np.arange(len(held)), held].any():
            break
        belief = system.predict(belief, candidates[held])
    is_ready = (system.delay(belief) == 0).reshape(-1, count, count).mean(axis=0) > 0.5
    groups = {ready.tobytes(): candidates[ready] for ready in is_ready}
    return [group for group in groups.values() if len(group)]
