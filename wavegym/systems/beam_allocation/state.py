"""One beam a radar: tape and belief."""

from __future__ import annotations

from typing import NamedTuple

from wavegym.core.arrays import Array
from wavegym.systems.agile_clutter.state import Hypotheses


class World(NamedTuple):
    """One episode's tape."""

    start: Array  # (target, 4) normal: error of the first estimate
    process: Array  # (target, lifetime, 4) normal: manoeuvres
    error: Array  # (H, sensor, target, 2) normal: measurement error
    key: Array  # () uint64: key of the counter-based draws of echoes and false returns
    place: Array  # (target, 4) uniform: true start
    window: Array  # (target, n) uniform: windows of visibility


class Belief(NamedTuple):
    """The belief, and the windows of visibility."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    hypotheses: Hypotheses  # as in AgileClutter's belief
    visible: Array  # (env, H, target) bool: whether a target is visible from step k to k + 1
