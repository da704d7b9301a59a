"""Targets before RF/EO platforms: tape, truth, belief, and observation fields."""

from __future__ import annotations

from typing import NamedTuple

from wavegym.core.arrays import Array
from wavegym.core.system import ObservationField

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
    share: Array  # (env,) least weighted information of any target, as predicted for the last settings
    window: Array | None = None  # (env, target) int: window of a recording; None where targets follow the motion model


class Measurements(NamedTuple):
    """What the platforms report of one step, platform after platform: range (m), range-rate (m/s), azimuth (rad)."""

    z: Array  # (env, target, 3 platforms), 0 where nothing was received
    variance: Array  # (env, target, 3 platforms) of their errors as the tracker assumes it; infinite: not received
    information: Array  # (env,) least weighted information of any target, as predicted for the settings


class Belief(NamedTuple):
    """The belief."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)


def platform_fields(targets: int, platforms: int) -> tuple[ObservationField, ...]:
    """Each target's uncertainty, and the predicted measurements of it at each platform, one step ahead.

    In the order in which ``kernels.observe`` fills them.
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
