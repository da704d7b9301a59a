"""Helpers of the tests of beam allocation: choices by sensor, chirps by quadrature, beliefs after random actions."""

from __future__ import annotations

import agile_clutter_oracle as plain
import numpy as np

from wavegym.systems.beam_allocation.system import BeamAllocation

SYSTEM = BeamAllocation()
JPDA = BeamAllocation(tracker="jpda")  # whose step is the oracle's
TARGET = np.repeat(np.arange(3), 2)  # target of each of a sensor's six choices
CHIRP, PULSE = (plain.unit_covariance("pfm", 3.0, *chirp) for chirp in ((50e-6, 40e6), (6.25e-6, 1e6)))
CHIRPS = np.array([CHIRP, plain.train_covariance(PULSE, 8, 250e-6)])


def choices(action):
    """The choice of each of two sensors, (..., sensor), from the order of the joint actions."""
    return np.stack(np.divmod(np.asarray(action), 6), axis=-1)


def coasted(system, belief):
    """F P F' + Q of every target."""
    F, Q = plain.transition(system)
    return F @ belief.covariance @ F.T + Q


def played(system, worlds, steps, seed=0):
    """The state after ``steps`` random actions."""
    state, rng = system.initial(worlds), np.random.default_rng(seed)
    for _ in range(steps):
        state = system.transition(state, rng.integers(len(system.actions), size=len(state.belief.step)), worlds)
    return state
