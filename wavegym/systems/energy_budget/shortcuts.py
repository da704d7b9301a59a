"""Shortcuts for schedulers with an energy account, and a step in compiled form."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.arrays import Array
from wavegym.core.system import State
from wavegym.systems.agile_clutter.shortcuts import transmit
from wavegym.systems.agile_clutter.state import NN
from wavegym.systems.energy_budget import kernels
from wavegym.systems.energy_budget.system import EnergyBudget
from wavegym.trackers.jpda import reduction_table


@shortcuts.fused_transition.register(EnergyBudget)
def fused_transition(system: EnergyBudget, state: State, action: Array, world: Any) -> State:
    """One step: pay, transmit, detect unless the slot is occluded, update."""
    if system._given_tracker:
        return system.composed_transition(state, action, world)
    used, left, is_clear = system._slot(state.belief, action, world)
    truth, belief = transmit(system, state, system._in_slot(used, is_clear), world)
    own = {"spent": system.spending[used], "occluded": ~is_clear, "replaced": used != action}
    return State(truth._replace(**own), system._belief(belief, left, system._occlusion_after(state.belief, is_clear)))


@shortcuts.spending.register(EnergyBudget)
def spending(system: EnergyBudget) -> Array:
    """Energy of each candidate's pulses."""
    return system.spending


@shortcuts.delay.register(EnergyBudget)
def delay(system: EnergyBudget, belief: Any) -> Array:
    """Steps before a candidate's pulses, (env, candidate): 0."""
    return np.zeros((len(belief.step), len(system.action_set.action_quanta)), np.int64)


@shortcuts.gain.register(EnergyBudget)
def gain(system: EnergyBudget, belief: Any, wait: Array | int, ahead: int) -> Array:
    """Expected reduction of the summed cost of ``ahead`` steps by a candidate's pulses, (env, candidate).

    trace(M (P without - P with)), M of ``horizon_weights``. Steps beyond the episode's end do not count.

    Args:
        belief: the belief.
        wait: steps without any measurement before the pulses; one number, or (env, candidate).
        ahead: steps that count, the pulses' own included.
    """
    later = np.array(np.broadcast_to(wait, (len(belief.step), len(system.action_set.action_quanta))), np.int64)
    left = system.horizon - belief.step[:, None] - later
    clear = np.where(left > 0, system._later_clear_probability(belief, later), 0.0)
    out = np.empty(later.shape)
    kernels.gain(
        *belief[:3], later, clear, left, system.linear_cost.weights_ahead(ahead), system._candidate_pulses,
        system.action_set.actions.indices, system._targets, *system._model, system._radar, reduction_table(), out, NN
    )  # fmt: skip
    return out


@shortcuts.constants.register(EnergyBudget)
def constants(system: EnergyBudget) -> Array:
    """Actions in which all transmitting radars send the same pulse; silence included."""
    return system.action_set.constants
