"""The state of the RF/EO loop: tape, truth, measurements, belief, and observation fields."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import ObservationField

QUANTITIES = (("range", "m", 3.5, 1.0), ("range_rate", "m/s", 0.5, 1.5), ("azimuth", "rad", -0.5, 1.0))
SPREADS = (("r", "m", 1.0, 1.0), ("rdot", "m/s", -0.5, 1.0), ("az", "rad", -3.0, 1.5))
SOON = 10  # steps; a longer time until a target comes or goes is observed as this


class World(NamedTuple):
    """One episode's tape, all standard normal."""

    start: Array  # (target, 4) error of the first estimate, if it is drawn
    process: Array  # (H, target, 4) process noise
    error: Array  # (H, platform, target, 3) measurement errors


class Truth(NamedTuple):
    """The part of the state that no scheduler sees."""

    targets: Array  # (env, target, 4)
    received: Array  # (env, target) int: measured quantities of the last step
    unseen: Array  # (env, target) int: steps since the last measurement
    share: Array  # (env,) least weighted information of any target, predicted for the last settings
    window: Array | None = None  # (env, target) int: window of a recording; None if targets follow the motion model


class Measurements(NamedTuple):
    """The platforms' measurements in one step, platform by platform: range (m), range-rate (m/s), azimuth (rad)."""

    z: Array  # (env, target, 3 platforms), 0 for quantities that were not received
    variance: Array  # (env, target, 3 platforms) of the errors as the tracker assumes it; infinite: not received
    information: Array  # (env,) least weighted information of any target, predicted for the settings
    present: Array  # (env, target) bool: targets in the scene


class Belief(NamedTuple):
    """The belief."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    looks: Array  # (env, platform) rad: look directions, clockwise from +y
    memory: Any = None  # of a tracker with a memory; otherwise, and in predictions, None
    process_noise: Array | None = None  # (env, target, 4, 4) of the next step as the tracker assumes it; None: Q


def received_fields(targets: int, platforms: int) -> tuple[ObservationField, ...]:
    """Fields of each platform's report of each target, in the order of ``received_values``."""
    listed = []
    for t in range(1, targets + 1):
        for j in range(1, platforms + 1):
            where = f"of target {t} from platform {j}"
            listed += [
                ObservationField(f"log10_range_{t}_{j}", "log10(m)", *QUANTITIES[0][2:], f"last range {where}"),
                ObservationField(f"range_rate_{t}_{j}", "m/s", 0.0, 30.0, f"last range-rate {where}"),
                ObservationField(f"azimuth_{t}_{j}", "rad", 0.0, 1.8, f"last azimuth {where}"),
            ]
            listed += [
                ObservationField(f"received_{name}_{t}_{j}", "1", 0.5, 0.5, f"1 if the {name} {where} was received")
                for name, *_ in QUANTITIES
            ]
    return tuple(listed)


def received_values(measurements: Any) -> Array:
    """Values of ``received_fields``, (env, fields), for measurements with z and variance (env, target, 3 platforms)."""
    z, variance = measurements[:2]
    received = np.isfinite(variance).reshape(*z.shape[:2], -1, 3)
    values = z.reshape(received.shape).copy()
    values[..., 0] = np.where(received[..., 0], np.log10(np.maximum(values[..., 0], 1.0)), QUANTITIES[0][2])
    values[..., 1:] = np.where(received[..., 1:], values[..., 1:], 0.0)
    return np.concatenate([values, received], axis=-1).reshape(len(z), -1)


def platform_fields(targets: int, platforms: int) -> tuple[ObservationField, ...]:
    """Each target's uncertainty, and its predicted measurements at each platform, one step ahead.

    ``kernels.observe`` fills the fields in this order.
    """
    listed = []
    for t in range(1, targets + 1):
        of = f"uncertainty of target {t}, one step ahead"
        listed += [
            ObservationField(f"log10_sigma_position_{t}", "log10(m)", 0.5, 1.0, f"RMS position {of}"),
            ObservationField(f"log10_sigma_velocity_{t}", "log10(m/s)", -0.3, 0.5, f"RMS velocity {of}"),
        ]
        for j in range(1, platforms + 1):
            where = f"of target {t} from platform {j}, predicted one step ahead"
            for (name, unit, centre, scale), (short, _, middle, width) in zip(QUANTITIES, SPREADS, strict=True):
                words = name.replace("_", "-")
                listed += [
                    ObservationField(
                        f"log10_{name}_{t}_{j}", f"log10({unit})", centre, scale, f"magnitude of the {words} {where}"
                    ),
                    ObservationField(
                        f"log10_sigma_{short}_{t}_{j}",
                        f"log10({unit})",
                        middle,
                        width,
                        f"standard deviation of the {words} {where}",
                    ),
                ]
    return tuple(listed)


def direction_fields(targets: int, platforms: int) -> tuple[ObservationField, ...]:
    """For platforms that turn: the direction of each target relative to the look direction of each platform."""
    return tuple(
        ObservationField(
            f"azimuth_off_look_{t}_{j}", "rad", 0.0, 1.0,
            f"from the look direction of platform {j} to target {t}, as predicted one step ahead",
        )
        for t in range(1, targets + 1)
        for j in range(1, platforms + 1)
    )  # fmt: skip


def presence_fields(targets: int) -> tuple[ObservationField, ...]:
    """For targets that come and go: whether each is in the scene one step ahead, and in how many steps that changes."""
    listed = []
    for t in range(1, targets + 1):
        where = f"1 if target {t} is in the scene one step ahead, else 0"
        changes = f"steps until target {t} comes or goes, at most {SOON}"
        listed += [
            ObservationField(f"present_{t}", "1", 0.5, 0.5, where),
            ObservationField(f"changes_{t}", "step", 0.5 * SOON, 0.5 * SOON, changes),
        ]
    return tuple(listed)


def own_fields(targets: int, platform: int, turning: bool) -> tuple[str, ...]:
    """The names of the observation fields of one platform; platforms are numbered from 1."""
    names = [f"log10_{name}" for name, *_ in QUANTITIES] + [f"log10_sigma_{short}" for short, *_ in SPREADS]
    names += ["azimuth_off_look"] * turning
    return tuple(f"{name}_{t}_{platform}" for t in range(1, targets + 1) for name in names)
