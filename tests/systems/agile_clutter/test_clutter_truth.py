"""A world that differs from what the tracker assumes, in agile clutter and the systems that derive from it."""

from __future__ import annotations

import numpy as np
import oracles
import pytest

from wavegym.core import trees
from wavegym.systems.agile_clutter import AgileClutter
from wavegym.systems.beam_allocation import BeamAllocation
from wavegym.systems.energy_budget import EnergyBudget
from wavegym.systems.energy_budget.known import EnergyBudgetKnown

KINDS = (AgileClutter, BeamAllocation, EnergyBudget, EnergyBudgetKnown)
MISMATCHES = ({"q": 4.0}, {"turn_rate": 0.05}, {"prior_variance": 9.0}, {"reference_range": 0.6})


def mismatch(kind, change):
    """``change`` as parameters of ``kind``: a factor on its default, or a turn rate."""
    system = kind()
    (name, factor), *_ = change.items()
    if name == "turn_rate":
        return change
    value = getattr(system, name)
    return {name: tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value}


def play(system, worlds):
    """All states of an episode with drawn constants, the same for all systems of a kind."""
    constants, count = system.constants(), len(worlds.key)
    rng, states = np.random.default_rng(0), [system.initial(worlds)]
    for _ in range(system.horizon):
        action = constants[rng.integers(len(constants), size=count)]
        states.append(system.transition(states[-1], action, worlds))
    return states


def nees(system, count=300):
    """Mean NEES over worlds, targets and steps."""
    infos = [system.state_info(state) for state in play(system, oracles.worlds(system, count))[1:]]
    return np.mean([info["nees"].sum() / info["present"].sum() for info in infos])


def leaves(state):
    """All arrays of a state."""
    found = []
    trees.tree_map(found.append, state)
    return found


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("change", [*MISMATCHES, {"false_alarm": 0.1}])
def test_tracker_and_schedulers_keep_their_assumptions(kind, change):
    """Where all returns are missed, covariances are those without a truth, although the true paths are not.

    From one state, prediction, cost and observation are the same.
    """
    truth = mismatch(kind, change)
    system, changed = kind(clutter_density=0.0), kind(clutter_density=0.0, truth=truth)
    worlds = oracles.worlds(system, 5)
    blind = worlds._replace(detection=np.ones_like(worlds.detection))
    for one, two in zip(play(system, blind), play(changed, blind), strict=True):
        # Weights of the components differ with the gates' content, so their moments do in rounding.
        assert oracles.covariance_distance(one.belief.covariance, two.belief.covariance) < 1e-12
        moved = np.abs(one.truth.path - two.truth.path)[:, :, 1:].max(axis=3) > 0.0
        assert moved.all() if {*truth} & {"q", "turn_rate"} else not moved.any()
    state, actions = play(system, worlds)[9], system.constants()[:5]
    for name, more in (("predict", (actions,)), ("cost", ()), ("observe", ())):
        got, want = (getattr(s, name)(state.belief, *more) for s in (changed, system))
        for a, b in zip(leaves(got), leaves(want), strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("change", MISMATCHES)
def test_a_tracker_that_is_not_told_of_the_world_is_overconfident(kind, change):
    """300 values of mean 4 and variance 8, at worst wholly correlated over steps and targets: 4 standard errors, 0.65.

    Without clutter, where a handful of steps does not set the mean (docs/consistency_in_clutter.md).
    """
    truth = mismatch(kind, change)
    assert abs(nees(kind(clutter_density=0.0, **truth)) - 4.0) < 0.65
    assert nees(kind(clutter_density=0.0, truth=truth)) > 4.55


def test_the_field_of_clutter_has_the_true_density():
    """Clutter points of the first step, before gates depend on them: Poisson, so 4 standard errors are 4 sqrt(n)."""
    assumed = AgileClutter()
    worlds = oracles.worlds(assumed, 400)
    action = np.broadcast_to(assumed.constants()[0], (400, 2))
    counts = [
        s.state_info(s.transition(s.initial(worlds), action, worlds))["clutter"].sum()
        for s in (assumed, AgileClutter(truth={"clutter_density": 3e-4}), AgileClutter(truth={"clutter_density": 0.0}))
    ]
    assert counts[2] == 0
    assert abs(counts[1] - 3 * counts[0]) < 4 * np.sqrt(counts[1] + 9 * counts[0])


def test_the_tracker_weighs_returns_with_the_density_that_it_assumes():
    """In a world without clutter, a tracker that expects some trusts a return less than one that expects none."""
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
