"""Targets before RF/EO platforms: tape, truth, belief, what an agent is shown of them, and what makes a scenario."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_non_negative, check_ordered, check_positive, check_within
from wavegym.core.system import ObservationField
from wavegym.waveforms import SPEED_OF_LIGHT

if TYPE_CHECKING:
    from wavegym.systems.rf_eo.system import RfEo

Pair = tuple[float, float]
Triple = tuple[float, float, float]
Quad = tuple[float, float, float, float]

MOST = 64  # targets, and platforms
FARTHEST, GREATEST_HZ = 1e9, 1e12  # what double precision can still take apart
MOST_RATIO = 1e12  # of the prior's variance to a measurement's
QUANTITIES = (("range", "m", 3.5, 1.0), ("range_rate", "m/s", 0.5, 1.5), ("azimuth", "rad", -0.5, 1.0))
SPREADS = (("r", "m", 1.0, 1.0), ("rdot", "m/s", -0.5, 1.0), ("az", "rad", -3.0, 1.5))


class World(NamedTuple):
    """One episode's tape, all standard normal."""

    start: Array  # (target, 4) error of the first estimate, where it is drawn
    process: Array  # (H, target, 4) manoeuvres
    error: Array  # (H, platform, target, 3) measurement errors


class Truth(NamedTuple):
    """What no scheduler sees."""

    targets: Array  # (env, target, 4)
    received: Array  # (env, target) int: measured quantities of the last step
    unseen: Array  # (env, target) int: steps since the last measurement
    share: Array  # (env,) of the last settings: least weighted information of any target, as predicted


class Belief(NamedTuple):
    """The belief."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)


def platform_elements(targets: int, platforms: int) -> tuple[ObservationField, ...]:
    """Observation elements: of every target its spread, and what each platform will meet of it one step ahead.

    In the order in which ``rf_eo_kernels.observe`` fills them.
    """
    listed = []
    for t in range(1, targets + 1):
        of = f"uncertainty of target {t}, one step ahead"
        listed += [
            ObservationField(f"log10_sigma_position_{t}", "log10(m)", 0.5, 1.0, f"RMS position {of}"),
            ObservationField(f"log10_sigma_velocity_{t}", "log10(m/s)", -0.3, 0.5, f"RMS velocity {of}"),
        ]
        for j in range(1, platforms + 1):
            where = f"of target {t} from platform {j}, as predicted one step ahead"
            for (name, unit, centre, scale), (short, _, middle, width) in zip(QUANTITIES, SPREADS, strict=True):
                words = name.replace("_", "-")
                listed += [
                    ObservationField(
                        f"log10_{name}_{t}_{j}", f"log10({unit})", centre, scale, f"magnitude of the {words} {where}"
                    ),
                    ObservationField(
                        f"log10_sigma_{short}_{t}_{j}", f"log10({unit})", middle, width, f"its spread {where}"
                    ),
                ]
    return tuple(listed)


def check_scenario(system: RfEo) -> None:
    """InputError for numbers, targets, platforms or settings that make no scenario."""
    _check_numbers(system)
    for name, rows in (("platforms", system.platforms), ("starts", system.starts)):
        check_within(f"number of {name}", len(rows), 1, MOST)
        if not np.isfinite(np.array(rows)).all():
            raise InputError(f"{name} is {rows}, expected finite numbers")
        for value in np.ravel(rows):
            check_within(f"number in {name}", float(value), -FARTHEST, FARTHEST, "m or m/s")
    if system.looks and len(system.looks) != len(system.platforms):
        raise InputError(f"looks is {system.looks}, expected {len(system.platforms)} angles, one for each platform")
    for look in system.looks:
        check_within("look direction", look, -math.pi, math.pi, "rad")
    _check_optics(system)


def _check_numbers(system: RfEo) -> None:
    """InputError for single numbers out of range."""
    for name in ("dt", "carrier_hz", "nearest_range"):
        check_positive(name, getattr(system, name))
    for name in ("q", "margin", "threshold"):
        check_non_negative(name, getattr(system, name))
    for name, most in (("dt", 1e6), ("carrier_hz", 1e15), ("q", 1e12), ("nearest_range", 1e9)):
        check_within(name, getattr(system, name), 0, most)
    for name in ("horizon", "iterations", "fft_length", "pixels"):
        check_within(name, getattr(system, name), 1, 1_000_000)
    for name, check in (
        ("prior_variance", check_positive),
        ("weights", check_non_negative),
        ("height", check_non_negative),
    ):
        for value in getattr(system, name):
            check(name, value)
    check_positive("sum of weights", sum(system.weights))
    for value in system.sharpness or ():
        check_positive("sharpness", value)


def _check_optics(system: RfEo) -> None:
    """InputError for settings that no platform can have."""
    for name in ("prf", "bandwidth", "pixel_angle"):
        low, high = getattr(system, name)
        check_ordered(name, low, high)
        check_positive(f"low of {name}", low)
        if low == high:
            raise InputError(f"{name} is ({low:g}, {high:g}), expected low < high")
        check_within(f"high of {name}", high, 0, GREATEST_HZ)
    widest = 2.0 * math.pi / system.pixels
    if system.pixel_angle[1] > widest * (1.0 + 1e-9):
        wanted = f"at most 2 pi / pixels, the full circle (nearest: {widest:.6g})"
        raise InputError(f"high of pixel_angle is {system.pixel_angle[1]:g} rad, expected {wanted}")
    finest = 0.5 * SPEED_OF_LIGHT / system.bandwidth[1]
    ratio = max(system.prior_variance) / (finest * finest / 12.0)
    if ratio > MOST_RATIO:  # an update keeps 1e-16 times this of its precision
        least = max(system.prior_variance) * MOST_RATIO / ratio
        wanted = f"at most {MOST_RATIO:g} times a range's at the greatest bandwidth (nearest: {least:.3g})"
        raise InputError(f"prior_variance is up to {max(system.prior_variance):g}, expected {wanted}")
    dwell = system.fft_length / system.prf[0]
    if dwell > system.dt:
        wanted = f"at most dt = {system.dt:g} s (nearest prf: {system.fft_length / system.dt:g} Hz)"
        raise InputError(
            f"dwell of {system.fft_length} pulses at {system.prf[0]:g} Hz is {dwell:g} s, expected {wanted}"
        )
