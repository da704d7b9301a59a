"""Tape, truth and belief of two radars that share an account of energy."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_non_negative, check_within
from wavegym.core.system import ObservationField

if TYPE_CHECKING:
    from wavegym.systems.energy_budget.system import EnergyBudget


ROUND = 1.0 + 1e-12  # a budget short of whole quanta by rounding only is not short
WEAK = 5.0  # dB, an ordinary SNR of the longest pulse


class World(NamedTuple):
    """One episode's tape: AgileClutter's, where the targets start, and the occlusions."""

    start: Array  # (target, 4) normal: error of the first estimate
    process: Array  # (target, lifetime, 4) normal: manoeuvres
    detection: Array  # (H, sensor, target) uniform: detected where below Pd
    error: Array  # (H, sensor, target, 2) normal: measurement error
    key: Array  # () uint64: of the counter-based draws
    place: Array  # (target, 4) uniform: where in the region a target starts
    occlusion: Array  # (H,) uniform: the slot is clear where below the chance of that


class Truth(NamedTuple):
    """AgileClutter's, and what the last step did."""

    targets: Array  # (env, target, 4)
    path: Array  # (env, target, lifetime + 1, 4)
    first: Array  # (env, target, 4)
    outside: Array  # (env, target) int
    scan: Array  # (env, 4)
    spent: Array  # (env,) energy taken
    occluded: Array  # (env,) bool
    replaced: Array  # (env,) bool: the action could not be afforded


class Belief(NamedTuple):
    """The belief, the account and the jammer."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    particles: None
    energy: Array  # (env,) left; the longest pulse of one sensor takes 1
    occluded: Array  # (env,) probability that the last slot was occluded; 0 or 1 where it has been lived through


def account_elements(pace: float, most: int) -> tuple[ObservationField, ...]:
    """Observation elements of the account.

    Args:
        pace: energy for each step of the episode when the account is full.
        most: energy that can be spent in a step.
    """
    rate = f"energy left for each step left, in longest pulses; at most {most}"
    return (
        ObservationField("energy_left", "1", 0.5, 0.3, "share of the account that is left"),
        ObservationField("energy_rate", "1", pace, pace, rate),
    )


def check_pulses(system: EnergyBudget) -> None:
    """InputError for more than one chirp, or for targets that do not fit the scenario."""
    for name in ("laws", "sweeps"):
        if len(getattr(system, name)) != 1:
            raise InputError(f"{name} is {getattr(system, name)}, expected one: pulses differ in duration only")
    if any(system.births):
        raise InputError(f"births is {system.births}, expected 0 for every target")
    for half in system.spread:
        check_non_negative("spread", half)


def check_budget(system: EnergyBudget) -> None:
    """InputError for a budget that cannot be spent, or an episode of which does not pay the cheapest pulse."""
    budget, cheapest = system.budget, float(system.action_set.shares[1])
    least = cheapest / system.horizon
    if 0.0 <= budget * system.horizon * ROUND < cheapest:
        wanted = f"at least {least:.3g} (nearest), so that an episode's account pays the cheapest pulse once"
        raise InputError(f"budget is {budget!r} a step, expected {wanted}")
    check_within("budget", budget, least / ROUND, len(system.sensors), "a step")


def spells(mean_clear: float, mean_occluded: float, horizon: int) -> tuple[float, Array]:
    """Share of occluded slots in the long run, and how much of what is known now counts after 1, 2, ... slots.

    Args:
        mean_clear: steps.
        mean_occluded: steps.
        horizon: how many slots.
    """
    onset, end = 1.0 / mean_clear, 1.0 / mean_occluded
    return onset / (onset + end), (1.0 - onset - end) ** np.arange(1, horizon + 1)
