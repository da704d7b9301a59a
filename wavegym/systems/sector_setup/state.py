"""The state of one illuminator and its receivers: tape, truth, measurements, belief and observation fields."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import ObservationField
from wavegym.systems.visibility_windows import SOON, window_fields


class World(NamedTuple):
    """One episode's tape."""

    place: Array  # (target, 4) uniform: x and y in the region, speed, heading
    density: Array  # (target,) uniform: process noise density
    window: Array  # (target, n) uniform: windows of visibility
    start: Array  # (target, 4) normal: error of the first estimate
    process: Array  # (H, target, 4) normal: process noise
    key: Array  # () uint64: key of the draws of echo and noise, by step, target and receiver
    error: Array  # (H, receiver, target, 2) normal: measurement error


class Truth(NamedTuple):
    """The part of the state that no scheduler sees."""

    targets: Array  # (env, target, 4)
    q: Array  # (env, target) process noise density, m^2/s^3
    visible: Array  # (env, H, target) bool: whether the target is visible from step k to k + 1
    detections: Array  # (env,) int: number of receivers that detected the target in the last step
    silent: Array  # (env,) bool: whether the last step was a set-up step without a pulse
    window: Array | None = None  # (env, target) int: window of a recording; None if targets follow the motion model


class Measurements(NamedTuple):
    """The receivers' measurements in one step; 0 for receivers without a detection."""

    z: Array  # (env, receiver, 2) half the path and its rate, m and m/s
    detected: Array  # (env, receiver) bool
    silent: Array  # (env,) bool: whether no pulse was sent


class Belief(NamedTuple):
    """The belief, the state of the illuminator, and the known process noise and visibility of the targets."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    pointed: Array  # (env,) int: target for which the illuminator is set up, -1 for none
    dead: Array  # (env,) int: remaining set-up steps without sensing
    q: Array  # (env, target) process noise density as the tracker assumes it, m^2/s^3
    visible: Array  # (env, H, target) bool: visible from step k to k + 1, known in advance; all True if predicted
    looked: Array  # (env,) int: 1 if the last step's pulse found its target, -1 if it found nothing, 0 without a pulse
    memory: Any = None  # of a given tracker with a memory; otherwise, and in predictions, None
    process_noise: Array | None = None  # (env, target, 4, 4) of the next step as a given tracker assumes it; None: q


def report_fields(receivers: int, reference_range: float, speed: float) -> tuple[ObservationField, ...]:
    """Fields of each receiver's report, in the order of ``report_values``.

    Args:
        receivers: number of receivers.
        reference_range: typical distance from the illuminator and the receivers to the targets, m.
        speed: the greatest first speed of a target, m/s.
    """
    listed = [ObservationField("silent", "1", 0.5, 0.5, "1 if no pulse was sent in the last step")]
    for i in range(1, receivers + 1):
        where = f"as receiver {i} measured it last"
        listed += [
            ObservationField(f"log10_half_path_{i}", "log10(m)", np.log10(reference_range), 0.5, f"half path, {where}"),
            ObservationField(f"rate_{i}", "m/s", 0.0, speed, f"rate of half the path, {where}"),
            ObservationField(f"detected_{i}", "1", 0.5, 0.5, f"1 if receiver {i} detected the target in the last step"),
        ]
    return tuple(listed)


def report_values(measurements: Measurements, reference_range: float) -> Array:
    """Values of ``report_fields``, (env, fields)."""
    z, detected, silent = measurements
    path = np.log10(np.where(detected, np.maximum(z[..., 0], 1.0), reference_range))
    each = np.stack([path, np.where(detected, z[..., 1], 0.0), detected], axis=2)
    return np.column_stack([silent, each.reshape(len(z), -1)])


def illuminator_fields(targets: int, dead_steps: int) -> tuple[ObservationField, ...]:
    """Fields of the illuminator's settings."""
    listed = [
        ObservationField(f"pointed_{t}", "1", 0.5, 0.5, f"1 if the illuminator is set up for target {t}")
        for t in range(1, targets + 1)
    ]
    half = 0.5 * max(dead_steps, 1)
    return (*listed, ObservationField("dead_steps", "step", half, half, "remaining set-up steps"))


def sector_fields(
    targets: int, receivers: int, dead_steps: int, predicted: bool = False
) -> tuple[ObservationField, ...]:
    """Observation fields, in the order in which the kernel ``observe`` writes them.

    Args:
        targets: number of targets.
        receivers: number of receivers.
        dead_steps: number of steps of a set-up.
        predicted: whether visibility is predicted; the fields then give its probability in place of known times.
    """
    listed = [
        ObservationField("time_left", "1", 0.5, 0.3, "fraction of the horizon still to come"),
        ObservationField("dead_steps", "step", 0.5 * dead_steps, max(0.5 * dead_steps, 1.0), "remaining set-up steps"),
    ]
    for t in range(1, targets + 1):
        of, windows = f"of target {t}, one step ahead", window_fields(t)
        if predicted:
            meanings = (
                f"probability that target {t} is visible in the next step",
                f"steps until its probability passes 1/2, at most {SOON}",
                f"mean probability, over the next {SOON} steps, that it is visible",
            )
            windows = tuple(field._replace(meaning=m) for field, m in zip(windows, meanings, strict=True))
        listed += [
            ObservationField(
                f"set_up_{t}", "1", 0.5, 0.5, f"whether the illuminator is set up, or being set up, for target {t}"
            ),
            *windows,
            ObservationField(f"log10_q_{t}", "log10(m^2/s^3)", 0.0, 0.5, f"process noise density of target {t}"),
            ObservationField(f"log10_sigma_position_{t}", "log10(m)", 1.5, 0.5, f"RMS position uncertainty {of}"),
            ObservationField(f"log10_sigma_velocity_{t}", "log10(m/s)", 0.7, 0.4, f"RMS velocity uncertainty {of}"),
        ]
        for j in range(1, receivers + 1):
            at, where = f"{t}_{j}", f"{of}, at receiver {j}"
            listed += [
                ObservationField(f"snr_{at}", "dB", 19.0, 5.0, f"eta {where}"),
                ObservationField(
                    f"log10_sigma_r_{at}", "log10(m)", 1.5, 0.5, f"standard deviation of the range {where}"
                ),
                ObservationField(
                    f"log10_sigma_rdot_{at}", "log10(m/s)", 0.7, 0.4, f"standard deviation of the range-rate {where}"
                ),
            ]
    return tuple(listed)
