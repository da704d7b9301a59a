"""Targets before a camera that has to turn: tape, truth, belief, what an agent is shown of it, and what makes one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from numpy.typing import NDArray

from wavegym.errors import non_negative, ordered, positive, within
from wavegym.systems.contract import Element
from wavegym.systems.rf_eo_state import MOST

if TYPE_CHECKING:
    from wavegym.systems.planning.camera_slew import CameraSlew

Array = NDArray[Any]

LONGEST = 10_000  # steps; as many matrices are kept
FASTEST = 1e6  # rad/s


class World(NamedTuple):
    """One episode's tape, uniform and standard normal."""

    place: Array  # (target, 2) uniform: where in the region each target starts
    velocity: Array  # (target, 2) normal
    start: Array  # (target, 4) normal: errors of the first estimates
    process: Array  # (H, target, 4) normal: manoeuvres
    error: Array  # (H, platform, target, 3) normal: measurement errors
    found: Array  # (H, target) uniform: the camera finds a target in view where below ``detection``


class Hidden(NamedTuple):
    """What no scheduler sees."""

    truth: Array  # (env, target, 4)
    received: Array  # (env, target) int: measured quantities of the last step
    unseen: Array  # (env, target) int: steps since the camera found the target
    seen: Array  # (env, target) bool: whether it did in the last step


class Public(NamedTuple):
    """The belief, and the camera."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    pointing: Array  # (env,) rad, clockwise from +y
    settling: Array  # (env,) int: steps that the camera still has to settle once it has arrived


def camera_elements(targets: int) -> tuple[Element, ...]:
    """Observation elements: time left, the camera, and of every target what it takes to look at it."""
    listed = [
        Element("time_left", "1", 0.5, 0.5, "share of the episode's steps that are left"),
        Element("settling", "1", 0.5, 1.0, "steps that the camera still has to settle once it has arrived"),
    ]
    for t in range(1, targets + 1):
        where = f"target {t}, as predicted one step ahead"
        listed += [
            Element(f"bearing_{t}", "rad", 0.0, 1.0, f"from where the camera points to {where}"),
            Element(f"delay_{t}", "1", 4.0, 4.0, f"steps without sight before the camera sees {where}"),
            Element(f"in_view_{t}", "1", 0.5, 0.5, f"1 if the camera sees {where}, without any delay, else 0"),
        ]
    return tuple(listed)


def check_camera(system: CameraSlew) -> None:
    """InputError for a region or a camera that make no scenario; the parent checks the rest."""
    within("targets", system.targets, 1, MOST)
    within("horizon", system.horizon, 1, LONGEST)
    for name, unit in (("half_field", "rad"), ("slew", "rad/s"), ("prf", "Hz"), ("bandwidth", "Hz")):
        positive(name, getattr(system, name), unit)
    within("half_field", system.half_field, 0.0, 0.5 * math.pi, "rad")
    within("slew", system.slew, 0.0, FASTEST, "rad/s")
    within("settle", system.settle, 0, system.horizon, "steps")
    within("detection", system.detection, 0.0, 1.0)
    non_negative("speed", system.speed)
    ordered("sector", *system.sector)
    ordered("ranges", *system.ranges)
    for azimuth in system.sector:
        within("azimuth in sector", azimuth, -math.pi, math.pi, "rad")
    positive("least of ranges", system.ranges[0], "m")
