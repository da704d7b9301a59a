"""Cycles in which each set-up is held for several steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.shortcuts import delay
from wavegym.core.system import System
from wavegym.schedulers.cycle import best_cycle
from wavegym.schedulers.heuristics.tuning import log_cost
from wavegym.schedulers.simple import Cycle

DWELLS = tuple(range(1, 17))  # steps
LONGEST = 64  # steps after which a set-up is assumed to be complete
SETUP_WORLDS = 16  # on which set-ups are identified


def best_dwell(system: System, worlds: Any) -> Array:
    """The best cycle found: ``best_cycle``'s, or every set-up in turn, each held for some steps.

    A cycle of set-ups has one slot for each set-up (``setups``), with the same index of its waveforms in all, held for
    1 to 16 steps, the delay included. Cycles are compared by the geometric mean of the cost over worlds.

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
    """The candidates (k,) of each set-up.

    Each candidate is held until its delay is over. The candidates without delay at that time, in most worlds, belong to
    its set-up. Without delays every candidate is a set-up of its own.
    """
    candidates = system.candidates()
    count = len(candidates)
    if not delay.of(system):
        return list(candidates[:, None])
    belief = system.initial(trees.first(worlds, SETUP_WORLDS)).belief
    held = np.tile(np.arange(count), len(belief.step))
    belief = trees.repeated(belief, count)
    for _ in range(min(LONGEST, system.horizon)):
        if not delay(system, belief)[np.arange(len(held)), held].any():
            break
        belief = system.predict(belief, candidates[held])
    is_ready = (delay(system, belief) == 0).reshape(-1, count, count).mean(axis=0) > 0.5
    groups = {ready.tobytes(): candidates[ready] for ready in is_ready}
    return [group for group in groups.values() if len(group)]
