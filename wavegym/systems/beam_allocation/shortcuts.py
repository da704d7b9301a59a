"""Shortcuts for beams that turn at once."""

from __future__ import annotations

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.arrays import Array, for_kernel
from wavegym.systems.agile_clutter.state import NN
from wavegym.systems.beam_allocation import kernels
from wavegym.systems.beam_allocation.state import Belief
from wavegym.systems.beam_allocation.system import BeamAllocation
from wavegym.trackers.jpda import reduction_table


@shortcuts.delay.register(BeamAllocation)
def delay(system: BeamAllocation, belief: Belief) -> Array:
    """Steps before each candidate's pulse, (env, candidate): 0, because beams turn at once."""
    return np.zeros((len(belief.step), len(system.action_set.joint)), np.int64)


@shortcuts.gain_by_target.register(BeamAllocation)
@shortcuts.gain.register(BeamAllocation)
def gain(system: BeamAllocation, belief: Belief, wait: Array | int, ahead: Array | int) -> Array:
    """Reduction of the summed cost of ``ahead`` steps by each candidate's pulses.

    Args:
        belief: the belief.
        wait: steps without any measurement before the pulses, int or (env or 1, candidate or 1).
        ahead: steps that count, the pulses' own included, int or one for each target, (env or 1, target); steps
            beyond the horizon do not count.

    Returns:
        Expected over detections, (env, candidate); 0 if the targets are hidden then or the episode is over.
    """
    out = np.empty((len(belief.step), len(system.action_set.joint)))
    waits, counted = np.empty(out.shape, np.int64), np.empty(belief.mean.shape[:2], np.int64)
    waits[...], counted[...] = wait, ahead
    M, visible = system.linear_cost.weights_ahead(int(counted.max())), for_kernel(belief.visible)
    kernels.gain(
        *belief[:3], visible, waits, counted, *system.action_set.chirp_codes, system.action_set.chirp_covariances,
        system.action_set.numbered_windows, M, *system._model, system._radar, reduction_table(), out, NN
    )  # fmt: skip
    return out


@shortcuts.target_of_action.register(BeamAllocation)
def target_of_action(system: BeamAllocation) -> Array:
    """The target of each radar's beam, (candidate, radar)."""
    return system.action_set.illuminated.argmax(axis=2)
