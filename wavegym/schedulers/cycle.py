"""The best periodic schedules, of a few slots or of held set-ups, found on tuning worlds, never on test worlds."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from tqdm import tqdm

from wavegym.core import shortcuts, trees
from wavegym.core.action_sets import JointLibrary, ParameterBox
from wavegym.core.arrays import Array
from wavegym.core.shortcuts import delay
from wavegym.core.system import System
from wavegym.schedulers.simple import Cycle
from wavegym.schedulers.tuning import POLISHING, best_constant, log_cost, polished, tuning_costs

Descent = Generator[list[Array], list[float], Array]  # yields cycles, is sent their costs, returns its last cycle

PERIODS = (2, 3)  # slots
COMMON = 6  # slots: a multiple of every period
DRAWN = 4  # drawn starts for each period
ROLLOUTS = 1200  # of the descents, in addition to one for each constant
WORLDS = 16  # on which the descents roll out
TOGETHER = 16  # cycles that are rolled out as one batch
DWELLS = tuple(range(1, 17))  # steps
LONGEST = 64  # steps after which a set-up is assumed to be complete
SETUP_WORLDS = 16  # on which set-ups are identified


def best_cycle(system: System, worlds: Any) -> Array:
    """The best periodic schedule found with one, two or three slots.

    Coordinate descent on the first ``WORLDS`` worlds. A coordinate is a parameter of a box, a sensor's waveform, or a
    plain index, in one slot. One coordinate at a time takes the best of its levels in ``constants``, until a sweep
    improves nothing. All constants are levels, because the slots of a good cycle may be bad constants.

    There are descents with two and with three slots. They start at the repeated best constant, at the best schedule so
    far, and at ``DRAWN`` random schedules; half of these have the best constant in all slots except one. The results
    are compared on all worlds. In a box the best one is polished (``tuning.polished``) and compared again, also with
    ``best_constant``, so that a cycle is never worse than a constant on the tuning worlds.

    Args:
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world.

    Returns:
        The actions, (slots,), (slots, sensor) or (slots, d); one slot if all are equal.
    """
    points, encode = _coordinates(system)
    budget = len(points) + ROLLOUTS
    few = trees.first(worlds, WORLDS)
    with tqdm(desc="tuning tuned-cycle", total=budget + POLISHING, disable=None, leave=False) as bar:
        search = _Search(system, few, encode, bar, budget)

        def best(cycles: list[Array]) -> Array:
            return cycles[int(np.argmin([tuning_costs(system, Cycle(encode(slots)), worlds) for slots in cycles]))]

        found = best(_ends(search, points))
        if isinstance(system.actions, ParameterBox):
            search.left = POLISHING
            constant = best_constant(system, worlds)[None]
            found = best([constant, found, polished(lambda slots: search([slots])[0], found)])
    return encode(found)


class _CycleEach(Cycle):
    """A different cycle in each environment, actions (env, slots, ...)."""

    def slot_action(self, belief: Any) -> Array:
        """See ``Cycle``."""
        return self.actions[np.arange(len(belief.step)), belief.step % self.actions.shape[1]]


@dataclass
class _Search:
    """The costs of cycles, each rolled out once, in batches; infinite when no rollout is left.

    Args:
        system, worlds: the closed loop, and the worlds to roll out on.
        encode: from coordinates (slots, k) to actions (slots, ...).
        bar: progress bar over the rollouts.
        left: rollouts that may still be made.
    """

    system: System
    worlds: Any
    encode: Callable[[Array], Array]
    bar: Any
    left: int
    seen: dict[bytes, float] = field(default_factory=dict)

    def __call__(self, cycles: list[Array]) -> list[float]:
        """The cost of each cycle (slots, k)."""
        keys = [_shortest(slots).tobytes() for slots in cycles]
        fresh = {key: slots for key, slots in zip(keys, cycles, strict=True) if key not in self.seen}
        chosen = list(fresh.items())[: self.left]
        self.left -= len(chosen)
        for at in range(0, len(chosen), TOGETHER):
            part = dict(chosen[at : at + TOGETHER])
            self.seen.update(zip(part, self._costs(list(part.values())), strict=True))
            self.bar.update(len(part))
        return [self.seen.get(key, np.inf) for key in keys]

    def _costs(self, cycles: list[Array]) -> list[float]:
        count = len(self.system.initial(self.worlds).belief.step)
        worlds = trees.take(self.worlds, np.tile(np.arange(count), len(cycles)))
        actions = np.stack([self.encode(np.resize(slots, (COMMON, slots.shape[1]))) for slots in cycles])
        policy = _CycleEach(np.repeat(actions, count, axis=0))
        costs: list[float] = tuning_costs(self.system, policy, worlds, len(cycles)).tolist()
        return costs


def _ends(search: _Search, points: Array) -> list[Array]:
    """The distinct results of all descents, fewest slots first; ``points`` (C, k) are the constants."""
    levels = [np.unique(column) for column in points.T]
    constant = points[[int(np.argmin(search(list(points[:, None]))))]]
    rng, ends = np.random.default_rng(0), []
    starts = [np.repeat(constant, period, axis=0) for period in (1, *PERIODS)]
    ends += _run(search, [_descent(start, levels) for start in starts])
    best = ends[int(np.argmin(search(ends)))]
    starts = [np.resize(best, (period, points.shape[1])) for period in PERIODS]
    for k in range(DRAWN):
        for period in PERIODS:
            start = points[rng.integers(len(points), size=period)]
            start[1:] = constant if k % 2 == 0 else start[1:]
            starts.append(start)
    ends += _run(search, [_descent(start, levels) for start in starts])
    return sorted({end.tobytes(): end for end in map(_shortest, ends)}.values(), key=len)


def _run(search: _Search, descents: Iterable[Descent]) -> list[Array]:
    """The results of ``descents``: they advance in parallel, so that their trials fill the batches."""
    ends, waiting = [], [(descent, next(descent)) for descent in descents]
    while waiting:
        costs = iter(search([slots for _, trials in waiting for slots in trials]))
        moving, waiting = waiting, []
        for descent, trials in moving:
            try:
                waiting.append((descent, descent.send([next(costs) for _ in trials])))
            except StopIteration as end:
                ends.append(end.value)
    return ends


def _descent(slots: Array, levels: list[Array]) -> Descent:
    """Coordinate descent from ``slots`` (slots, k) over ``levels``, one array for each of the k coordinates."""
    least, improving = (yield [slots])[0], True
    while improving:
        improving = False
        for n, c in np.ndindex(*slots.shape):
            trials = np.repeat(slots[None], len(levels[c]), axis=0)
            trials[:, n, c] = levels[c]
            costs = yield list(trials)
            if min(costs) < least:
                slots, least, improving = trials[int(np.argmin(costs))], min(costs), True
    return slots


def _coordinates(system: System) -> tuple[Array, Callable[[Array], Array]]:
    """The constants as points (C, k) whose coordinates change one at a time, and the way back to actions."""
    constants, actions = shortcuts.constants(system), system.actions
    if isinstance(actions, JointLibrary):
        shape = (len(actions.library),) * actions.sensors
        return actions.indices[constants], lambda points: np.ravel_multi_index(tuple(points.T), shape)
    if constants.ndim == 1:
        return constants[:, None], lambda points: points[:, 0]
    return constants, lambda points: points


def _shortest(slots: Array) -> Array:
    """One slot where all are equal."""
    return slots[:1] if (slots == slots[0]).all() else slots


def best_dwell(system: System, worlds: Any) -> Array:
    """The best cycle found: ``best_cycle``'s, or every set-up in turn, each held for some steps.

    A cycle of set-ups has one slot for each set-up (``setups``) and uses the same index among the waveforms of each. A
    set-up is held for 1 to 16 steps, including the delay. Cycles are compared by the geometric mean of the cost over
    worlds.

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
