"""Shortcuts of schedulers for RF/EO platforms, and a step in compiled form."""

from __future__ import annotations

from functools import partial

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.horizon_weights import LinearCost
from wavegym.core.shortcuts import MeasuredFields
from wavegym.core.system import ObservationField, State
from wavegym.systems.rf_eo import kernels, plan_kernels, search_kernels
from wavegym.systems.rf_eo.state import Belief, Truth, World, received_fields, received_values
from wavegym.systems.rf_eo.system import NN, RfEo

PROPOSED = ((60e3, 10e6, 1e-3), (40e3, 5e6, 1e-3))  # the non-adaptive settings: PRF in Hz, B in Hz, pixel angle in rad


@shortcuts.fused_transition.register(RfEo)
def fused_transition(system: RfEo, state: State, action: Array, world: World) -> State:
    """One step: targets move, platforms take their settings and measure, the filter updates.

    With recorded targets, or with a given tracker, the step is played by its parts.
    """
    if system._given_tracker or system.truth_model._recorded:
        return system.composed_transition(state, action, world)
    (true_states, _, unseen, *_), (step, mean, covariance, *_) = state
    settings = system.aimed_settings(state.belief, action)
    x, P, moved = np.empty(mean.shape), np.empty(covariance.shape), np.empty(mean.shape)
    received, missed, share = np.empty(unseen.shape, np.int64), np.empty(unseen.shape, np.int64), np.empty(len(x))
    kernels.transition(
        step, mean, covariance, true_states, unseen, world.process, world.error, settings,
        system._true_motion, system.truth_model._rules, system._scene, x, P, moved, received, missed, share, NN
    )  # fmt: skip
    return State(Truth(moved, received, missed, share), Belief(step + 1, x, P, settings[..., 3].copy()))


@shortcuts.linear_cost.register(RfEo)
def linear_cost(system: RfEo) -> LinearCost:
    """F and Lambda, which are the same for all targets."""
    return LinearCost(system.motion.F, system.weights)


@shortcuts.best_action.register(RfEo)
def best_action(system: RfEo, belief: Belief) -> Array:
    """The one-step scheduler's choice, platform by platform until none changes; on a fine grid if actions are a box."""
    chosen = np.empty((len(belief.step), len(system.platforms), 2), np.int64)
    sent = system.action_set
    search_kernels.best_settings(
        belief.step, belief.mean, belief.covariance, belief.looks, sent.axes, sent.sizes, system._weights,
        system._assumed(belief), chosen, NN
    )  # fmt: skip
    return system.action_set.choose(chosen[..., 0], chosen[..., 1])


@shortcuts.most_information.register(RfEo)
def most_information(system: RfEo, belief: Belief, threshold: float | None = None) -> tuple[Array, Array]:
    """The paper's choice on the same grid: the greatest total information that gives every target at least t.

    Args:
        system: the system.
        belief: the belief.
        threshold: t; None for the system's ``threshold``.

    Returns:
        Actions (env, ...), and whether t was reached, (env,) bool. If not, the choice maximises the information of the
        target that has the least.

    Raises:
        InputError: a threshold that is negative or not a number.
    """
    feasible = np.empty(len(belief.step), np.bool_)
    chosen = np.empty((len(feasible), len(system.platforms), 2), np.int64)
    least = system.threshold if threshold is None else threshold
    if not least >= 0.0:
        raise InputError(f"threshold is {least}, expected a number >= 0")
    sent = system.action_set
    search_kernels.most_information(
        belief.step, belief.mean, belief.covariance, belief.looks, sent.axes, sent.sizes, least,
        system._assumed(belief), chosen, feasible, NN
    )  # fmt: skip
    return system.action_set.choose(chosen[..., 0], chosen[..., 1]), feasible


@shortcuts.plan.register(RfEo)
def plan(system: RfEo, belief: Belief, depth: int) -> tuple[Array, Array]:
    """A good sequence of ``depth`` choices: that of the one-step scheduler, improved one grid point at a time.

    Returns:
        The first actions (env, ...), and the predicted cost of the whole sequence (env,).
    """
    cost = np.empty(len(belief.step))
    chosen = np.empty((len(cost), depth, len(system.platforms), 2), np.int64)
    plan_kernels.plan(
        belief.step, belief.mean, belief.covariance, belief.looks, system.horizon, system.action_set.axes,
        system.action_set.sizes, system._weights, system._assumed(belief), chosen, cost, NN
    )  # fmt: skip
    return system.action_set.choose(chosen[:, 0, :, 0], chosen[:, 0, :, 1]), cost


@shortcuts.measured_fields.register(RfEo)
def measured_fields(system: RfEo) -> MeasuredFields:
    """The platforms' last report of each target, and their look directions if they turn."""
    looked = "azimuth, clockwise from +y, to which platform {} looks"
    numbers = range(1, len(system.platforms) + 1) if system.slew_rate > 0.0 else ()
    looks = tuple(ObservationField(f"look_{j}", "rad", 0.0, 1.8, looked.format(j)) for j in numbers)
    received = received_fields(len(system.starts), len(system.platforms))
    return MeasuredFields(received, received_values, looks, partial(_looks, count=len(looks)))


def _looks(belief: Belief, count: int) -> Array:
    return belief.looks[:, :count]


@shortcuts.named_constants.register(RfEo)
def named_constants(system: RfEo) -> dict[str, Array]:
    """``proposed``: the non-adaptive settings, if the box contains them and no platform turns."""
    if system.action != "box" or system.slew_rate > 0.0 or len(system.platforms) != len(PROPOSED):
        return {}
    settings = np.array(PROPOSED)
    inside = all(
        low <= v <= high for row in PROPOSED for v, (low, high) in zip(row, system.action_set.ranges, strict=True)
    )
    return {"proposed": system.action_set.encode(settings)} if inside else {}
