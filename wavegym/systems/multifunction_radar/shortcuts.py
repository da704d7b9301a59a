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
from wavegym.systems.multifunction_radar.system import REFERENCE, MultifunctionRadar


@shortcuts.gain_per_second.register(MultifunctionRadar)
def gain_per_second(
    system: MultifunctionRadar, belief: Belief, worth: float = REFERENCE.worth, power: ArrayLike = REFERENCE.power
) -> Array:
    """What each dwell saves until its effect has worn off, per second of its duration.

    An update has worn off when the track is as bad as now: this is Whittle's index of a track that grows worse. A find
    has worn off when the target would have been found anyway, or has left (``System.value_of_find``).

    Args:
        belief: the belief.
        worth: factor of the worth of a find.
        power: the worth of a find is c0 times this power of its value in seconds; a number, or several (h,). At 1 finds
            far away count as if all could be held.

    Returns:
        (env, action), or (env, action, h), m^2.
    """
    worths = system.worths(worth, power)
    out = np.empty((len(belief.step), len(system.actions), len(worths)))
    gain_kernels.gains(belief, system.menu, system.laws, worths, out)
    return out if np.ndim(power) else out[..., 0]


@shortcuts.scores.register(MultifunctionRadar)
def scores(system: MultifunctionRadar, belief: Belief, rule: DwellRule) -> Array:
    """By gains in m^2."""
    out = np.empty((len(belief.step), len(system.actions)))
    worths = system.worths(rule.worth, rule.power)
    gain_kernels.scores(belief, system.menu, system.laws, rule, worths, out)
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
    worths = system.worths(rule.worth, rule.power)
    gain_kernels.simulate(rows, first, keys, seconds, system.menu, system.laws, rule, worths, value)
    mean: Array = value.reshape(envs, count, futures).mean(axis=2)
    return mean


@shortcuts.cost_to_come.register(MultifunctionRadar)
def cost_to_come(system: MultifunctionRadar, belief: Belief, seconds: float) -> Array:
    """In m^2 s; an undetected target counts as much as a find in the reference rule."""
    out = np.empty(len(belief.step))
    kernels.cost_to_come(belief, seconds, system.worths()[0], system.laws, out)
    return out


@shortcuts.constants.register(MultifunctionRadar)
def constants(system: MultifunctionRadar) -> Array:
    """Searches of any sector and the wait: the actions that are always allowed."""
    return np.arange(system.slots * system.dwells.each, len(system.actions))
