"""What schedulers can do faster with one beam on a time line."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core import shortcuts, trees
from wavegym.core.arrays import Array
from wavegym.core.traits import DwellRule
from wavegym.systems.multifunction_radar import gain_kernels
from wavegym.systems.multifunction_radar import step_kernels as kernels
from wavegym.systems.multifunction_radar.state import Belief
from wavegym.systems.multifunction_radar.system import MultifunctionRadar


@shortcuts.gain_per_second.register(MultifunctionRadar)
def gain_per_second(system: MultifunctionRadar, belief: Belief, ahead: ArrayLike = 1.0, worth: float = 1.0) -> Array:
    """The reduction of the expected later cost by each dwell, per second of its duration.

    Args:
        belief: the belief.
        ahead: seconds that count after an update, in which nothing else is done; a number, or several (h,).
        worth: value of a target that a search finds, in seconds of c0.

    Returns:
        (env, action), or (env, action, h), m^2.
    """
    aheads = np.atleast_1d(np.asarray(ahead, np.float64))
    out = np.empty((len(belief.step), len(system.actions), len(aheads)))
    gain_kernels.gains(belief, system.menu, system.laws, aheads, worth, out)
    return out if np.ndim(ahead) else out[..., 0]


@shortcuts.scores.register(MultifunctionRadar)
def scores(system: MultifunctionRadar, belief: Belief, rule: DwellRule) -> Array:
    """By gains in m^2."""
    out = np.empty((len(belief.step), len(system.actions)))
    gain_kernels.scores(belief, system.menu, system.laws, rule, out)
    return out


@shortcuts.simulate.register(MultifunctionRadar)
def simulate(
    system: MultifunctionRadar, belief: Belief, actions: Array, rule: DwellRule, seconds: float, futures: int
) -> Array:
    """In m^2 s, minus the worth of the searches (``gain_kernels``)."""
    envs, count = actions.shape
    rows = trees.repeated(belief, count * futures)
    first = np.ascontiguousarray(actions.repeat(futures, axis=1).reshape(-1))
    keys = (belief.step[:, None] * futures + np.arange(futures)).astype(np.uint64)
    keys = keys.repeat(count, axis=0).reshape(-1)
    value = np.zeros(len(first))
    gain_kernels.simulate(rows, first, keys, seconds, system.menu, system.laws, rule, value)
    mean: Array = value.reshape(envs, count, futures).mean(axis=2)
    return mean


@shortcuts.resting_cost.register(MultifunctionRadar)
def resting_cost(system: MultifunctionRadar, belief: Belief, seconds: float) -> Array:
    """In m^2 s."""
    out = np.empty(len(belief.step))
    kernels.rest(belief, seconds, system.laws, out)
    return out


@shortcuts.constants.register(MultifunctionRadar)
def constants(system: MultifunctionRadar) -> Array:
    """Searches of any sector and the wait: the actions that are always allowed."""
    return np.arange(system.slots * system.dwells.each, len(system.actions))
