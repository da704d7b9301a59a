"""Shortcuts of schedulers for a turning camera, and a step in compiled form."""

from __future__ import annotations

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.arrays import Array, for_kernel
from wavegym.core.shortcuts import MeasuredFields
from wavegym.core.system import ObservationField, State
from wavegym.systems.camera_slew import kernels
from wavegym.systems.camera_slew.state import Belief, Truth, World
from wavegym.systems.camera_slew.system import CameraSlew
from wavegym.systems.look_system import NN
from wavegym.systems.rf_eo.state import received_fields, received_values


@shortcuts.fused_transition.register(CameraSlew)
def fused_transition(system: CameraSlew, state: State, action: Array, world: World) -> State:
    """One step: targets move, the camera turns, radars and camera measure, the filter updates."""
    if system.truth_model._recorded or system._given_tracker:
        return system.composed_transition(state, action, world)
    truth, belief = state
    shape, fresh = truth.unseen.shape, system._empty(belief.step.shape)
    received, unseen, seen = np.empty(shape, np.int64), np.empty(shape, np.int64), np.empty(shape, np.bool_)
    moved = np.empty(truth.targets.shape)
    kernels.transition(
        *belief[:9], truth.targets, truth.unseen, truth.q, world.process, world.error, world.found, action,
        *system._true_motion, system._world, *system._scene, *fresh, moved, received, unseen, seen, NN
    )  # fmt: skip
    return State(Truth(moved, received, unseen, seen, truth.q), Belief(belief.step + 1, *fresh, *belief[7:]))


@shortcuts.delay.register(CameraSlew)
def delay(system: CameraSlew, belief: Belief) -> Array:
    """Steps until the camera can see each target, if it starts to turn now, (env, candidate) int.

    By then the camera has turned and settled, and the line of sight is free.
    """
    return system._turns(belief)[0]


@shortcuts.gain.register(CameraSlew)
def gain(system: CameraSlew, belief: Belief, wait: Array | int, ahead: int) -> Array:
    """Reduction of the summed cost by one look at each target after ``wait`` steps.

    The sum runs over ``ahead`` steps from the look on, and over all targets in the image, each weighted with the
    probability that the camera finds it. The radars' measurements before the look count as if they were taken with it.
    Without them, the gain of a look at a distant target would be overestimated. Measurements after the look do not
    count.

    Args:
        system: the system.
        belief: the belief.
        wait: steps before the look, (env, candidate) or a number.
        ahead: steps, including that of the look; fewer at the episode's end.

    Returns:
        (env, candidate), 0 if the look would come after the episode's end.
    """
    out = np.empty(belief.mean.shape[:2])
    waits = for_kernel(np.broadcast_to(wait, out.shape), np.int64)
    _, _, *scene = system._scene
    kernels.gain(
        belief.step, belief.mean, belief.covariance, system._expected(belief).q, belief.visible, waits, *system._powers,
        system.linear_cost.weights_ahead(ahead), *scene, out, NN
    )  # fmt: skip
    return out


@shortcuts.measured_fields.register(CameraSlew)
def measured_fields(system: CameraSlew) -> MeasuredFields:
    """The platforms' last report of each target, the camera's pointing, and whether the camera has settled."""
    return MeasuredFields(
        received_fields(system.targets, len(system.platforms)),
        received_values,
        (
            ObservationField("pointing", "rad", 0.0, 1.8, "azimuth to which the camera points"),
            ObservationField("settling", "1", 0.5, 1.0, "remaining steps to settle after the camera's turn"),
        ),
        _camera,
    )


def _camera(belief: Belief) -> Array:
    return np.stack([belief.pointing, belief.settling], axis=1)


@shortcuts.target_of_action.register(CameraSlew)
def target_of_action(system: CameraSlew) -> Array:
    """The target that each candidate turns the camera to, (candidate, 1)."""
    return system.candidates()[:, None]
