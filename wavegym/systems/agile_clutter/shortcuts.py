"""What schedulers can do faster in clutter, and a step in compiled form."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from wavegym.core import shortcuts, trees
from wavegym.core.arrays import Array, for_kernel
from wavegym.core.horizon_weights import LinearCost
from wavegym.core.shortcuts import SensorBySensor
from wavegym.core.system import State
from wavegym.systems.agile_clutter import kernels
from wavegym.systems.agile_clutter import prediction_kernels as prediction
from wavegym.systems.agile_clutter.state import NN, Belief, PredictedTargets, Pulse, World, kernel_hypotheses
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.trackers.jpda import reduction_table


@shortcuts.fused_transition.register(AgileClutter)
def fused_transition(system: AgileClutter, state: State, action: Array, world: Any) -> State:
    """One step: predict, transmit, detect, associate, update, sensor after sensor; by its parts where ``tracker``
    is given.
    """
    if system._given_tracker:
        return system.composed_transition(state, action, world)
    return transmit(system, state, system.pulse(state.belief, action[:, None]), world)


def transmit(system: AgileClutter, state: State, pulse: Pulse, world: World) -> State:
    """``fused_transition`` with any pulse: for systems that add a resource."""
    truth, (step, mean, covariance, hypotheses) = state.truth, state.belief[:4]
    x, P, true_states = np.empty(mean.shape), np.empty(covariance.shape), np.empty(mean.shape)
    outside, scan = truth.outside.copy(), np.zeros(truth.scan.shape)
    given = kernel_hypotheses(hypotheses)
    fresh = [trees.tree_map(np.empty_like, each) for each in given[:2]]
    kernels.transition(
        step, mean, covariance, *given, truth.path, truth.first, world.error, world.key,
        pulse.rows((len(step), 1)), system._targets, system.truth_model._radar, *system._model, system._radar, x, P,
        *fresh, true_states, outside, scan, system.counts_every_sensor, NN
    )  # fmt: skip
    system._check_clutter_of_step(step, scan)
    after = next((h for h in fresh if type(h) is type(hypotheses)), None)
    belief = state.belief._replace(step=step + 1, mean=x, covariance=P, hypotheses=after)
    return State(truth._replace(targets=true_states, outside=outside, scan=scan), belief)


@shortcuts.linear_cost.register(AgileClutter)
def linear_cost(system: AgileClutter) -> LinearCost:
    """All targets move alike."""
    return system.linear_cost


@shortcuts.best_action.register(AgileClutter)
def best_action(system: AgileClutter, belief: Belief) -> Array:
    """The one-step scheduler's choice among the candidates, sensor after sensor (section 5.1).

    It is not always the best joint choice: a later sensor's pulse may favour another pulse at an earlier sensor.
    """
    predicted, choices = system.predicted_targets(belief), []
    pulses = system.action_set
    C, windows, alarm = pulses.sensor_covariances, pulses.sensor_windows, pulses.thresholds[1]
    for i in range(len(system.sensors)):
        choices.append(sensor_costs(system, predicted, i, C[None], windows[None], alarm).argmin(axis=1))
        if i + 1 < len(system.sensors):
            chosen = choices[-1]
            predicted = after_sensor(system, predicted, i, C[chosen], windows[chosen], alarm[chosen])
    return system.action_set.encode(np.stack(choices, axis=1))


@shortcuts.sensor_by_sensor.register(AgileClutter)
def sensor_by_sensor(system: AgileClutter) -> SensorBySensor:
    """The targets at the time of the next pulse, sensor after sensor."""
    return SensorBySensor(system.predicted_targets, partial(sensor_costs, system), partial(after_sensor, system))


def sensor_costs(
    system: AgileClutter, predicted: PredictedTargets, sensor: int, C: Array, windows: Array, alarm: Array
) -> Array:
    """trace(Lambda P) after one sensor's pulse, (env, candidate), for C (env or 1, candidate, 2, 2) at unit SNR,
    receive windows (env or 1, candidate, 11) and rows of thresholds (candidate,).
    """
    cost = np.empty((len(predicted.mean), C.shape[1]))
    prediction.sensor_costs(
        sensor, *predicted, C, for_kernel(windows), alarm, system._weights, system._radar, reduction_table(), cost, NN
    )
    return cost


def after_sensor(
    system: AgileClutter, predicted: PredictedTargets, sensor: int, C: Array, windows: Array, alarm: Array
) -> PredictedTargets:
    """The belief after this sensor's pulse with C (env, 2, 2) at unit SNR, receive windows (env, 11) and rows of
    thresholds (env,), before the next sensor's pulse.
    """
    P = np.empty(predicted.covariance.shape)
    prediction.after_sensor(sensor, *predicted, C, for_kernel(windows), alarm, system._radar, reduction_table(), P, NN)
    return predicted._replace(covariance=P)


@shortcuts.constants.register(AgileClutter)
def constants(system: AgileClutter) -> Array:
    """One law, duration and sweep at all sensors, each sensor up or down."""
    return system.action_set.constants
