"""The state of platforms whose camera has to turn: tape, truth, measurements, belief, and observation fields."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import ObservationField
from wavegym.systems.rf_eo.state import Belief as PlatformBelief
from wavegym.systems.visibility_windows import window_fields


class World(NamedTuple):
    """One episode's tape, uniform and standard normal."""

    place: Array  # (target, 2) uniform: start of each target in the region
    velocity: Array  # (target, 2) normal: first velocities
    start: Array  # (target, 4) normal: errors of the first estimates
    process: Array  # (H, target, 4) normal: process noise
    error: Array  # (H, platform, target, 3) normal: measurement errors
    density: Array  # (target,) uniform: process noise density of each target
    window: Array  # (target, draws) uniform: windows of visibility
    found: Array  # (H, target) uniform: the camera finds a target in view if the draw is below ``detection``


class Truth(NamedTuple):
    """The part of the state that no scheduler sees."""

    targets: Array  # (env, target, 4)
    received: Array  # (env, target) int: measured quantities of the last step
    unseen: Array  # (env, target) int: steps since the camera found the target
    seen: Array  # (env, target) bool: whether the camera found the target in the last step
    q: Array  # (env, target) m^2/s^3: process noise density
    window: Array | None = None  # (env, target) int: window of a recording; None if targets follow the motion model


class Measurements(NamedTuple):
    """Measurements of radars and camera in one step, platform by platform: range (m), range-rate (m/s), azimuth (rad).

    The azimuth is relative to the camera's pointing. Only the first platform has a camera.
    """

    z: Array  # (env, target, 3 platforms), 0 for quantities that were not received
    variance: Array  # (env, target, 3 platforms) of the errors as the tracker assumes it; infinite: not received


class Belief(NamedTuple):
    """The belief, the camera's state, and the known windows of visibility."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    polar_mean: Array  # (env, target, 4): range, range-rate, azimuth, velocity across the line of sight
    polar_covariance: Array  # (env, target, 4, 4)
    pointing: Array  # (env,) rad, clockwise from +y
    settling: Array  # (env,) int: remaining steps to settle after the turn
    q: Array  # (env, target) m^2/s^3: process noise density
    visible: Array  # (env, H, target) bool: whether the line of sight from camera to target is free
    memory: Any = None  # of a given tracker with a memory; otherwise, and in predictions, None
    process_noise: Array | None = None  # (env, target, 4, 4) of the next step as a given tracker assumes it; None: q


def camera_fields(targets: int) -> tuple[ObservationField, ...]:
    """Observation fields: time left, the camera, and the target of each look."""
    listed = [
        ObservationField("time_left", "1", 0.5, 0.5, "remaining share of the episode's steps"),
        ObservationField("settling", "1", 0.5, 1.0, "remaining steps to settle after the camera's turn"),
    ]
    for t in range(1, targets + 1):
        where = f"target {t}, predicted one step ahead"
        listed += [
            ObservationField(f"bearing_{t}", "rad", 0.0, 1.0, f"azimuth of {where}, relative to the camera's pointing"),
            ObservationField(f"delay_{t}", "1", 4.0, 4.0, f"steps until the camera can see {where}"),
            ObservationField(f"in_view_{t}", "1", 0.5, 0.5, f"1 if the camera can see {where}, without delay, else 0"),
            *window_fields(t)[:2],
            ObservationField(f"log10_q_{t}", "log10(m^2/s^3)", 0.0, 0.5, f"process noise density of target {t}"),
        ]
    return tuple(listed)


def platform_belief(belief: Belief, earlier_noise: Array, platforms: int) -> PlatformBelief:
    """The belief for the platform system, whose noise density is 1, such that it predicts with each target's density.

    Args:
        belief: the belief.
        earlier_noise: F^-1 Q F'^-1, (4, 4): the noise of one step, referred to the state before it.
        platforms: number of platforms; all look along +y.
    """
    extra = (belief.q - 1.0)[:, :, None, None] * earlier_noise
    looks = np.zeros((len(belief.step), platforms))
    return PlatformBelief(belief.step, belief.mean, belief.covariance + extra, looks)
