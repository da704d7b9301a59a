"""Targets before a camera that has to turn: tape, truth, belief, what an agent is shown of it, and what makes one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import check_non_negative, check_ordered, check_positive, check_within
from wavegym.core.system import ObservationField, State
from wavegym.systems import visibility_windows as windows
from wavegym.systems.rf_eo.kernels import measure
from wavegym.systems.rf_eo.state import MOST
from wavegym.systems.rf_eo.state import Belief as RfEoBelief
from wavegym.systems.rf_eo.system import NN, RfEo
from wavegym.systems.visibility_windows import given_windows, window_draws
from wavegym.targets import MotionModel

if TYPE_CHECKING:
    from wavegym.systems.camera_slew.system import CameraSlew


SOON = 10  # steps of visibility that are observed
LONGEST = 10_000  # steps; as many matrices are kept
FASTEST = 1e6  # rad/s
LOST_AFTER = 30  # steps in which the camera has not found a target


class World(NamedTuple):
    """One episode's tape, uniform and standard normal."""

    place: Array  # (target, 2) uniform: where in the region each target starts
    velocity: Array  # (target, 2) normal
    start: Array  # (target, 4) normal: errors of the first estimates
    process: Array  # (H, target, 4) normal: manoeuvres
    error: Array  # (H, platform, target, 3) normal: measurement errors
    density: Array  # (target,) uniform: how much each target manoeuvres
    window: Array  # (target, draws) uniform: when each target is in sight
    found: Array  # (H, target) uniform: the camera finds a target in view where below ``detection``


class Truth(NamedTuple):
    """What no scheduler sees."""

    targets: Array  # (env, target, 4)
    received: Array  # (env, target) int: measured quantities of the last step
    unseen: Array  # (env, target) int: steps since the camera found the target
    seen: Array  # (env, target) bool: whether it did in the last step


class Belief(NamedTuple):
    """The belief, and the camera."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    pointing: Array  # (env,) rad, clockwise from +y
    settling: Array  # (env,) int: steps that the camera still has to settle once it has arrived
    q: Array  # (env, target) m^2/s^3: process noise density
    visible: Array  # (env, H, target) bool: whether the camera's line of sight to the target is free in each step


def camera_fields(targets: int) -> tuple[ObservationField, ...]:
    """Observation elements: time left, the camera, and of every target what it takes to look at it."""
    listed = [
        ObservationField("time_left", "1", 0.5, 0.5, "share of the episode's steps that are left"),
        ObservationField("settling", "1", 0.5, 1.0, "steps that the camera still has to settle once it has arrived"),
    ]
    for t in range(1, targets + 1):
        where = f"target {t}, as predicted one step ahead"
        listed += [
            ObservationField(f"bearing_{t}", "rad", 0.0, 1.0, f"from where the camera points to {where}"),
            ObservationField(f"delay_{t}", "1", 4.0, 4.0, f"steps without sight before the camera sees {where}"),
            ObservationField(f"in_view_{t}", "1", 0.5, 0.5, f"1 if the camera sees {where}, without any delay, else 0"),
            ObservationField(
                f"visible_{t}", "1", 0.5, 0.5, f"1 if nothing blocks the line of sight to target {t}, else 0"
            ),
            ObservationField(
                f"changes_{t}", "step", 0.5 * SOON, 0.5 * SOON, f"steps until that changes, at most {SOON}"
            ),
            ObservationField(f"log10_q_{t}", "log10(m^2/s^3)", 0.0, 0.5, f"process noise density of target {t}"),
        ]
    return tuple(listed)


def starts(system: CameraSlew, world: World) -> Array:
    """Where the tape has the targets at the beginning, (env, target, 4)."""
    azimuth = system.sector[0] + (system.sector[1] - system.sector[0]) * world.place[..., 0]
    r = system.ranges[0] + (system.ranges[1] - system.ranges[0]) * world.place[..., 1]
    x, y = system.platforms[0]
    vx, vy = system.speed * world.velocity[..., 0], system.speed * world.velocity[..., 1]
    return np.stack([x + r * np.sin(azimuth), vx, y + r * np.cos(azimuth), vy], axis=-1)


def coming(belief: Belief) -> tuple[Array, Array]:
    """Whether each target is in sight in the step to come, and steps until that changes, at most SOON: (env, target).

    Beyond the episode's end nothing is in sight.
    """
    ahead = windows.coming(belief.visible, belief.step, SOON + 1)
    other = ahead != ahead[:, :1]
    other[:, SOON] = True
    return ahead[:, 0], other.argmax(axis=1)


def platforms(system: CameraSlew) -> RfEo:
    """The parent's loop at one setting, with a process noise density of 1."""
    angle = 2.0 * system.half_field / system.pixels
    return RfEo(
        horizon=system.horizon, dt=system.dt, q=1.0, carrier_hz=system.carrier_hz, fft_length=system.fft_length,
        pixels=system.pixels, platforms=system.platforms, starts=((0.0, 0.0, system.ranges[1], 0.0),) * system.targets,
        prior_variance=system.prior_variance, prf=(system.prf, 2.0 * system.prf),
        bandwidth=(0.5 * system.bandwidth, system.bandwidth), pixel_angle=(angle, 2.0 * angle), penalty="hard",
        iterations=system.iterations, weights=system.weights, nearest_range=system.nearest_range,
    )  # fmt: skip


