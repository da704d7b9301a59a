"""Tape, truth and belief of two radars that share an account of energy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import ObservationField
from wavegym.systems.agile_clutter.state import Hypotheses


class World(NamedTuple):
    """One episode's tape: AgileClutter's, first positions of the targets, and occlusions."""

    start: Array  # (target, 4) normal: error of the first estimate
    process: Array  # (target, lifetime, 4) normal: manoeuvres
    error: Array  # (H, sensor, target, 2) normal: measurement error
    key: Array  # () uint64: key of the counter-based draws
    place: Array  # (target, 4) uniform: first state within its region
    occlusion: Array  # (n,) uniform: EnergyBudget: slot k is clear where below its probability; Known: the spells


class Truth(NamedTuple):
    """AgileClutter's truth, and the last step's energy, occlusion and replacement."""

    targets: Array  # (env, target, 4)
    path: Array  # (env, target, lifetime + 1, 4)
    first: Array  # (env, target, 4)
    outside: Array  # (env, target) int
    scan: Array  # (env, 4)
    spent: Array  # (env,) energy
    occluded: Array  # (env,) bool
    replaced: Array  # (env,) bool: the account could not pay the action


class Measurements(NamedTuple):
    """AgileClutter's measurements, and the step's energy, occlusion and replacement."""

    z: Array  # (env, sensor, return, 2)
    present: Array  # (env, sensor, return) bool
    first: Array  # (env, target, 4)
    outside: Array  # (env, target) int
    scan: Array  # (env, 2)
    spent: Array  # (env,) energy
    occluded: Array  # (env,) bool
    replaced: Array  # (env,) bool: the account could not pay the action


class Belief(NamedTuple):
    """The belief, the account and the last occlusion."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    hypotheses: Hypotheses  # as in AgileClutter's belief
    energy: Array  # (env,) energy left; the longest pulse of one sensor costs 1
    occluded: Array  # (env,) probability that the last slot was occluded; 0 or 1 unless predicted


def account_fields(pace: float, most: int) -> tuple[ObservationField, ...]:
    """Observation fields of the account.

    Args:
        pace: energy of the full account per step of the episode.
        most: greatest energy of one step.
    """
    rate = f"energy left for each step left, in longest pulses; at most {most}"
    return (
        ObservationField("energy_left", "1", 0.5, 0.3, "share of the account that is left"),
        ObservationField("energy_rate", "1", pace, pace, rate),
    )


def spells(mean_clear: float, mean_occluded: float, horizon: int) -> tuple[float, Array]:
    """Stationary probability of an occluded slot, and the weight of the current state after 1, 2, ... slots.

    Args:
        mean_clear: mean length of a clear spell, steps.
        mean_occluded: mean length of an occluded spell, steps.
        horizon: number of slots.
    """
    onset, end = 1.0 / mean_clear, 1.0 / mean_occluded
    return onset / (onset + end), (1.0 - onset - end) ** np.arange(1, horizon + 1)
