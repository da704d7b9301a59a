"""Shortcuts of schedulers for an illuminator that has to be set up, and a step in compiled form."""

from __future__ import annotations

from functools import partial

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.arrays import Array
from wavegym.core.shortcuts import MeasuredFields
from wavegym.core.system import State
from wavegym.systems.look_system import NN
from wavegym.systems.sector_setup import kernels
from wavegym.systems.sector_setup import prediction_kernels as prediction
from wavegym.systems.sector_setup.state import Belief, World, illuminator_fields, report_fields, report_values
from wavegym.systems.sector_setup.system import SectorSetup


@shortcuts.fused_transition.register(SectorSetup)
def fused_transition(system: SectorSetup, state: State, action: Array, world: World) -> State:
    """One step: targets move, the illuminator is set up or sends a pulse, the filter updates."""
    if system.truth_model._recorded or system._given_tracker:
        return system.composed_transition(state, action, world)
    truth, belief = state
    targets, report, fresh = np.empty(truth.targets.shape), system._report(belief), system._fresh(belief)
    kernels.transition(
        *belief[:6], belief.looked, *truth[:3], *system._split(action), world.process, world.key, world.error,
        system.motion.noise_factor, system.truth_model._radar, system._radar, targets, *report, *fresh, NN
    )  # fmt: skip
    measurements = system._measurements(*report)
    return State(system.annotate(truth._replace(targets=targets), measurements), system._following(belief, *fresh))


@shortcuts.delay.register(SectorSetup)
def delay(system: SectorSetup, belief: Belief) -> Array:
    """Steps without sensing before the pulse of each candidate, (env, candidate)."""
    target = system._target_and_waveform[0]
    return np.where(target == belief.pointed[:, None], belief.dead[:, None], system.dead_steps)


@shortcuts.gain.register(SectorSetup)
def gain(system: SectorSetup, belief: Belief, wait: Array | int, ahead: int) -> Array:
    """Decrease of the summed cost over ``ahead`` steps from the look on, for each candidate.

    Args:
        system: the system.
        belief: the belief.
        wait: steps without measurements before the look, int or (env or 1, candidate or 1).
        ahead: steps counted, including that of the look; steps beyond the horizon count 0.

    Returns:
        Expected value over detections, (env, candidate); 0 if the target is hidden or the episode is over.
    """
    out = np.empty((len(belief.step), len(system.actions)))
    later = np.atleast_2d(np.asarray(wait, np.int64))
    step, mean, covariance, pointed, _, q, visible, looked, *_ = system._expected(belief)
    target, waveform = system._target_and_waveform
    M, rows = system.linear_cost.weights_ahead(ahead), (0,) * (2 * len(system.receivers))
    prediction.gain(
        step, mean, covariance, pointed, q, visible, looked, target, waveform, later, M, system._radar, out, NN, rows
    )
    return out


@shortcuts.measured_fields.register(SectorSetup)
def measured_fields(system: SectorSetup) -> MeasuredFields:
    """The receivers' last report, the illuminated target, and the remaining steps of its set-up."""
    return MeasuredFields(
        report_fields(len(system.receivers), system.reference_range, system.speed[1]),
        partial(report_values, reference_range=system.reference_range),
        illuminator_fields(system.targets, system.dead_steps),
        partial(_illuminator, system),
    )


def _illuminator(system: SectorSetup, belief: Belief) -> Array:
    return np.column_stack([belief.pointed[:, None] == np.arange(system.targets), belief.dead])


@shortcuts.target_of_action.register(SectorSetup)
def target_of_action(system: SectorSetup) -> Array:
    """The illuminated target of each candidate, (candidate, 1)."""
    return system._target_and_waveform[0][:, None]