def parents_belief(belief: Belief, undone: Array) -> RfEoBelief:
    """The belief that the parent, which predicts with a noise density of 1, predicts as the targets' own have it.

    ``undone`` (4, 4): F^-1 Q F'^-1.
    """
    extra = (belief.q - 1.0)[:, :, None, None] * undone
    return RfEoBelief(belief.step, belief.mean, belief.covariance + extra)


def powers(motion: MotionModel, steps: int) -> tuple[Array, Array]:
    """Transition and noise of 1, 2, ... steps, (steps, 4, 4) each."""
    F, Q = motion.F, motion.Q
    transitions, noises = [F], [Q]
    for _ in range(steps - 1):
        transitions.append(F @ transitions[-1])
        noises.append(F @ noises[-1] @ F.T + Q)
    return np.stack(transitions), np.stack(noises)


def check_camera(system: CameraSlew) -> None:
    """InputError for a region or a camera that make no scenario; the parent checks the rest."""
    check_within("targets", system.targets, 1, MOST)
    check_within("horizon", system.horizon, 1, LONGEST)
    for name, unit in (("half_field", "rad"), ("slew", "rad/s"), ("prf", "Hz"), ("bandwidth", "Hz")):
        check_positive(name, getattr(system, name), unit)
    check_within("half_field", system.half_field, 0.0, 0.5 * math.pi, "rad")
    check_within("slew", system.slew, 0.0, FASTEST, "rad/s")
    check_within("settle", system.settle, 0, 1000, "steps")
    check_within("detection", system.detection, 0.0, 1.0)
    check_non_negative("speed", system.speed)
    check_ordered("sector", *system.sector)
    check_ordered("ranges", *system.ranges)
    for azimuth in system.sector:
        check_within("azimuth in sector", azimuth, -math.pi, math.pi, "rad")
    check_positive("least of ranges", system.ranges[0], "m")
    check_ordered("q", *system.q)
    check_positive("low of q", system.q[0], "m^2/s^3")
    window_draws(system.horizon, system.shown, system.hidden)
    given_windows(system.windows, system.targets, system.horizon)


def key_figures(state: State) -> dict[str, Array]:
    """What ``CameraSlew.metrics`` says of a state."""
    truth, belief = state
    position, nees = np.empty(truth.unseen.shape), np.empty(truth.unseen.shape)
    measure(belief.mean, belief.covariance, truth.targets, position, nees, NN)
    return {
        "position_error": position,
        "nees": nees,
        "received": truth.received.copy(),
        "found": truth.seen.copy(),
        "lost": truth.unseen > LOST_AFTER,
        "pointing": belief.pointing.copy(),
        "settling": belief.settling.copy(),
    }
