"""One beam a radar: tape, belief, and the observation fields of the windows of visibility."""

from __future__ import annotations

from typing import NamedTuple

from wavegym.core.arrays import Array
from wavegym.core.system import ObservationField
from wavegym.trackers import GaussianMixture, Particles

SOON = 10  # steps of visibility that are observed


class World(NamedTuple):
    """One episode's tape."""

    start: Array  # (target, 4) normal: error of the first estimate
    process: Array  # (target, lifetime, 4) normal: manoeuvres
    detection: Array  # (H, sensor, target) uniform: detected where below Pd
    error: Array  # (H, sensor, target, 2) normal: measurement error
    key: Array  # () uint64: key of the counter-based draws of clutter
    place: Array  # (target, 4) uniform: true start
    window: Array  # (target, n) uniform: windows of visibility


class Belief(NamedTuple):
    """The belief, and the windows of visibility."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    hypotheses: Particles | GaussianMixture | None  # as in AgileClutter's belief
    visible: Array  # (env, H, target) bool: whether a target is visible from step k to k + 1


def window_fields(targets: int) -> tuple[ObservationField, ...]:
    """Observation fields of each target's visibility."""
    listed: list[ObservationField] = []
    for t in range(1, targets + 1):
        listed += [
            ObservationField(f"visible_{t}", "1", 0.5, 0.5, f"whether target {t} is visible in the next step"),
            ObservationField(
                f"changes_{t}", "step", 0.5 * SOON, 0.5 * SOON, f"steps until that changes, at most {SOON}"
            ),
            ObservationField(
                f"soon_visible_{t}", "1", 0.5, 0.3, f"share of the next {SOON} steps in which target {t} is visible"
            ),
        ]
    return tuple(listed)
