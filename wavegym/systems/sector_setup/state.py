"""One illuminator and its receivers: tape, truth, belief, what an agent is shown, and what makes a scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_non_negative, check_ordered, check_positive, check_within
from wavegym.core.system import ObservationField
from wavegym.systems.visibility_windows import given_windows, window_draws

if TYPE_CHECKING:
    from wavegym.systems.sector_setup.system import SectorSetup

Pair = tuple[float, float]
Quad = tuple[float, float, float, float]

MOST_TARGETS, MOST_RECEIVERS, MOST_WAVEFORMS = 64, 6, 64
LONGEST = 100_000  # steps of an episode
FARTHEST = 1e7  # m
SOON = 10  # steps of visibility that are observed


class World(NamedTuple):
    """One episode's tape."""

    place: Array  # (target, 4) uniform: x and y in the region, speed, heading
    density: Array  # (target,) uniform: process noise density
    window: Array  # (target, n) uniform: windows of visibility
    start: Array  # (target, 4) normal: error of the first estimate
    process: Array  # (H, target, 4) normal: manoeuvres
    detection: Array  # (H, receiver, target) uniform: detected where below Pd; only the illuminated target's is read
    error: Array  # (H, receiver, target, 2) normal: measurement error


class Truth(NamedTuple):
    """What no scheduler sees."""

    targets: Array  # (env, target, 4)
    detections: Array  # (env,) int: receivers that detected something in the last step
    silent: Array  # (env,) bool: whether the last step was spent on setting up


class Belief(NamedTuple):
    """The belief, the illuminator, and what is known of the targets from the beginning."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    pointed: Array  # (env,) int: the target set up, -1 for none
    dead: Array  # (env,) int: steps without sensing that its set-up still takes
    q: Array  # (env, target) process noise density, m^2/s^3
    visible: Array  # (env, H, target) bool: whether it can be seen from step k to k + 1


def sector_elements(targets: int, receivers: int, dead_steps: int) -> tuple[ObservationField, ...]:
    """Observation elements, in the order in which the kernel ``observe`` fills them."""
    listed = [
        ObservationField("time_left", "1", 0.5, 0.3, "fraction of the horizon still to come"),
        ObservationField(
            "dead_steps", "step", 0.5 * dead_steps, max(0.5 * dead_steps, 1.0), "that the set-up still takes"
        ),
    ]
    for t in range(1, targets + 1):
        of = f"of target {t}, one step ahead"
        listed += [
            ObservationField(
                f"set_up_{t}", "1", 0.5, 0.5, f"whether the illuminator is set up for target {t}, or being so"
            ),
            ObservationField(f"visible_{t}", "1", 0.5, 0.5, f"whether target {t} can be seen in the coming step"),
            ObservationField(
                f"changes_{t}", "step", 0.5 * SOON, 0.5 * SOON, f"steps until that changes, at most {SOON}"
            ),
            ObservationField(
                f"soon_visible_{t}", "1", 0.5, 0.3, f"share of the next {SOON} steps in which it can be seen"
            ),
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
                    f"log10_sigma_rdot_{at}", "log10(m/s)", 0.7, 0.4, f"the same of the range-rate {where}"
                ),
            ]
    return tuple(listed)


def check_sector_setup(system: SectorSetup) -> None:
    """InputError for numbers, places, waveforms or windows that make no scenario."""
    _check_numbers(system)
    check_within("number of receivers", len(system.receivers), 1, MOST_RECEIVERS)
    for name, rows in (
        ("illuminator", [system.illuminator]),
        ("receivers", system.receivers),
        ("region", system.region),
    ):
        for value in np.ravel(rows):
            check_within(f"number in {name}", float(value), -FARTHEST, FARTHEST, "m")
    for axis, bounds in zip("xy", system.region, strict=True):
        check_ordered(f"{axis} of region", *bounds)
    for name, bounds in (("speed", system.speed), ("q", system.q)):
        check_ordered(name, *bounds)
    check_non_negative("low of speed", system.speed[0])
    check_positive("low of q", system.q[0], "m^2/s^3")
    check_within("number of waveforms", len(system.waveforms), 1, MOST_WAVEFORMS)
    for row in system.waveforms:
        for name, value in zip(("range", "range-rate"), row, strict=True):
            check_positive(f"{name} deviation of a waveform", value)
    if len(set(system.waveforms)) < len(system.waveforms):
        raise InputError(f"waveforms is {system.waveforms}, expected each of them once")
    window_draws(system.horizon, system.shown, system.hidden)
    given_windows(system.windows, system.targets, system.horizon)


def _check_numbers(system: SectorSetup) -> None:
    """InputError for single numbers out of range."""
    check_within("horizon", system.horizon, 1, LONGEST, "steps")
    check_within("targets", system.targets, 1, MOST_TARGETS)
    check_within("dead_steps", system.dead_steps, 0, LONGEST)
    for name in ("dt", "reference_range", "reference_snr", "nearest_range"):
        check_positive(name, getattr(system, name))
    check_within("nearest_range", system.nearest_range, 0, system.reference_range, "m")
    if not 0.0 < system.false_alarm < 1.0:
        raise InputError(f"false_alarm is {system.false_alarm!r}, expected a probability between 0 and 1, exclusive")
    for name, check in (("prior_variance", check_positive), ("weights", check_non_negative)):
        for value in getattr(system, name):
            check(name, value)
    check_positive("sum of weights", sum(system.weights))
