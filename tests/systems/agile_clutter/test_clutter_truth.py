"""A world with other clutter and other spells of occlusion than the tracker assumes."""

from __future__ import annotations

import numpy as np
import oracles
import pytest

from wavegym.core import shortcuts
from wavegym.systems.agile_clutter import AgileClutter
from wavegym.systems.energy_budget import EnergyBudget


def play(system, worlds):
    """All states of an episode with drawn constants, the same for all systems of a kind."""
    constants, count = shortcuts.constants(system), len(worlds.key)
    rng, states = np.random.default_rng(0), [system.initial(worlds)]
    for _ in range(system.horizon):
        action = constants[rng.integers(len(constants), size=count)]
        states.append(system.transition(states[-1], action, worlds))
    return states


def test_the_field_of_clutter_has_the_true_density():
    """Clutter points of the first step, before gates depend on them: Poisson, so 4 standard errors are 4 sqrt(n).

    Noise has no false returns here.
    """
    assumed = AgileClutter(snr_law="printed")
    worlds = oracles.worlds(assumed, 400)
    action = np.broadcast_to(shortcuts.constants(assumed)[0], (400, 2))
    counts = [
        s.state_info(s.transition(s.initial(worlds), action, worlds))["clutter"].sum()
        for s in (assumed, *(AgileClutter(snr_law="printed", truth={"clutter_density": d}) for d in (3e-4, 0.0)))
    ]
    assert counts[2] == 0
    assert abs(counts[1] - 3 * counts[0]) < 4 * np.sqrt(counts[1] + 9 * counts[0])


def test_the_tracker_weighs_returns_with_the_density_that_it_assumes():
    """In a world without clutter, a tracker that expects clutter trusts a return less than one that expects none."""
    wary, trusting = AgileClutter(truth={"clutter_density": 0.0}), AgileClutter(clutter_density=0.0)
    worlds = oracles.worlds(wary, 50)
    traces = [np.trace(play(s, worlds)[3].belief.covariance[:, 0], axis1=1, axis2=2) for s in (wary, trusting)]
    assert (traces[0] > traces[1]).mean() > 0.9


def test_spells_of_occlusion_follow_the_truth_and_their_forecast_does_not():
    """A two-state chain is occluded for mean_occluded of mean_clear + mean_occluded steps."""
    assumed = EnergyBudget(horizon=72)
    changed = EnergyBudget(horizon=72, truth={"mean_clear": 3.0, "mean_occluded": 9.0})
    states = play(changed, oracles.worlds(changed, 400))[1:]
    occluded = np.array([changed.state_info(state)["occluded"] for state in states])
    assert occluded[30:].mean() == pytest.approx(0.75, abs=0.03)
    belief = states[5].belief
    np.testing.assert_array_equal(changed._clear_probability(belief), assumed._clear_probability(belief))
